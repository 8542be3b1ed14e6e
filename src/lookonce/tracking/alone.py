"""Who is alone: an object that was not found, and a detection that is nobody's, with nobody else to mistake them for.

However an object moves, and whatever its filter expects, such a pair is one: that the one should have gone in the very
frame in which the other came is less likely than any turn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import NO_ID
from lookonce.tracking.candidates import FARTHEST, Frame, Pairs
from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.motion import log_sides
from lookonce.tracking.objects import Objects
from lookonce.tracking.pairs import TooManyPairsError, near_pairs

__all__ = ["pairs_alone"]

_F = NDArray[np.float64]
_I = NDArray[np.int64]

_NEAR = 0.5  # boxes, to which the way at ``alone_speed`` is added
# Boxes: no other that was just seen is nearer to the object, and no other detection to the detection, than they are to
# each other and this; and nobody who may be hidden is nearer to the detection than the object.
_APART = 1.5
_SLACK = 1e-9
_MOST_GROWN = 0.7  # change of the logarithm of the size: twice as large
_MOST_PAIRS = 1_000_000  # where there are more, nobody is alone


def pairs_alone(
    objects: Objects,
    unseen_s: _F,
    was_seen: NDArray[np.bool_],
    frame: Frame,
    pairs: Pairs,
    step_s: float,
    config: DefaultConfig,
) -> tuple[_I, _I]:
    """Objects and rows (M,) that have only each other.

    Args:
        objects: P of them, where they are expected.
        unseen_s: (P,) since when each was not seen.
        was_seen: (P,) bool, in the frame before.
        frame: its rows, after the matching.
        pairs: which objects have been taken.
        step_s: since the frame before.
        config: the settings.
    """
    nobody = np.zeros(0, np.int64)
    is_known = objects.ids != NO_ID
    lost = (was_seen & is_known & ~pairs.is_taken).nonzero()[0]
    if not len(lost) or config.motion.alone_speed <= 0:
        return nobody, nobody
    free = _free_rows(frame, config)
    if not len(free):
        return nobody, nobody
    values, states = objects.motions.values, frame.states.T
    side = np.exp(log_sides(values[:, lost]))
    reach = min(_NEAR + config.motion.alone_speed * step_s, FARTHEST) * side
    try:
        ours, theirs = near_pairs(values[:2, lost].T, reach, states[:2, free].T, _MOST_PAIRS)
        only = ((np.bincount(ours)[ours] == 1) & (np.bincount(theirs)[theirs] == 1)).nonzero()[0]
        if not len(only):
            return nobody, nobody
        side, places, rows = side[ours[only]], lost[ours[only]], free[theirs[only]]
        grown = 0.5 * np.abs(values[2, places] + values[3, places] - states[2, rows] - states[3, rows])
        is_same = (grown <= _MOST_GROWN) & (objects.labels[places] == frame.labels[rows])
        side, places, rows = side[is_same], places[is_same], rows[is_same]
        there, here = values[:2, places], states[:2, rows]
        apart = np.hypot(*(there - here)) * (1 + _SLACK)  # the object itself is so far from the detection
        is_alone = _counts(there, apart + _APART * side, values[:2, was_seen]) == 1
        is_alone &= _counts(here, apart + _APART * side, states[:2, frame.is_usable]) == 1
        may_be = was_seen | (is_known & (unseen_s < config.hidden_s))
        is_alone &= _counts(here, apart, values[:2, may_be]) == 1
    except TooManyPairsError:
        return nobody, nobody
    return places[is_alone], rows[is_alone]


def _free_rows(frame: Frame, config: DefaultConfig) -> NDArray[np.intp]:
    """Sure rows that are nobody's, and no second boxes of what has been taken."""
    is_taken = frame.object_of >= 0
    is_free = frame.is_high & ~is_taken
    if np.count_nonzero(is_free):
        twins = frame.overlaps.above(config.duplicate_overlap)
        is_free[twins.a[is_taken[twins.b]]] = False
        is_free[twins.b[is_taken[twins.a]]] = False
    return is_free.nonzero()[0]


def _counts(places: _F, reach: _F, points: _F) -> NDArray[np.intp]:
    """(M,) how many ``points`` (2, N) lie within the squares of half side ``reach`` (M,) around ``places`` (2, M)."""
    return np.bincount(near_pairs(places.T, reach, points.T, _MOST_PAIRS)[0], minlength=len(reach))
