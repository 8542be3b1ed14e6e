"""The true boxes of a picture, and several classes counted as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import Detections, check_array, check_boxes

__all__ = ["DetectionTruth", "highest_label", "relabel"]


@dataclass(frozen=True, slots=True)
class DetectionTruth:
    """What is in one picture, checked on construction.

    Attributes:
        xyxy: (T, 4) float32, px of the picture, left < right and top < bottom.
        labels: (T,) int64, index into the class names, >= 0.
        is_crowd: (T,) bool, regions where any number of detections of that class is neither right nor wrong; left out =
            none is.
        labelled_classes: the classes that truth tells of in this picture; detections of others say nothing and are left
            out here. None = all classes.

    Raises:
        ValueError: a field has another shape, dtype, row count or range, or is not finite; or a box has a class that is
            not among the labelled ones.
    """

    xyxy: NDArray[np.float32]
    labels: NDArray[np.int64]
    is_crowd: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    labelled_classes: frozenset[int] | None = None

    def __post_init__(self) -> None:
        check_boxes("xyxy", self.xyxy)
        count = len(self.xyxy)
        if isinstance(self.is_crowd, np.ndarray) and not len(self.is_crowd):
            object.__setattr__(self, "is_crowd", np.zeros(count, np.bool_))
        check_array("labels", self.labels, (count,), np.int64)
        check_array("is_crowd", self.is_crowd, (count,), np.bool_)
        if count and self.labels.min() < 0:
            raise ValueError(f"labels: expected 0 or more, got {self.labels.min()}")
        if self.labelled_classes is not None:
            unknown = set(self.labels.tolist()) - self.labelled_classes
            if unknown:
                known = sorted(self.labelled_classes)
                raise ValueError(f"labels: expected labelled classes {known}, got {min(unknown)} too")

    def __len__(self) -> int:
        return len(self.xyxy)

    def tells_of(self, labels: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of ``labels`` (N,) are classes that truth tells of here: (N,) bool."""
        if self.labelled_classes is None:
            return np.ones(len(labels), np.bool_)
        return np.isin(labels, sorted(self.labelled_classes))


def highest_label(truths: Sequence[DetectionTruth], detections: Sequence[Detections]) -> int:
    """The highest label of all; -1 without any.

    Raises:
        ValueError: the lengths differ, or a detection has a negative label.
    """
    if len(truths) != len(detections):
        raise ValueError(f"detections: expected {len(truths)}, one for each picture, got {len(detections)}")
    labels = np.concatenate([np.zeros(0, np.int64), *(found.labels for found in detections)])
    if labels.min(initial=0) < 0:
        raise ValueError(f"detections: expected labels of 0 or more, got {labels.min()}")
    return int(np.concatenate([labels, *(truth.labels for truth in truths)]).max(initial=-1))


def relabel(
    truths: Sequence[DetectionTruth], detections: Sequence[Detections], numbers: NDArray[np.int64]
) -> tuple[list[DetectionTruth], list[Detections]]:
    """The same pictures with other class numbers, where several classes may get the same one.

    Detections of classes that a picture's truth does not tell of are left out first.

    Args:
        truths: of each picture.
        detections: of each picture; none has a negative label.
        numbers: (C,) int64, each class's new number; rows of a class with a negative one are left out.
    """
    new_truths, new_detections = [], []
    for truth, found in zip(truths, detections, strict=True):
        known = truth.tells_of(found.labels) & (numbers[found.labels] >= 0)
        new_detections.append(Detections(found.xyxy[known], found.scores[known], numbers[found.labels[known]]))
        kept = numbers[truth.labels] >= 0
        new_truths.append(DetectionTruth(truth.xyxy[kept], numbers[truth.labels[kept]], truth.is_crowd[kept]))
    return new_truths, new_detections
