"""KITTI tracking truth (``label_02/0000.txt``)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lookonce.datasets.class_names import check_class_name
from lookonce.datasets.text import LARGEST_WHOLE, fault, quoted, read_text
from lookonce.datasets.truth import NO_IDENTITY, Rows, Truth

__all__ = ["LABELS", "kitti_files", "read_kitti"]

LABELS, _IMAGES = "label_02", "image_02"
_LEAST_COLUMNS = 10
_COLUMNS = "frame, id, type, truncated, occluded, alpha, left, top, right, bottom"
_NO_OBJECT = "DontCare"
_FPS = 10.0
# Seen shares that stand in for KITTI's words: fully visible, partly occluded, largely occluded, unknown; -1 = not said.
_VISIBILITY = {-1: 1.0, 0: 1.0, 1: 0.6, 2: 0.2, 3: 0.0}


def kitti_files(folder: Path) -> list[Path]:
    """The label files of a root (or of its ``training``), in no certain order; empty for other folders."""
    for base in (folder, folder / "training"):
        if (base / LABELS).is_dir():
            return [path for path in (base / LABELS).glob("*.txt") if path.is_file()]
    return []


def read_kitti(path: Path, pictures: Path | None) -> Truth:
    """One sequence. Columns: frame (from 0), id, type, truncated, occluded, alpha, left, top, right, bottom, and more.

    ``visibility`` is a stand-in: KITTI says in words how much of an object is hidden; fully visible, partly, largely
    occluded and unknown become 1, 0.6, 0.2 and 0. ``DontCare`` rows become nothing and are counted.

    Args:
        path: the label file; its pictures are in ``image_02/<its stem>`` beside its folder.
        pictures: a folder or a video instead of that.

    Raises:
        FormatError: it breaks its format.
    """
    types: dict[str, int] = {}
    numbers: list[tuple[float, ...]] = []
    left_out: Counter[str] = Counter()
    frames: set[int] = set()
    for line, fields in _lines(path):
        frame, identity = _whole(path, line, fields[0], "frame"), _whole(path, line, fields[1], "id")
        if frame < 0:
            raise fault(path, line, f"frame: frames count from 0; expected 0 or more, got {frame}")
        frames.add(frame)
        if fields[2] == _NO_OBJECT or identity < 0:
            left_out[_NO_OBJECT if fields[2] == _NO_OBJECT else NO_IDENTITY] += 1
            continue
        occluded = _whole(path, line, fields[4], "occluded")
        if occluded not in _VISIBILITY:
            raise fault(path, line, f"occluded: expected 0, 1, 2 or 3, got {occluded}; mend it")
        label = types.setdefault(check_class_name(fields[2], path, line), len(types))
        box = (_number(path, line, text, "box") for text in fields[6:10])
        numbers.append((frame, identity, label, *box, _VISIBILITY[occluded], line))
    values = np.array(numbers, np.float64).reshape(-1, 9)
    classes = tuple(sorted(types))
    order = np.array([classes.index(name) for name in types], np.int64)
    whole_numbers = values[:, [0, 1, 2, 8]].astype(np.int64)
    rows = Rows(
        frames=whole_numbers[:, 0],
        identities=whole_numbers[:, 1],
        labels=order[whole_numbers[:, 2]],
        xyxy=values[:, 3:7],
        visibility=values[:, 7],
        lines=whole_numbers[:, 3],
    )
    return Truth(
        path=path,
        name=path.stem,
        layout="kitti",
        pictures=path.parent.parent / _IMAGES / path.stem if pictures is None else pictures,
        fps=_FPS,
        stated=None,
        first_number=0,
        rows=rows,
        frames=np.array(sorted(frames), np.int64),
        classes=classes,
        ignored=np.zeros((0, 4), np.float32),
        left_out=left_out,
    )


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    for line, text in enumerate(read_text(path).split("\n"), 1):
        fields = text.split()
        if fields and len(fields) < _LEAST_COLUMNS:
            expected = f"expected at least {_LEAST_COLUMNS} columns separated by blanks ({_COLUMNS})"
            raise fault(path, line, f"{expected}, got {len(fields)}")
        if fields:
            yield line, fields


def _number(path: Path, line: int, text: str, column: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise fault(path, line, f"{column}: expected a number, got {quoted(text)}; mend the line") from None


def _whole(path: Path, line: int, text: str, column: str) -> int:
    number = _number(path, line, text, column)
    if not number.is_integer() or abs(number) > LARGEST_WHOLE:
        raise fault(path, line, f"{column}: expected a whole number, got {quoted(text)}; mend the line")
    return int(number)
