"""Noise in several sizes, for ground and sky."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["cloudy_noise"]


def cloudy_noise(
    rng: np.random.Generator, size: tuple[int, int], coarsest_px: float, octaves: int, falloff: float = 0.55
) -> NDArray[np.float32]:
    """Smooth noise ``size`` (height, width), mean about 0, deviation 1: waves of ``coarsest_px`` and finer ones."""
    height, width = size
    total = np.zeros(size, np.float32)
    weight = 1.0
    for octave in range(octaves):
        cell = max(1.0, coarsest_px / 2**octave)
        grid = rng.standard_normal((int(height / cell) + 3, int(width / cell) + 3)).astype(np.float32)
        box = (0.5, 0.5, 0.5 + width / cell, 0.5 + height / cell)
        total += weight * np.asarray(Image.fromarray(grid).resize((width, height), Image.Resampling.BICUBIC, box))
        weight *= falloff
    spread = float(total.std())
    even: NDArray[np.float32] = (total - total.mean()) / np.float32(max(spread, 1e-6))
    return even
