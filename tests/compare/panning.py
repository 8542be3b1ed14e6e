"""Pictures of a camera that pans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

SIZE = (240, 320)
PAN_PX = 3


def write_pan(folder: Path, frames: int, step: int) -> Path:
    """A camera that looks along a speckled wall, so many px further each frame."""
    speckles = np.random.default_rng(3).integers(0, 256, (SIZE[0] // 6, 120), dtype=np.uint8)
    wall = np.kron(speckles, np.ones((6, 6), np.uint8))
    folder.mkdir(parents=True)
    for index in range(frames):
        view = wall[: SIZE[0], index * step : index * step + SIZE[1]]
        Image.fromarray(np.stack([view] * 3, axis=2)).save(folder / f"{index:03d}.png")
    return folder
