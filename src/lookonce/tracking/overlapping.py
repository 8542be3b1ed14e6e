"""Boxes of one frame that lie over each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import FARTHEST_PX, iou_of_pairs
from lookonce.distances import Quantized
from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.pairs import TooManyPairsError, expanded, near_pairs, unravelled

__all__ = ["Overlaps", "best_first", "keep_best", "overlaps_of", "thinned", "usable_rows"]

_MOST_PAIRS = 4_000_000  # of boxes near each other in a frame; crowds of 10,000 have a twentieth
_MOST_SWEPT = 1 << 20  # pairs of boxes of which one lies over, under or on the other, 50 MB; then a grid finds fewer


@dataclass(frozen=True, slots=True)
class Overlaps:
    """Pairs of rows whose boxes overlap, each pair once, in any order.

    Attributes:
        a, b: (K,) rows; a < b.
        overlap: (K,) float64, IoU.
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    overlap: NDArray[np.float64]

    def above(self, limit: float) -> Overlaps:
        """Those with an overlap above ``limit``."""
        chosen = (self.overlap > limit).nonzero()[0]
        if len(chosen) == len(self.a):
            return self
        return Overlaps(self.a[chosen], self.b[chosen], self.overlap[chosen])


def overlaps_of(xyxy: NDArray[np.float64], least: float, most: int | None = None) -> Overlaps:
    """The pairs among boxes ``xyxy`` (N, 4) whose IoU is above ``least``, 0 or more.

    Raises:
        TooManyPairsError: about ``most`` pairs or more are near each other; it takes no memory for them.
    """
    columns = xyxy.T  # (4, N)
    left, right = columns[0], columns[2]
    order = left.argsort(kind="stable")
    begin, end = np.arange(1, len(xyxy) + 1), left[order].searchsorted(right[order])
    limit = _MOST_SWEPT if most is None else min(_MOST_SWEPT, most)
    if len(xyxy) ** 2 <= limit or int(np.add.reduce(end - begin)) <= limit:
        low, high = _meeting(columns, order, begin, end)
    else:
        low, high = _near(xyxy, most)
    a, b = columns.take(low, axis=1), columns.take(high, axis=1)
    return Overlaps(low, high, iou_of_pairs(a.T, b.T)).above(least)


def _meeting(
    columns: NDArray[np.float64], order: NDArray[np.intp], begin: NDArray[np.intp], end: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Boxes (4, N) that have a point in common, (K,) each: in ``order`` of left sides a box meets a run of others.

    Which of these have heights in common is looked at pair by pair.
    """
    top, bottom = columns[1], columns[3]
    first, second = expanded(begin, end)
    first, second = order[first], order[second]
    meets = ((top[first] < bottom[second]) & (top[second] < bottom[first])).nonzero()[0]
    first, second = first[meets], second[meets]
    return np.minimum(first, second), np.maximum(first, second)


def _near(xyxy: NDArray[np.float64], most: int | None) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The same, and others that are near, by a grid: where too many boxes lie over and under each other."""
    size = xyxy[:, 2:] - xyxy[:, :2]
    centre = (xyxy[:, :2] + xyxy[:, 2:]) / 2
    # The centre of the one with the shorter longest side is never farther away than the other's longest side.
    rows, columns = near_pairs(centre, size.max(axis=1, initial=0), centre, most)
    other = rows != columns
    low, high = np.minimum(rows, columns)[other], np.maximum(rows, columns)[other]
    return unravelled(np.unique(low * len(xyxy) + high), len(xyxy))


def thinned(
    xyxy: NDArray[np.float64], order: NDArray[np.int64], is_wanted: NDArray[np.bool_], limit: float
) -> NDArray[np.bool_]:
    """What ``keep_best`` says with nobody there before, of boxes of which too many lie over each other: (N,) bool.

    One row after the other yields, so it needs memory for N rows and time for N times those that stay.
    """
    stays = np.zeros(len(xyxy), np.bool_)
    left = order[is_wanted[order]]
    while len(left):
        best, left = left[0], left[1:]
        stays[best] = True
        left = left[iou_of_pairs(np.broadcast_to(xyxy[best], (len(left), 4)), xyxy[left]) <= limit]
    return stays


def best_first(
    xyxy: NDArray[np.float64], scores: NDArray[np.float64], looks: Quantized | None
) -> Callable[[int], tuple[float, bool, list[float], int]]:
    """What rows are sorted by: falling ``scores`` (N,); of equal ones those with a descriptor; then by their boxes.

    So the order of rows makes a difference only between boxes ``xyxy`` (N, 4) that are the same.
    """
    return lambda row: (
        -float(scores[row]),
        looks is not None and bool(looks.squared_lengths[row] == 0),
        xyxy[row].tolist(),
        row,
    )


def keep_best(
    overlaps: Overlaps, key: Callable[[int], Any], is_wanted: NDArray[np.bool_], is_set: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which wanted rows stay when each yields to those set already and to better ones that stay: (N,) bool.

    Args:
        overlaps: pairs that are one object.
        key: what to sort rows by, best first.
        is_wanted: (N,) rows that want to stay.
        is_set: (N,) rows that are there already.
    """
    stays = is_wanted & ~is_set
    if not len(overlaps.a):
        return stays
    rivals: dict[int, list[int]] = {}
    for a, b in zip(overlaps.a.tolist(), overlaps.b.tolist(), strict=True):
        rivals.setdefault(a, []).append(b)
        rivals.setdefault(b, []).append(a)
    best: set[int] = set()
    for row in sorted(rivals, key=key):
        if stays[row]:
            stays[row] = not any(is_set[other] or other in best for other in rivals[row])
            if stays[row]:
                best.add(row)
    return stays


def usable_rows(
    xyxy: NDArray[np.float64], scores: NDArray[np.float64], looks: Quantized | None, config: DefaultConfig
) -> tuple[Overlaps, NDArray[np.bool_]]:
    """The boxes (N, 4) that overlap, and which rows are neither too weak nor second boxes of one object (N,).

    Rows far out are of no use either: no picture reaches there, and one of them would make sums and grids worthless.
    """
    is_wanted = scores >= config.low_score
    if np.abs(xyxy).max(initial=0.0) > FARTHEST_PX:
        is_wanted &= (np.abs(xyxy) <= FARTHEST_PX).all(axis=1)
    least = min(config.same_overlap, config.duplicate_overlap, config.clean_overlap)
    try:
        overlaps = overlaps_of(xyxy, least, _MOST_PAIRS)
    except TooManyPairsError:  # then only those that stay are looked at
        order = np.array(sorted(range(len(scores)), key=best_first(xyxy, scores, looks)))
        is_usable = thinned(xyxy, order, is_wanted, config.same_overlap)
        rows = np.flatnonzero(is_usable)
        among = overlaps_of(xyxy[rows], least)
        return Overlaps(rows[among.a], rows[among.b], among.overlap), is_usable
    twins = overlaps.above(config.same_overlap)
    return overlaps, keep_best(twins, best_first(xyxy, scores, looks), is_wanted, np.zeros(len(xyxy), np.bool_))
