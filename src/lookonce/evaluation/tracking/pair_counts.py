"""How often an object and a track meet: sums over a sequence, only for those that ever do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.tracking.overlaps import Pairs, Scene

__all__ = ["Meetings"]

_MIN_IOU = 0.5  # of the identity figures; TrackEval has no tolerance here
_TABLE_ENTRIES = 1 << 22  # 16 MB


class Meetings:
    """For each object and track that ever overlap: the sum of their shares, and in how many frames they are near.

    Args:
        scene: truth and result.

    Attributes:
        keys: (K,) int64: object * number of tracks + track, in the order in which they first meet.
        shares: (K,) float64, sums of ``Pairs.shares`` in the order of frames.
        near: (K,) int64, frames in which their IoU is 0.5 or more.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._places = _Places(scene.truth.count * scene.result.count)
        self.keys = np.zeros(0, np.int64)
        self.shares = np.zeros(0)
        self.near = np.zeros(0, np.int64)

    def add(self, pairs: Pairs) -> None:
        """Counts the next frames; ``pairs`` come in the order of frames."""
        keys = self._keys_of(pairs)
        new = self._places.add(keys)
        self.keys = np.concatenate([self.keys, new])
        self.shares = np.concatenate([self.shares, np.zeros(len(new))])
        places = self._places.of(keys)
        np.add.at(self.shares, places, pairs.shares)  # one by one: parts added up first would round otherwise
        near = np.bincount(places[pairs.overlaps >= _MIN_IOU], minlength=len(self.keys))
        near[: len(self.near)] += self.near
        self.near = near

    def places(self, pairs: Pairs) -> NDArray[np.int64]:
        """(P,) int64: the place in ``keys`` of each pair, all of which were added."""
        return self._places.of(self._keys_of(pairs))

    def _keys_of(self, pairs: Pairs) -> NDArray[np.int64]:
        tracks = self._scene.result.ids[pairs.results]
        return self._scene.truth.ids[pairs.truths] * self._scene.result.count + tracks

    @property
    def objects(self) -> NDArray[np.int64]:
        """(K,) int64: the object of each key."""
        return self.keys // max(1, self._scene.result.count)

    @property
    def tracks(self) -> NDArray[np.int64]:
        """(K,) int64: the track of each key."""
        return self.keys % max(1, self._scene.result.count)


class _Places:
    """Numbers keys in the order in which they come: by a table where few keys can be, else by sorted keys."""

    def __init__(self, possible: int) -> None:
        self._count = 0
        self._table = np.full(possible, -1, np.int32) if possible <= _TABLE_ENTRIES else None
        self._sorted = np.zeros(0, np.int64)
        self._numbers = np.zeros(0, np.int64)

    def add(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers the keys that are new, and gives these, rising."""
        if self._table is not None:
            new = np.unique(keys[self._table[keys] < 0])
            self._table[new] = np.arange(self._count, self._count + len(new))
        else:
            new = np.setdiff1d(keys, self._sorted)
            numbers = np.concatenate([self._numbers, np.arange(self._count, self._count + len(new))])
            known = np.concatenate([self._sorted, new])
            order = np.argsort(known, kind="stable")
            self._sorted, self._numbers = known[order], numbers[order]
        self._count += len(new)
        return new

    def of(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """The numbers of known keys."""
        if self._table is not None:
            return self._table[keys].astype(np.int64)
        return self._numbers[np.searchsorted(self._sorted, keys)]
