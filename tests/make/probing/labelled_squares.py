"""The moving squares of squares.py as labelled sequences."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from squares import CELL, ROWS, SIZE, picture

IDENTITIES = {"red": 1, "green": 2, "blue": 3}
INFO = "[Sequence]\nframeRate=10\nimWidth=64\nimHeight=64\n"


def truth_lines(frames: int = 12, names: tuple[str, ...] = tuple(IDENTITIES)) -> list[str]:
    """MOTChallenge's truth of the squares, frame after frame."""
    lines = []
    for index in range(frames):
        for name in names:
            step = index if name != "green" else -index
            left, top = step % (SIZE // CELL) * CELL, ROWS[name] * CELL
            lines.append(f"{index + 1},{IDENTITIES[name]},{left},{top},{CELL},{CELL},1,-1,-1,-1")
    return lines


def write_truth(folder: Path, lines: list[str]) -> Path:
    """A sequence without pictures."""
    (folder / "gt").mkdir(parents=True, exist_ok=True)
    (folder / "gt" / "gt.txt").write_text("\n".join(lines) + "\n")
    return folder


def write_squares(folder: Path, frames: int = 12, info: str = INFO) -> Path:
    """A sequence in MOTChallenge's layout, 10 frames per second."""
    write_truth(folder, truth_lines(frames))
    (folder / "img1").mkdir()
    for index in range(frames):
        Image.fromarray(picture(index)).save(folder / "img1" / f"{index + 1:06d}.png")
    if info:
        (folder / "seqinfo.ini").write_text(info)
    return folder
