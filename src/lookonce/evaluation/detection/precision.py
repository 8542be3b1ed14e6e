"""Average precision of detections, as COCO's evaluation computes it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.detection.matching import EVERY_AREA, Matches, match
from lookonce.evaluation.detection.truth import DetectionTruth, highest_label, relabel
from lookonce.structures import Detections

__all__ = ["ClassScores", "DetectionScores", "average_precision"]

# COCO's settings, from its evaluation program.
_MIN_IOUS = np.linspace(0.5, 0.95, 10)
_RECALLS = np.linspace(0, 1, 101)
_SMALL_PX2, _LARGE_PX2 = 32.0**2, 96.0**2
_LARGEST_PX2 = EVERY_AREA[0][1]
_AREAS = (*EVERY_AREA, (0.0, _SMALL_PX2), (_SMALL_PX2, _LARGE_PX2), (_LARGE_PX2, _LARGEST_PX2))
_MAX_DETECTIONS = 100
_FEW_DETECTIONS = (1, 10)  # recall is also stated with so many
_AT_50, _AT_75 = 0, 5  # in _MIN_IOUS


@dataclass(frozen=True, slots=True)
class ClassScores:
    """COCO's twelve figures for one class, or their means over classes.

    All are in [0, 1], and NaN where there is no true box (of that size) that counts; COCO's program says -1 there.
    Small is up to 32 x 32 px, large from 96 x 96 px, by the area of the box.

    Attributes:
        name: of the class.
        boxes: true boxes that count.
        ap: average precision, mean over IoU from 0.50 to 0.95.
        ap50: at IoU 0.50.
        ap75: at IoU 0.75.
        ap_small: as ``ap``, of small objects.
        ap_medium: of medium ones.
        ap_large: of large ones.
        recall_1: share of true boxes found, mean over IoU from 0.50 to 0.95, by one detection of a class in a picture.
        recall_10: by ten.
        recall: by ``max_detections``.
        recall_small: as ``recall``, of small objects.
        recall_medium: of medium ones.
        recall_large: of large ones.
    """

    name: str
    boxes: int
    ap: float
    ap50: float
    ap75: float
    ap_small: float
    ap_medium: float
    ap_large: float
    recall_1: float
    recall_10: float
    recall: float
    recall_small: float
    recall_medium: float
    recall_large: float


@dataclass(frozen=True, slots=True)
class DetectionScores:
    """What ``average_precision`` found.

    Attributes:
        classes: of each class, in the order of its number.
        mean: over the classes that have true boxes; for a size, over those with true boxes of that size. ``boxes`` is
            the sum.
        precision: (C, 4, 10, 101) float64, the envelope of precision: by class; by area (all, small, medium, large); at
            IoU 0.50, 0.55, ... 0.95; at recall 0, 0.01, ... 1. NaN without true boxes.
    """

    classes: tuple[ClassScores, ...]
    mean: ClassScores
    precision: NDArray[np.float64]


def average_precision(
    truths: Sequence[DetectionTruth],
    detections: Sequence[Detections],
    classes: Sequence[str],
    *,
    as_one_class: Sequence[int] = (),
    max_detections: int = _MAX_DETECTIONS,
) -> DetectionScores:
    """COCO's figures: precision read at 101 points of recall, greedy matching by class, at most 100 detections of each.

    The numbers are those of pycocotools for boxes. Rows of equal scores count in the order of pictures, then of rows.

    Args:
        truths: of each picture.
        detections: of each picture, in the same order; scores down to about 0.005 should be among them, because
            precision counts as 0 beyond the last one's recall.
        classes: names, by label.
        as_one_class: labels that count as one class, in the place of the lowest and named after all. An object that is
            found as two of them is one right and one wrong detection. A picture whose truth tells of some of them only
            loses the detections of the others first.
        max_detections: of each class in a picture; COCO's is 100.

    Returns:
        Without true boxes all figures are NaN.

    Raises:
        ValueError: the lengths differ, or a label has no class name.

    >>> import numpy as np
    >>> boxes = np.array([[0, 0, 10, 10], [20, 0, 30, 10]], np.float32)
    >>> truth = DetectionTruth(boxes, np.array([0, 0]))
    >>> found = Detections(boxes[:1], np.array([0.9], np.float32), np.array([0]))
    >>> scores = average_precision([truth], [found], ["car"])
    >>> round(scores.mean.ap50, 3), scores.mean.recall
    (0.505, 0.5)
    """
    if (highest := highest_label(truths, detections)) >= len(classes):
        raise ValueError(f"classes: expected names of labels 0 to {highest}, got {len(classes)} names")
    names, numbers = _merge(tuple(classes), sorted(set(as_one_class)))
    if as_one_class:
        truths, detections = relabel(truths, detections, numbers)
    matches = match(truths, detections, _MIN_IOUS, _AREAS, max_detections)
    precision = np.full((len(names), len(_AREAS), len(_MIN_IOUS), len(_RECALLS)), math.nan)
    rows = []
    for label, name in enumerate(names):
        boxes = matches.truth_is_counted[:, matches.truth_labels == label].sum(axis=1)
        first, end = np.searchsorted(matches.labels, (label, label + 1)).tolist()
        precision[label] = _sampled_precision(matches, first, end, boxes)
        rows.append(_class_scores(name, boxes, precision[label], _recalls(matches, first, end, boxes)))
    return DetectionScores(tuple(rows), _mean(rows), precision)


def _merge(names: tuple[str, ...], merged: list[int]) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Class names after merging, and each class's number among them (C,)."""
    numbers = np.arange(len(names))
    if not merged:
        return names, numbers
    if merged[0] < 0 or merged[-1] >= len(names):
        raise ValueError(f"as_one_class: expected labels 0 to {len(names) - 1}, got {merged}")
    kept = [label for label in range(len(names)) if label not in merged[1:]]
    numbers[merged] = merged[0]
    united = "+".join(names[label] for label in merged)
    return tuple(united if label == merged[0] else names[label] for label in kept), np.searchsorted(kept, numbers)


