"""Labelled stills in YOLO's text layout, and the average precision of detections on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce import Detections
from lookonce.boxes import iou

MIN_IOU = 0.5


@dataclass(frozen=True, slots=True)
class Still:
    """A picture and the true boxes of the wanted classes.

    Attributes:
        path: the picture.
        image: (H, W, 3) uint8 RGB.
        truth: (T, 4) float32 xyxy in px.
    """

    path: Path
    image: NDArray[np.uint8]
    truth: NDArray[np.float32]


def read_stills(folder: Path, classes: Sequence[str], limit: int | None = None) -> list[Still]:
    """The stills of ``folder/images`` with the boxes of some classes from ``folder/labels``, in order of their names.

    The classes are named by ``classes.txt``, in the folder or beside it. A picture without a label file has no boxes.
    """
    names_file = next(p for p in (folder / "classes.txt", folder.parent / "classes.txt") if p.exists())
    names = names_file.read_text().split()
    wanted = [names.index(name) for name in classes]
    stills = []
    for path in sorted((folder / "images").iterdir())[:limit]:
        with Image.open(path) as picture:
            image = np.asarray(picture.convert("RGB"))
        stills.append(Still(path, image, _read_boxes(folder / "labels" / f"{path.stem}.txt", wanted, image.shape[:2])))
    return stills


def _read_boxes(path: Path, wanted: list[int], size: tuple[int, ...]) -> NDArray[np.float32]:
    """Boxes (T, 4) xyxy in px: each line says class, centre x, centre y, width, height as shares of the picture."""
    lines = path.read_text().splitlines() if path.exists() else []
    rows = np.array([line.split()[:5] for line in lines if line.strip()], np.float64).reshape(-1, 5)
    rows = rows[np.isin(rows[:, 0], wanted)]
    height, width = size
    centre, half = rows[:, 1:3], rows[:, 3:5] / 2
    return (np.concatenate([centre - half, centre + half], axis=1) * [width, height, width, height]).astype(np.float32)


def average_precision(truths: Sequence[NDArray[np.float32]], found: Sequence[Detections]) -> float:
    """Area under the precision envelope over all points of recall, all rows as one class, at ``MIN_IOU``.

    Rows are taken by falling score; each takes the free true box of its picture that it overlaps most, and is false
    where it overlaps none enough. So a second row on one object is false, of whatever class it is.

    Args:
        truths: (T, 4) float32 xyxy for each picture.
        found: the detections in it.

    Returns:
        0 to 1; 0 without true boxes.
    """
    total = sum(map(len, truths))
    scores = np.concatenate([d.scores for d in found]) if found else np.zeros(0)
    hits = [_hits(boxes, rows) for boxes, rows in zip(truths, found, strict=True)]
    if not total or not len(scores):
        return 0.0
    is_hit = np.concatenate(hits)[np.argsort(-scores, kind="stable")]
    recall = np.cumsum(is_hit) / total
    precision = np.cumsum(is_hit) / np.arange(1, len(is_hit) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * envelope))


def _hits(truth: NDArray[np.float32], rows: Detections) -> NDArray[np.bool_]:
    """Which rows (N,) are right."""
    is_hit = np.zeros(len(rows), np.bool_)
    if not len(truth):
        return is_hit
    overlap = iou(rows.xyxy, truth)
    for row in np.argsort(-rows.scores, kind="stable"):
        best = int(np.argmax(overlap[row]))
        if overlap[row, best] >= MIN_IOU:
            is_hit[row] = True
            overlap[:, best] = -1  # taken
    return is_hit
