"""What objects look like: the descriptors that are kept of each, and how far a detection is from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.distances import COARSE, Floats, Quantized

__all__ = ["LATEST", "Looks", "median_of_three"]

_NAMES = ("latest", "kept", "kept_squared", "seen", "view_count", "view_s")  # of what is saved
LATEST = 3  # descriptors of which the reference is the element-wise median, as in the paper's section 3.3
_CHUNK = 256  # pairs at once: half a megabyte of copies at 128 values and two views, which stays in a processor's cache


class Looks:
    """The descriptors of many objects, each in a slot that it keeps while it lives.

    Of an object are kept: the last three, their element-wise median as reference (before there are three: the newest),
    and up to ``views`` that differ from each other, the oldest replaced first. A distance to the object is the smallest
    to any of these. All are whole numbers of coarse precision, so a distance depends on nothing but the pair
    (``lookonce.distances``).

    Args:
        views: how many different views of an object are kept, 0 or more.
        apart: a new view is at least so far from those kept.
        interval_s: of an object a view is kept at most so often, s.
    """

    def __init__(self, views: int, apart: float, interval_s: float) -> None:
        self.views, self.apart, self.interval_s = views, apart, interval_s
        self.size: int | None = None
        self._free: list[int] = []
        self._used = 0
        self._allocate(0, 0)

    def _allocate(self, slots: int, size: int) -> None:
        self.latest = np.zeros((LATEST, slots, size), COARSE.dtype)
        self.kept = np.zeros((1 + self.views, slots, size), COARSE.dtype)  # the reference, then the views
        self.kept_squared = np.full(
            (1 + self.views, slots), np.inf, COARSE.dtype
        )  # squared lengths; infinite: none there
        self.seen = np.zeros(slots, np.int64)  # descriptors remembered so far
        self.view_count = np.zeros(slots, np.int64)
        self.view_s = np.full(slots, -np.inf)
        self._is_stale = np.zeros(slots, np.bool_)  # whether the reference is older than the last three

    def check_size(self, size: int) -> None:
        """Settle the length of descriptors, at the first call.

        Raises:
            ValueError: it was another one before.
        """
        if self.size is None:
            self.size = size
            self._allocate(max(len(self.seen), 64), size)
        elif size != self.size:
            raise ValueError(f"descriptors: expected {self.size} values as before, got {size}")

    def take(self, count: int) -> NDArray[np.int64]:
        """Slots for ``count`` new objects, empty."""
        again = [self._free.pop() for _ in range(min(count, len(self._free)))]
        fresh = range(self._used, self._used + count - len(again))
        self._used = fresh.stop
        while self._used > len(self.seen):
            self._grow()
        return np.array([*again, *fresh], np.int64)

    def release(self, slots: NDArray[np.int64]) -> None:
        """The objects in ``slots`` (M,) are gone."""
        self.kept_squared[:, slots] = np.inf
        self.seen[slots] = self.view_count[slots] = 0
        self._is_stale[slots] = False
        self.view_s[slots] = -np.inf
        self._free.extend(slots[::-1].tolist())

    def _grow(self) -> None:
        before, used = self._arrays(), len(self.seen)
        self._allocate(max(64, 2 * used), self.latest.shape[2])
        for old, new in zip(before, self._arrays(), strict=True):
            new[:used] = old

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        """All of them, slots first."""
        by_view = (self.latest.swapaxes(0, 1), self.kept.swapaxes(0, 1), self.kept_squared.T)
        return (*by_view, self.seen, self.view_count, self.view_s, self._is_stale)

    def part(self, slots: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """What is kept in ``slots`` (M,), by name, M rows each."""
        self.refresh(slots)
        return {name: array[slots] for name, array in zip(_NAMES, self._arrays(), strict=False)}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Fill the first slots with what ``part`` gave."""
        for name, array in zip(_NAMES, self._arrays(), strict=False):
            array[: len(arrays[name])] = arrays[name]

    def distances(
        self, slots: NDArray[np.int64], descriptors: Quantized, rows: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """(K,) float64: of each pair, the Euclidean distance; infinite where object or row has no descriptor.

        Args:
            slots: (K,) of the objects.
            descriptors: of N rows; a row of zeros has none.
            rows: (K,) of the pairs.
        """
        self.refresh(slots)
        squared = self._nearest(0, slots, descriptors.units, rows).astype(np.float64)
        lengths = descriptors.squared_lengths.take(rows)
        squared += lengths
        squared[lengths == 0] = np.inf
        np.sqrt(squared, out=squared)
        squared /= COARSE.scale
        return squared

    def _nearest(self, first: int, slots: NDArray[np.int64], units: Floats, rows: NDArray[np.int64]) -> Floats:
        """(K,) squared distances of ``units`` (N, D) at ``rows`` (K,), less their own squared lengths.

        Each is to the nearest of what is kept of one object, from number ``first`` on; infinite where that is nothing.
        """
        if len(slots) > _CHUNK:
            parts = [slice(begin, begin + _CHUNK) for begin in range(0, len(slots), _CHUNK)]
            return np.concatenate([self._nearest(first, slots[part], units, rows[part]) for part in parts])
        end = 1 + max(first, min(int(self.view_count.take(slots).max(initial=0)), self.views))
        kept = self.kept[first:end].take(slots, axis=1)  # (V, K, D)
        apart: Floats = (kept[:, :, None] @ units.take(rows, axis=0)[:, :, None])[..., 0, 0]
        apart *= -2.0
        apart += self.kept_squared[first:end].take(slots, axis=1)
        nearest: Floats = apart.min(axis=0)
        return nearest

    def remember(
        self,
        slots: NDArray[np.int64],
        descriptors: Quantized,
        rows: NDArray[np.int64],
        is_clean: NDArray[np.bool_],
        now_s: float,
    ) -> None:
        """Keep the descriptors of the rows (M,) for the objects in ``slots`` (M,).

        A row that is not clean (N,) is kept only where the object has none yet, to have something to go by.
        """
        seen = self.seen[slots]
        wanted = (is_clean[rows] | (seen == 0)) & (descriptors.squared_lengths[rows] > 0)
        if np.count_nonzero(wanted) < len(rows):
            slots, rows, seen = slots[wanted], rows[wanted], seen[wanted]
        self.latest[seen % LATEST, slots] = descriptors.units.take(rows, axis=0)
        self.seen[slots] = seen + 1
        self._is_stale[slots] = True
        if self.views:
            due = (is_clean[rows] & (self.view_s[slots] + self.interval_s <= now_s)).nonzero()[0]
            if len(due):
                self._view(slots[due], descriptors, rows[due], now_s)

    def refresh(self, slots: NDArray[np.int64]) -> None:
        """Bring the references of objects up to date: only when somebody asks, because most never are asked for."""
        is_due = np.zeros(len(self.seen), np.bool_)
        is_due[slots] = True
        is_due &= self._is_stale
        stale = is_due.nonzero()[0]
        if not len(stale):
            return
        self._is_stale[stale] = False
        latest, seen = self.latest.take(stale, axis=1), self.seen[stale]
        references = median_of_three(*latest)
        young = (seen < LATEST).nonzero()[0]
        if len(young):
            references[young] = latest[seen[young] - 1, young]
        self.kept[0][stale] = references
        self.kept_squared[0][stale] = Quantized.of(references).squared_lengths

    def _view(self, slots: NDArray[np.int64], descriptors: Quantized, rows: NDArray[np.int64], now_s: float) -> None:
        """Keep the rows (M,) of the objects in ``slots`` (M,) as views, where they differ from those kept."""
        self.view_s[slots] = now_s
        squared_lengths = descriptors.squared_lengths[rows]
        nearest = self._nearest(1, slots, descriptors.units, rows)
        new = (nearest + squared_lengths > (self.apart * COARSE.scale) ** 2).nonzero()[0]
        if not len(new):
            return
        slots = slots[new]
        place = 1 + self.view_count[slots] % self.views
        self.kept[place, slots] = descriptors.units[rows[new]]
        self.kept_squared[place, slots] = squared_lengths[new]
        self.view_count[slots] += 1


def median_of_three(a: Floats, b: Floats, c: Floats) -> Floats:
    """Element-wise median of three arrays of one shape."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    np.minimum(high, c, out=high)
    return np.maximum(low, high, out=low)
