"""Which objects a sheet of neighbours shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation import DescribedObjects, nearest_distances, rank_gallery

__all__ = ["choose_queries", "nearest"]

_SAME_MOMENT_S = 1.0  # two boxes of an object nearer in time look the same
_MOST_OF_ONE_IDENTITY = 2  # among the neighbours of a query


def nearest(
    objects: DescribedObjects, query_row: int, min_gap_frames: int, max_gap_frames: int, k: int
) -> NDArray[np.int64]:
    """The rows of the nearest boxes of the query's sequence, nearest first, with room for several identities.

    At most two boxes of each identity, at least a second apart: a second look at the same moment would show nothing
    new. The first row is always the nearest of all.

    Args:
        objects: N rows.
        query_row: whose neighbours.
        min_gap_frames: neighbours are at least so many frames earlier or later.
        max_gap_frames: and at most so many.
        k: how many; fewer where there are fewer.

    Returns:
        (K,) int64 with K <= k.
    """
    rows, _ = rank_gallery(objects, query_row, min_gap_frames, max_gap_frames)
    shown_s: dict[int, list[float]] = {}  # identity -> times of its kept boxes
    kept: list[int] = []
    for row in rows.tolist():
        if len(kept) >= k:
            break
        times_s = shown_s.setdefault(int(objects.identities[row]), [])
        time_s = float(objects.times_s[row])
        if len(times_s) < _MOST_OF_ONE_IDENTITY and all(abs(time_s - t) >= _SAME_MOMENT_S for t in times_s):
            times_s.append(time_s)
            kept.append(row)
    return np.array(kept, np.int64)


def choose_queries(
    objects: DescribedObjects, min_gap_frames: int, max_gap_frames: int, count: int, seed: int
) -> NDArray[np.int64]:
    """Rows worth looking at: first ordinary ones, then as many of the worst, where there are so many.

    Only boxes whose object occurs again within the gaps are chosen; of long sequences the evenly thinned ones of
    ``nearest_distances``. An identity comes a second time only after all others. Ordinary ones are far from each other
    in time; worst ones are those whose nearest box is another object's, by how much nearer it is than the nearest of
    their own, and not within a second of a chosen one of the same object as long as there are others.

    Args:
        objects: N rows.
        min_gap_frames: neighbours are at least so many frames earlier or later.
        max_gap_frames: and at most so many.
        count: how many rows; fewer where there are fewer.
        seed: of the choice among equally good ones.

    Returns:
        (Q,) int64 with Q <= count, each row once; the same for the same arguments.
    """
    rows, genuine, impostor = nearest_distances(objects, min_gap_frames, max_gap_frames)
    shuffled = np.random.default_rng(seed).permutation(np.flatnonzero(np.isfinite(genuine)))
    rows, lead = rows[shuffled], genuine[shuffled] - impostor[shuffled]  # -inf where there is no impostor
    choice = _Choice(objects, rows)
    wrong = np.flatnonzero(lead > 0)
    for _ in range(min(count // 2, len(wrong))):
        choice.take_(wrong, lead[wrong])
    worst = len(choice.taken)
    everything = np.arange(len(rows))
    for _ in range(min(count, len(rows)) - worst):
        choice.take_(everything, choice.seconds_from_taken())
    chosen: NDArray[np.int64] = rows[np.array(choice.taken[worst:] + choice.taken[:worst], np.int64)]
    return chosen


class _Choice:
    """Candidates taken one after another, the identities in turn."""

    def __init__(self, objects: DescribedObjects, rows: NDArray[np.int64]) -> None:
        keys = np.stack([objects.sequences[rows], objects.identities[rows]])
        _, self._identity = np.unique(keys, axis=1, return_inverse=True)
        self._identity = self._identity.reshape(-1)  # NumPy 2.0 alone gives it another shape
        self._sequences, self._times_s = objects.sequences[rows], objects.times_s[rows]
        self._times_taken = np.zeros(len(rows), np.int64)  # of the identity of each candidate
        self.taken: list[int] = []

    def seconds_from_taken(self) -> NDArray[np.float64]:
        """For each candidate the seconds to the nearest taken one of its sequence, infinity without one."""
        nearest_s = np.full(len(self._times_s), np.inf)
        for number in self.taken:
            apart = np.where(
                self._sequences == self._sequences[number], np.abs(self._times_s - self._times_s[number]), np.inf
            )
            np.minimum(nearest_s, apart, out=nearest_s)
        return nearest_s

    def take_(self, candidates: NDArray[np.int64], scores: NDArray[np.float64]) -> None:
        """Take the free candidate of the least taken identity that has the highest score."""
        is_free = ~np.isin(candidates, self.taken)
        candidates, scores = candidates[is_free], scores[is_free]
        is_repeated = np.zeros(len(candidates), np.bool_)
        for number in self.taken:
            is_repeated |= (self._identity[candidates] == self._identity[number]) & (
                np.abs(self._times_s[candidates] - self._times_s[number]) < _SAME_MOMENT_S
            )
        order = np.lexsort((-scores, self._times_taken[candidates], is_repeated))
        number = int(candidates[order[0]])
        self.taken.append(number)
        self._times_taken[self._identity == self._identity[number]] += 1