def _sampled_precision(matches: Matches, first: int, end: int, boxes: NDArray[np.int64]) -> NDArray[np.float64]:
    """(4, 10, 101) float64: precision of one class, whose rows are ``first`` to ``end``; NaN without true boxes."""
    order = first + np.argsort(-matches.scores[first:end], kind="stable")
    is_right = matches.is_right[:, :, order]
    counted = np.cumsum(matches.is_counted[:, :, order], axis=2)
    sampled = np.full((*is_right.shape[:2], len(_RECALLS)), math.nan)
    for area in np.flatnonzero(boxes):
        for level in range(len(_MIN_IOUS)):
            rows = np.flatnonzero(is_right[area, level])
            hits = np.arange(1, len(rows) + 1)
            envelope = np.maximum.accumulate((hits / counted[area, level, rows])[::-1])[::-1]
            reached = np.searchsorted(hits / boxes[area], _RECALLS)
            sampled[area, level] = np.append(envelope, 0.0)[reached]
    return sampled


def _recalls(matches: Matches, first: int, end: int, boxes: NDArray[np.int64]) -> NDArray[np.float64]:
    """(3, 4) float64: share found with 1, 10 and all detections, by area, mean over overlaps; NaN without boxes."""
    recalls = np.full((len(_FEW_DETECTIONS) + 1, len(boxes)), math.nan)
    is_right, ranks = matches.is_right[:, :, first:end], matches.ranks[first:end]
    for number, most in enumerate((*_FEW_DETECTIONS, None)):
        hits = is_right[:, :, slice(None) if most is None else ranks < most].sum(axis=2)
        np.divide(hits.mean(axis=1), boxes, out=recalls[number], where=boxes > 0)
    return recalls


def _class_scores(
    name: str, boxes: NDArray[np.int64], precision: NDArray[np.float64], recalls: NDArray[np.float64]
) -> ClassScores:
    by_area = precision.mean(axis=(1, 2)).tolist()
    few, some, every = recalls.tolist()
    return ClassScores(
        name=name,
        boxes=int(boxes[0]),
        ap=by_area[0],
        ap50=float(precision[0, _AT_50].mean()),
        ap75=float(precision[0, _AT_75].mean()),
        ap_small=by_area[1],
        ap_medium=by_area[2],
        ap_large=by_area[3],
        recall_1=few[0],
        recall_10=some[0],
        recall=every[0],
        recall_small=every[1],
        recall_medium=every[2],
        recall_large=every[3],
    )


def _mean(rows: Sequence[ClassScores]) -> ClassScores:
    def mean(field: str) -> float:
        values = [value for row in rows if not math.isnan(value := getattr(row, field))]
        return math.fsum(values) / len(values) if values else math.nan

    figures = [field for field in ClassScores.__slots__ if field not in ("name", "boxes")]
    return ClassScores(name="mean", boxes=sum(row.boxes for row in rows), **{field: mean(field) for field in figures})
