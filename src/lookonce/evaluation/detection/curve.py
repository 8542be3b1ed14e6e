"""Precision and recall at every score: for plots, for a score threshold, and for the area below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.detection.matching import match
from lookonce.evaluation.detection.truth import DetectionTruth, highest_label, relabel
from lookonce.structures import Detections

__all__ = ["OperatingPoint", "PrecisionRecall", "precision_recall"]


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """What a detector does at one score threshold.

    Attributes:
        threshold: detections above this score are kept. It lies halfway between the lowest score kept and the next one.
        precision: share of the kept detections that are right.
        recall: share of the true boxes that are found.
        f1: harmonic mean of the two.
    """

    threshold: float
    precision: float
    recall: float
    f1: float


@dataclass(frozen=True, slots=True)
class PrecisionRecall:
    """Precision and recall after each detection that counts, by falling score.

    Attributes:
        recall: (N,) float64, share of the true boxes found so far.
        precision: (N,) float64, share of the detections so far that are right.
        scores: (N,) float32, falling; rows of equal score cannot be told apart by a threshold.
        boxes: true boxes that count, above 0 unless there are no rows.
    """

    recall: NDArray[np.float64]
    precision: NDArray[np.float64]
    scores: NDArray[np.float32]
    boxes: int

    def area(self) -> float:
        """Area under the envelope of precision over all points of recall; NaN without true boxes.

        COCO's average precision reads the same envelope at 101 points, so that it differs a little.
        """
        if not self.boxes:
            return math.nan
        envelope = np.maximum.accumulate(self.precision[::-1])[::-1]
        return float(np.sum(np.diff(self.recall, prepend=0.0) * envelope))

    def best_f1(self) -> OperatingPoint:
        """The threshold of the highest F1, of equally good ones the highest.

        Without a right detection it keeps none: threshold infinity and F1 of 0.
        """
        last = np.append(self.scores[1:] != self.scores[:-1], np.ones(min(len(self.scores), 1), np.bool_))
        rows = np.flatnonzero(last & (self.recall > 0))
        if not len(rows):
            return OperatingPoint(math.inf, 0.0, 0.0, 0.0)
        precision, recall = self.precision[rows], self.recall[rows]
        f1 = 2 * precision * recall / (precision + recall)
        best = int(f1.argmax())
        row = int(rows[best])
        below = float(self.scores[row + 1]) if row + 1 < len(self.scores) else 0.0
        threshold = (float(self.scores[row]) + below) / 2
        return OperatingPoint(threshold, float(precision[best]), float(recall[best]), float(f1[best]))


def precision_recall(
    truths: Sequence[DetectionTruth],
    detections: Sequence[Detections],
    labels: Sequence[int],
    *,
    min_iou: float = 0.5,
    max_detections: int | None = None,
) -> PrecisionRecall:
    """Precision and recall of one class, or of several that count as one.

    An object that is found as two of these classes is one right and one wrong detection.

    Args:
        truths: of each picture.
        detections: of each picture, in the same order.
        labels: of the classes.
        min_iou: least overlap of a detection and its true box.
        max_detections: of these classes in a picture, the surest; None = all. COCO's is 100.

    Raises:
        ValueError: the lengths differ, or a number is out of range.
    """
    highest = highest_label(truths, detections)
    if not labels or min(labels) < 0:
        raise ValueError(f"labels: expected one or more of 0 or above, got {list(labels)}")
    numbers = np.full(max(highest, *labels) + 1, -1)
    numbers[list(labels)] = 0
    matches = match(*relabel(truths, detections, numbers), np.array([min_iou]), max_detections=max_detections)
    order = np.argsort(-matches.scores, kind="stable")
    order = order[matches.is_counted[0, 0, order]]
    boxes = int(matches.truth_is_counted.sum())
    if not boxes:
        return PrecisionRecall(np.zeros(0), np.zeros(0), np.zeros(0, np.float32), 0)
    hits = np.cumsum(matches.is_right[0, 0, order])
    return PrecisionRecall(hits / boxes, hits / np.arange(1, len(order) + 1), matches.scores[order], boxes)
