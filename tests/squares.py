"""A real detector whose weights are set by hand: it finds bright 8 px squares on black, and clips for it.

Input 64x64, one 8x8 cell grid, one anchor of 8 px, classes `red` and `other`. Its features are the mean colour of the
cell, so descriptors tell colours apart.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lookonce.make.darknet.importer import import_darknet
from lookonce.video import VideoWriter

SIZE = 64
CELL = 8
COLOURS = {"red": (255, 60, 60), "green": (60, 255, 60), "blue": (60, 60, 255)}
ROWS = {"red": 1, "green": 3, "blue": 6}
CFG = """
[net]
width=64
height=64
channels=3
[convolutional]
filters=4
size=8
stride=8
activation=linear
[convolutional]
filters=4
size=1
activation=linear
[convolutional]
filters=7
size=1
activation=linear
[yolo]
mask=0
anchors=8,8
classes=2
num=1
"""


def write_darknet(folder: Path) -> tuple[Path, Path, Path]:
    """The detector's cfg, weights and names files."""
    mean = np.zeros((4, 3, CELL, CELL))
    for channel in range(3):
        mean[channel, channel] = 1 / CELL**2
    mean[3] = 1 / (3 * CELL**2)
    head = np.zeros((7, 4))
    head[4, 3] = 40  # objectness: mean brightness
    head[5, :3], head[6, :3] = (20, -20, -20), (-20, 20, 20)
    parts = [np.zeros(4), mean, np.zeros(4), np.eye(4), np.array([0, 0, 0, 0, -8, 0, 0]), head]
    cfg, weights, names = folder / "squares.cfg", folder / "squares.weights", folder / "squares.names"
    cfg.write_text(CFG)
    header = np.array([0, 2, 0], "<i4").tobytes() + np.array([0], "<u8").tobytes()
    weights.write_bytes(header + b"".join(part.astype("<f4").tobytes() for part in parts))
    names.write_text("red\nother\n")
    return cfg, weights, names


def write_detector(folder: Path) -> Path:
    """The detector as a model file."""
    cfg, weights, names = write_darknet(folder)
    import_darknet(cfg, weights, folder / "squares.onnx", names=names)
    return folder / "squares.onnx"


def picture(index: int) -> np.ndarray:
    """Frame ``index``: each square in its own row, one cell further each frame, green the other way round."""
    image = np.zeros((SIZE, SIZE, 3), np.uint8)
    for name, row in ROWS.items():
        step = index if name != "green" else -index
        column = step % (SIZE // CELL)
        image[row * CELL : (row + 1) * CELL, column * CELL : (column + 1) * CELL] = COLOURS[name]
    return image


def write_clip(path: Path, frames: int = 12, rate: float = 10.0) -> Path:
    """A clip of moving squares."""
    with VideoWriter(path, rate) as writer:
        for index in range(frames):
            writer.write(picture(index), index / rate)
    return path
