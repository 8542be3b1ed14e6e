"""Which detections are right: each takes a true box of its class, the surest detection first.

All pictures and classes go side by side: in a first turn the best detection of each (picture, class), then the second
ones. Only detections that overlap a true box take part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import iou, share_inside
from lookonce.evaluation.detection.truth import DetectionTruth
from lookonce.structures import Detections

__all__ = ["EVERY_AREA", "Matches", "match"]

EVERY_AREA = ((0.0, 1e10),)
"""The one range of box areas, px^2, that holds them all; its end is COCO's."""


@dataclass(frozen=True, slots=True)
class Matches:
    """What became of N detections, for each of A ranges of box areas and L least overlaps.

    Rows are in the order class, picture, falling score, given order. Those that no longer count are left out.

    Attributes:
        labels: (N,) int64, rising.
        scores: (N,) float32.
        ranks: (N,) int64, from 0: how many rows of the same picture and class come before.
        is_right: (A, L, N) bool, has a true box that counts.
        is_counted: (A, L, N) bool, is right or wrong. Neither is a row that took a true box which does not count (a
            crowd, or of another area), nor one without true box whose own area is another.
        truth_labels: (T,) int64.
        truth_is_counted: (A, T) bool.
    """

    labels: NDArray[np.int64]
    scores: NDArray[np.float32]
    ranks: NDArray[np.int64]
    is_right: NDArray[np.bool_]
    is_counted: NDArray[np.bool_]
    truth_labels: NDArray[np.int64]
    truth_is_counted: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class _Rows:
    """Boxes of all pictures in the order group, then as asked; a group is a class in a picture."""

    xyxy: NDArray[np.float64]
    labels: NDArray[np.int64]
    groups: NDArray[np.int64]
    order: NDArray[np.int64]  # where each row was in the pictures laid end to end


@dataclass(frozen=True, slots=True)
class _Pairs:
    """A detection and a true box of its group that overlap enough, in the order of detections, then of rising overlap.

    Of equal overlaps the later true box is the better one, as in COCO's program.
    """

    rows: NDArray[np.int64]
    truths: NDArray[np.int64]
    overlaps: NDArray[np.float64]


def match(
    truths: Sequence[DetectionTruth],
    detections: Sequence[Detections],
    min_ious: NDArray[np.float64],
    areas: Sequence[tuple[float, float]] = EVERY_AREA,
    max_detections: int | None = None,
) -> Matches:
    """What each detection is: right, wrong or neither.

    A detection takes the free true box of its class that it overlaps most, a true box that counts before one that does
    not. Overlap with a crowd is the share of the detection that lies in it, and a crowd is always free.

    Args:
        truths: of each picture.
        detections: of each picture, as many; none has a negative label.
        min_ious: (L,) float64, least overlaps.
        areas: ranges of box areas in px^2, both ends included. Outside of it a box does not count.
        max_detections: of each class in a picture only so many, the surest; None = all.

    Raises:
        ValueError: a number is out of range.
    """
    _check(min_ious, max_detections)
    rows, scores, ranks = _rank(truths, detections, max_detections)
    true_rows = _gather([t.xyxy for t in truths], [t.labels for t in truths], np.zeros(0, np.float32))
    is_crowd = np.concatenate([np.zeros(0, np.bool_), *(t.is_crowd for t in truths)])[true_rows.order]
    truth_is_counted = _within(true_rows.xyxy, areas) & ~is_crowd
    pairs = _pairs(rows, true_rows, is_crowd, float(min_ious.min()))
    is_right, is_taken = _take(pairs, rows.groups, truth_is_counted, is_crowd, min_ious)
    is_wrong = ~is_taken & _within(rows.xyxy, areas)[:, None]
    return Matches(rows.labels, scores, ranks, is_right, is_right | is_wrong, true_rows.labels, truth_is_counted)


def _check(min_ious: NDArray[np.float64], max_detections: int | None) -> None:
    if not len(min_ious) or not ((min_ious > 0) & (min_ious < 1)).all():  # also for NaN
        raise ValueError(f"min_iou: expected a number above 0 and below 1, got {min_ious.tolist()}")
    if max_detections is not None and max_detections < 1:
        raise ValueError(f"max_detections: expected 1 or more, got {max_detections}")


def _gather(xyxy: list[NDArray[np.float32]], labels: list[NDArray[np.int64]], falling: NDArray[np.float32]) -> _Rows:
    """The rows of all pictures by group, within it by a falling number (where given), then as they come."""
    boxes = np.concatenate([np.zeros((0, 4)), *xyxy])  # float64: what COCO's program computes in
    classes = np.concatenate([np.zeros(0, np.int64), *labels])
    pictures = np.repeat(np.arange(len(labels)), np.array([len(rows) for rows in labels], np.int64))
    groups = classes * len(labels) + pictures
    order = np.lexsort((-falling, groups)) if len(falling) else np.argsort(groups, kind="stable")
    return _Rows(boxes[order], classes[order], groups[order], order.astype(np.int64))


