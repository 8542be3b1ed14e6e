"""Rows in whatever form they come: checked, bad ones set aside, and the answer given in kind."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lookonce.structures import NO_ID, Detections

__all__ = ["CheckedRows", "SupervisionDetections", "answer_supervision", "check_rows", "rows_of_supervision"]

DESCRIPTOR_KEY = "descriptor"


@runtime_checkable
class SupervisionDetections(Protocol):
    """What is used of ``supervision.Detections``; the package itself is not imported."""

    xyxy: Any
    confidence: Any
    class_id: Any
    tracker_id: Any
    data: dict[str, Any]


@dataclass(frozen=True, slots=True)
class CheckedRows:
    """The good rows of an input of N rows, and where they stood.

    Attributes:
        detections: the good rows.
        is_good: (N,) bool.
    """

    detections: Detections
    is_good: NDArray[np.bool_]

    def spread(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Ids of the good rows as ids (N,) of all rows; -1 for the others."""
        spread = np.full(len(self.is_good), NO_ID, np.int64)
        spread[self.is_good] = ids
        return spread


def check_rows(rows: NDArray[Any], descriptors: ArrayLike | None) -> CheckedRows:
    """Rows ``x1 y1 x2 y2 score label`` (N, 6) as detections.

    Rows with a number that is not finite, a box of zero or negative size, or a descriptor that is not finite are set
    aside. Descriptors are scaled to unit length; a zero vector stays zero.

    Raises:
        ValueError: the array is not (N, 6) numbers, or the descriptors are not (N, D).
    """
    if rows.ndim != 2 or rows.shape[1] != 6 or rows.dtype.kind not in "fiu":
        raise ValueError(f"detections: expected (N, 6) numbers x1 y1 x2 y2 score label, got {rows.shape} {rows.dtype}")
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows float32 becomes infinite: a bad row
        xyxy = rows[:, :4].astype(np.float32)
        scores = rows[:, 4].astype(np.float32)
        is_good = np.isfinite(rows).all(axis=1) & np.isfinite(xyxy).all(axis=1) & np.isfinite(scores)
        is_good &= (xyxy[:, 2:] > xyxy[:, :2]).all(axis=1) & (np.abs(rows[:, 5]) < 2**53)
    units = None
    if descriptors is not None:
        units = _unit_rows(np.asarray(descriptors), len(rows))
        is_good &= np.isfinite(units).all(axis=1)
    labels = rows[is_good, 5].astype(np.int64)
    detections = Detections(xyxy[is_good], scores[is_good], labels, None if units is None else units[is_good])
    return CheckedRows(detections, is_good)


def _unit_rows(descriptors: NDArray[Any], count: int) -> NDArray[np.float32]:
    if descriptors.ndim != 2 or len(descriptors) != count or descriptors.dtype.kind not in "fiu":
        raise ValueError(f"descriptors: expected ({count}, D) numbers, got {descriptors.shape} {descriptors.dtype}")
    with np.errstate(over="ignore", invalid="ignore"):
        exact = descriptors.astype(np.float64)
        largest = np.abs(exact).max(axis=1, initial=0, keepdims=True)  # first to 1, so that no square overflows
        exact = np.divide(exact, largest, out=np.zeros_like(exact), where=largest != 0)
        length = np.linalg.norm(exact, axis=1, keepdims=True)
        np.divide(exact, length, out=exact, where=length != 0)
    units: NDArray[np.float32] = exact.astype(np.float32)
    return units


def rows_of_supervision(detections: SupervisionDetections) -> tuple[NDArray[np.float64], ArrayLike | None]:
    """Rows (N, 6) float64 and descriptors (N, D) or None; a missing score is 1, a missing class 0."""
    xyxy = np.asarray(detections.xyxy, np.float64).reshape(-1, 4)
    rows = np.zeros((len(xyxy), 6))
    rows[:, :4] = xyxy
    rows[:, 4] = 1.0 if detections.confidence is None else detections.confidence
    rows[:, 5] = 0 if detections.class_id is None else detections.class_id
    if len(xyxy) == 0:  # supervision's own empty detections carry no data at all
        return rows, np.zeros((0, 0))
    return rows, detections.data.get(DESCRIPTOR_KEY)


def answer_supervision(detections: SupervisionDetections, ids: NDArray[np.int64]) -> SupervisionDetections:
    """The same detections with ``tracker_id`` set; the argument stays as it is."""
    answer = copy.copy(detections)
    answer.tracker_id = ids
    return answer
