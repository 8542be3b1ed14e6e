"""Where the whole picture jumped: the one shift under which most objects are where something was detected.

A camera that is bumped, or turns faster than its frames come, leaves no object where it was expected. Objects that move
by themselves do not agree on a shift, so it is found by a vote of all pairs, as in the Hough transform.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lookonce.tracking.candidates import FARTHEST, Frame, Pairs
from lookonce.tracking.motion import log_sides
from lookonce.tracking.objects import Objects

__all__ = ["Jolt", "find_jolt", "is_again"]

_F = NDArray[np.float64]

_MOST = 250_000  # pairs of objects and detections; where there are more, nothing is looked for: 640 of both
_SHARE = 0.6  # of the objects seen in the frame before so many have to agree,
_FEW = 4  # of fewer than so many all, and with all that is detected,
_STAYED, _THERE = 0.2, 0.5  # and no more may overlap a detection by so much: those who set off are not all
_CELL = 0.5  # boxes; votes within a square of two by two cells agree
_SIDE = 2 * int(FARTHEST / _CELL) + 4  # cells of all that is looked at


class Jolt(NamedTuple):
    """A jump of the whole picture.

    Attributes:
        shift: (2,) float64 px, x and y.
        cell: px; so far apart others may be who agree.
        objects, rows: (M,) int64, which places and detections agree on it.
    """

    shift: _F
    cell: float
    objects: NDArray[np.int64]
    rows: NDArray[np.int64]


def find_jolt(objects: Objects, was_seen: NDArray[np.bool_], frame: Frame, pairs: Pairs) -> Jolt | None:
    """How far the picture jumped; None: it did not, or nothing says how far.

    Args:
        objects: P of them, where they are expected.
        was_seen: (P,) bool, in the frame before.
        frame: its rows.
        pairs: of both.
    """
    count, is_missed = np.count_nonzero(was_seen), was_seen.copy()
    is_met = pairs.gains > -np.inf
    if count >= _FEW:  # many that go the same way do not do so by themselves; of a few each may be fast
        is_met &= pairs.overlap > 0
    is_missed[pairs.objects[is_met]] = False
    least = count if count < _FEW else max(_FEW, _SHARE * count)
    if not count or np.count_nonzero(is_missed) < least:
        return None
    seen, rows = was_seen.nonzero()[0], frame.is_usable.nonzero()[0]
    if len(rows) < least or len(rows) * count > _MOST or (count < _FEW and len(rows) > count):
        return None
    values = objects.motions.values.take(seen, axis=1)
    cell = _CELL * float(np.median(np.exp(log_sides(values))))
    apart = (frame.states.T[:2].take(rows, axis=1)[:, np.newaxis] - values[:2, :, np.newaxis]) / cell  # (2, Q, N)
    near = (np.abs(apart).max(axis=0) < FARTHEST / _CELL).ravel().nonzero()[0]
    whose, which = near // len(rows), near % len(rows)
    x, y = apart.reshape(2, -1).take(near, axis=1)
    column, line = np.floor(x).astype(np.int64) + _SIDE // 2, np.floor(y).astype(np.int64) + _SIDE // 2
    votes = np.zeros((count, _SIDE**2), np.bool_)
    # Each pair is in four squares of two by two cells, called by their last cell; an object votes once for each.
    for below, beside in ((0, 0), (0, 1), (1, 0), (1, 1)):
        votes[whose, (line + below) * _SIDE + column + beside] = True
    best = int(votes.sum(axis=0).argmax())
    down, right = best // _SIDE - _SIDE // 2, best % _SIDE - _SIDE // 2
    agree = (np.abs(x - right) <= 1) & (np.abs(y - down) <= 1)
    if min(len(np.unique(whose[agree])), len(np.unique(which[agree]))) < least:
        return None
    has_stayed = np.zeros(len(was_seen), np.bool_)
    has_stayed[pairs.objects[pairs.overlap >= _THERE]] = True
    if np.count_nonzero(has_stayed & was_seen) > _STAYED * count:
        return None
    shift = np.array([np.median(x[agree]), np.median(y[agree])]) * cell
    return Jolt(shift, cell, seen[whose[agree]], rows[which[agree]])


def is_again(speed: _F, before: _F, apart: float) -> bool:
    """Whether a jump of such ``speed`` (2,) px / s goes on from the one of the frame before: then all are on their way.

    ``apart`` px / s: they may differ by so much.
    """
    return bool(before.any() and np.abs(speed - before).max() <= apart)