def _rank(
    truths: Sequence[DetectionTruth], detections: Sequence[Detections], most: int | None
) -> tuple[_Rows, NDArray[np.float32], NDArray[np.int64]]:
    """The detections that count, their scores (N,) and ranks (N,)."""
    known = [truth.tells_of(found.labels) for truth, found in zip(truths, detections, strict=True)]
    scores = np.concatenate(
        [np.zeros(0, np.float32), *(found.scores[rows] for found, rows in zip(detections, known, strict=True))]
    )
    rows = _gather(
        [found.xyxy[chosen] for found, chosen in zip(detections, known, strict=True)],
        [found.labels[chosen] for found, chosen in zip(detections, known, strict=True)],
        scores,
    )
    ranks = _counted_within(rows.groups)
    kept = ranks < (len(ranks) if most is None else most)
    kept_rows = _Rows(rows.xyxy[kept], rows.labels[kept], rows.groups[kept], rows.order[kept])
    return kept_rows, scores[kept_rows.order], ranks[kept]


def _counted_within(groups: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) int64: for each row of rising ``groups`` (N,) how many of its group come before."""
    return np.arange(len(groups)) - np.searchsorted(groups, groups)


def _within(xyxy: NDArray[np.float64], areas: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """(A, N) bool: which boxes have an area of that range."""
    area = (xyxy[:, 2] - xyxy[:, 0]) * (xyxy[:, 3] - xyxy[:, 1])
    return np.stack([(area >= low) & (area <= high) for low, high in areas])


def _pairs(rows: _Rows, truths: _Rows, is_crowd: NDArray[np.bool_], least: float) -> _Pairs:
    """All pairs that overlap by ``least`` or more."""
    shared = np.intersect1d(rows.groups, truths.groups)
    bounds = [
        np.searchsorted(rows.groups, shared, "left"),
        np.searchsorted(rows.groups, shared, "right"),
        np.searchsorted(truths.groups, shared, "left"),
        np.searchsorted(truths.groups, shared, "right"),
    ]
    found, found_truths, overlaps = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
    for first, end, first_truth, end_truth in np.stack(bounds, axis=1).tolist():
        overlap = _overlaps(rows.xyxy[first:end], truths.xyxy[first_truth:end_truth], is_crowd[first_truth:end_truth])
        near, near_truths = np.nonzero(overlap >= least)
        found.append(near + first)
        found_truths.append(near_truths + first_truth)
        overlaps.append(overlap[near, near_truths])
    pairs = _Pairs(np.concatenate(found), np.concatenate(found_truths), np.concatenate(overlaps))
    order = np.lexsort((pairs.truths, pairs.overlaps, pairs.rows))
    return _Pairs(pairs.rows[order], pairs.truths[order], pairs.overlaps[order])


def _overlaps(xyxy: NDArray[Any], truth: NDArray[Any], is_crowd: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(N, T) float64: intersection over union; over the detection's own area where the true box is a crowd."""
    overlap: NDArray[Any] = iou(xyxy, truth)
    if is_crowd.any():
        overlap[:, is_crowd] = share_inside(xyxy, truth[is_crowd])
    return overlap


def _take(
    pairs: _Pairs,
    groups: NDArray[np.int64],
    truth_is_counted: NDArray[np.bool_],
    is_crowd: NDArray[np.bool_],
    min_ious: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which detections take a true box that counts, which take any; both (A, L, N) bool."""
    shape = (len(truth_is_counted), len(min_ious), len(groups))
    is_right, is_taken = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    is_free = np.ones((*shape[:2], len(is_crowd)), np.bool_)
    rows, starts, counts = np.unique(pairs.rows, return_index=True, return_counts=True)
    turns = _counted_within(groups[rows])
    for turn in range(int(turns.max(initial=-1)) + 1):
        now = np.flatnonzero(turns == turn)
        places = np.arange(int(counts[now].max()))  # K: the true boxes of a detection, the nearest last
        exists = places < counts[now, None]  # (n, K)
        index = np.where(exists, starts[now, None] + places, 0)
        candidates = pairs.truths[index]
        overlaps = np.where(exists, pairs.overlaps[index], 0.0)
        can = is_free[:, :, candidates] & (overlaps >= min_ious[:, None, None])  # (A, L, n, K)
        worth = can * (places + 1 + len(places) * truth_is_counted[:, None, candidates])
        best = worth.argmax(axis=3)  # (A, L, n)
        chosen = candidates[np.arange(len(now)), best]
        area, level, which = np.nonzero(can.any(axis=3))
        truth = chosen[area, level, which]
        is_free[area, level, truth] = is_crowd[truth]
        is_taken[area, level, rows[now[which]]] = True
        is_right[area, level, rows[now[which]]] = truth_is_counted[area, truth]
    return is_right, is_taken
