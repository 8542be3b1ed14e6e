"""Distances of all pairs of boxes, counted in bins: pairs of one object and pairs of two."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.retrieval.objects import DescribedObjects
from lookonce.evaluation.retrieval.timeline import Timeline, Windows, spread_evenly

__all__ = ["LARGEST_DISTANCE", "MOST_PAIRS", "PairDistances", "count_pairs", "pair_distances"]

LARGEST_DISTANCE = 2.0
"""Of two vectors of unit length."""

MOST_PAIRS = 50_000_000
"""Compared pairs at which queries are thinned: about three seconds of one core."""

_BINS = 4096  # each 0.0005 wide, far finer than an error rate can resolve


@dataclass(frozen=True, slots=True)
class PairDistances:
    """How often each distance occurs between boxes of one object and between boxes of two, checked on construction.

    Bin b of B holds the distances d with b * width <= d < (b + 1) * width and width = 2 / B; the last one also 2.

    Attributes:
        genuine: (B,) int64, pairs of the same sequence and identity.
        impostor: (B,) int64, pairs of the same sequence and different identities.
        identities: how many objects have a genuine pair.
        min_gap_frames: the boxes of a pair are at least so many frames apart.
        max_gap_frames: and at most so many.
        share: of the pairs that there are, compared ones, in [0, 1]; below 1 = the queries were thinned evenly.
    """

    genuine: NDArray[np.int64]
    impostor: NDArray[np.int64]
    identities: int
    min_gap_frames: int
    max_gap_frames: int
    share: float = 1.0

    def __post_init__(self) -> None:
        for name, counts in (("genuine", self.genuine), ("impostor", self.impostor)):
            if counts.shape != self.genuine.shape or counts.ndim != 1 or len(counts) == 0 or counts.dtype != np.int64:
                raise ValueError(f"{name}: expected (B,) int64 with B > 0, got {counts.shape} {counts.dtype}")
            if (counts < 0).any():
                raise ValueError(f"{name}: expected counts, got a negative number")

    @property
    def genuine_count(self) -> int:
        """Compared pairs of one object."""
        return int(self.genuine.sum())

    @property
    def impostor_count(self) -> int:
        """Compared pairs of two objects."""
        return int(self.impostor.sum())

    @property
    def bin_width(self) -> float:
        """Width of a bin, as a distance."""
        return LARGEST_DISTANCE / len(self.genuine)


def pair_distances(
    objects: DescribedObjects, min_gap_frames: int, max_gap_frames: int, most_pairs: int = MOST_PAIRS
) -> PairDistances:
    """Distances of all pairs of a sequence that lie between ``min_gap_frames`` and ``max_gap_frames`` apart.

    Both limits are included; gap 0 means two boxes of the same frame. Each pair counts once.

    Args:
        objects: N rows; 0 rows give counts of 0.
        min_gap_frames: 0 or more.
        max_gap_frames: ``min_gap_frames`` or more.
        most_pairs: where there are more pairs, only as many of the earlier boxes of the pairs as give about this
            number are compared: evenly spread, the same ones in every run; ``share`` tells how much was kept.

    Returns:
        The counts in 4,096 bins; the order of the rows does not change them.
    """
    (all_pairs,) = count_pairs(objects, min_gap_frames, max_gap_frames, most_pairs=most_pairs)
    return all_pairs


def count_pairs(
    objects: DescribedObjects,
    min_gap_frames: int,
    max_gap_frames: int,
    group_of: Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.int64]] | None = None,
    group_count: int = 1,
    most_pairs: int = MOST_PAIRS,
) -> tuple[PairDistances, ...]:
    """The same as ``pair_distances``, with the pairs told apart into groups.

    Args:
        objects: N rows.
        min_gap_frames: as above.
        max_gap_frames: as above.
        group_of: from the two rows of each pair, (P,) int64 and (P,) int64, to its group (P,) int64.
        group_count: groups are 0 to ``group_count`` - 1.
        most_pairs: as above, for all groups together.

    Returns:
        One for each group.
    """
    timeline = Timeline.of(objects)
    places, windows, share = _thinned(timeline, min_gap_frames, max_gap_frames, most_pairs)
    counts = np.zeros(group_count * 2 * _BINS, np.int64)
    found_again = np.zeros((group_count, len(objects)), np.bool_)
    for queries, others, distances in timeline.pairs(places, windows):
        is_same = objects.identities[queries] == objects.identities[others]
        groups = np.zeros(len(queries), np.int64) if group_of is None else group_of(queries, others)
        found_again[groups[is_same], queries[is_same]] = True
        bins = np.minimum((distances * (_BINS / LARGEST_DISTANCE)).astype(np.int64), _BINS - 1)
        bins += (2 * groups + is_same) * _BINS
        counts += np.bincount(bins, minlength=len(counts))
    by_group = counts.reshape(group_count, 2, _BINS)
    return tuple(
        PairDistances(genuine, impostor, _identity_count(objects, rows), min_gap_frames, max_gap_frames, share)
        for (impostor, genuine), rows in zip(by_group, found_again, strict=True)
    )


def _thinned(
    timeline: Timeline, min_gap_frames: int, max_gap_frames: int, most_pairs: int
) -> tuple[NDArray[np.int64], Windows, float]:
    """The places to compare with what comes later, their windows, and the share of all pairs that this is."""
    if most_pairs < 1:
        raise ValueError(f"most_pairs: expected 1 or more, got {most_pairs}")
    windows = timeline.later(np.arange(len(timeline)), min_gap_frames, max_gap_frames)
    lengths = windows.ends - windows.starts
    eligible = int(lengths.sum())
    busy = np.flatnonzero(lengths)
    if eligible > most_pairs:
        busy = busy[spread_evenly(len(busy), max(1, len(busy) * most_pairs // eligible))]
    share = int(lengths[busy].sum()) / eligible if eligible else 1.0
    return busy, Windows(windows.starts[busy], windows.ends[busy]), share


def _identity_count(objects: DescribedObjects, rows: NDArray[np.bool_]) -> int:
    return len(np.unique(np.stack([objects.sequences[rows], objects.identities[rows]]), axis=1).T)
