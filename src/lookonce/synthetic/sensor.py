"""The camera's sensor and its compression: noise, shake, JPEG."""

from __future__ import annotations

import io
import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.synthetic.config import SceneConfig

__all__ = ["Sensor"]

_BANK = 64  # px by which the noise is larger than the picture, so that it can be shifted
_SHAKE_PERIODS_S = (0.31, 0.83, 2.9)
_SHAKE_SHARES = (0.35, 0.5, 0.8)
_NIGHT_NOISE = 2.0
_CUT = 3.0  # noise ends at so many deviations


class Sensor:
    """Turns what the optics give into what a camera gives.

    Args:
        config: the scene's settings.
        rng: of this scene's camera.
    """

    def __init__(self, config: SceneConfig, rng: np.random.Generator) -> None:
        self._rng = rng
        self._size = (config.height, config.width)
        self._quality = config.jpeg_quality
        self._deviation = config.noise
        self._shake = 2 * config.shake_px * config.width / 960  # half px
        self._phases = rng.uniform(0, 2 * math.pi, (2, len(_SHAKE_PERIODS_S)))
        shape = (config.height + _BANK, config.width + _BANK, 3)
        if config.noise:
            grain = rng.standard_normal(shape, np.float32)
            grain = 0.8 * grain + 0.45 * (grain + np.roll(grain, 1, 1) + np.roll(grain, 1, 0)) / math.sqrt(3)
            self._banks = [_bank(grain, config.noise * scale) for scale in (1.0, _NIGHT_NOISE)]
        room = math.ceil(_CUT * config.noise * _NIGHT_NOISE)
        self._room = [round(room + value * (255 - 2 * room) / 255) for value in range(256)] * 3

    def shift(self, time_s: float) -> tuple[int, int]:
        """Half px right and down by which the picture is off at a time."""
        if not self._shake:
            return 0, 0
        waves = np.sin(2 * math.pi * time_s / np.array(_SHAKE_PERIODS_S) + self._phases) @ np.array(_SHAKE_SHARES)
        off = np.clip(np.round(self._shake * 1.4 * waves), -4 * self._shake, 4 * self._shake)
        return int(off[0]), int(off[1])

    def expose(self, image: Image.Image, night: float) -> NDArray[np.uint8]:
        """The picture with noise and compression, (H, W, 3) uint8.

        Args:
            image: RGB.
            night: 0 = day, 1 = night.
        """
        pixels = np.asarray(image)
        if self._deviation:
            height, width = self._size
            top, left = self._rng.integers(0, _BANK, 2).tolist()
            noise = self._banks[round(night)][top : top + height, left : left + width]
            pixels = np.asarray(image.point(self._room)) + noise  # wraps to below 0 and never leaves 0 to 255
        if self._quality:
            buffer = io.BytesIO()
            Image.fromarray(pixels).save(buffer, "JPEG", quality=self._quality)
            pixels = np.asarray(Image.open(buffer).convert("RGB"))
        return np.ascontiguousarray(pixels)


def _bank(grain: NDArray[np.float32], deviation: float) -> NDArray[np.uint8]:
    """Noise in whole grey levels, modulo 256."""
    cut = _CUT * deviation
    return np.clip(np.round(grain * deviation), -cut, cut).astype(np.int16).astype(np.uint8)
