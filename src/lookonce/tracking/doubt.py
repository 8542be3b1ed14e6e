"""Which detections can be trusted: whether they show the object that they were given to, and nothing else.

Where two objects meet, a detector gives one box for both, or boxes that lie between them, and errs the same way for as
long as they do. A filter that believes such boxes turns round after the wrong object. So of all that a detection may be
the share of its own object is found, as in joint probabilistic data association (Bar-Shalom, Daum and Huang, "The
probabilistic data association filter", IEEE Control Systems Magazine 29, 2009), by the places and over single changes
of the choice: an unseen object near the box is the one that it shows, or two objects have each other's box. The
identities stay as they were chosen; ``Motions.correct_`` trusts a detection of a small share less.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.tracking.candidates import TOUCHING, Frame, Pairs
from lookonce.tracking.default_config import DefaultConfig

__all__ = ["clean_rows", "own_shares"]

_NO_WAY = -100.0  # gain of what cannot be


def own_shares(frame: Frame, pairs: Pairs, may_be: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """(N,) the share of each row's own object, above 0 to 1; None: no row that was taken may be of another.

    No other object counts for more than the own one, since the choice saw more than places.

    Args:
        frame: N rows, after the matching.
        pairs: its pairs.
        may_be: (P,) objects that others' rows may be of.
    """
    owners: NDArray[np.int64] = frame.object_of[pairs.rows]
    is_rival = (pairs.overlap > TOUCHING) & (owners >= 0)
    is_rival &= (owners != pairs.objects) & may_be[pairs.objects]
    rivals = is_rival.nonzero()[0]
    if not len(rivals):
        return None
    count, gains = len(frame.scores), np.maximum(pairs.gains, _NO_WAY)
    own = (owners == pairs.objects).nonzero()[0]
    own_gains, row_of = np.zeros(count), np.full(len(pairs.is_taken), -1)
    own_gains[pairs.rows[own]] = gains[own]
    row_of[pairs.objects[own]] = pairs.rows[own]
    rows, other_rows = pairs.rows[rivals], row_of[pairs.objects[rivals]]
    odds = gains[rivals] - own_gains[rows]
    seen = (other_rows >= 0).nonzero()[0]
    if len(seen):
        theirs = other_rows[seen]
        odds[seen] += _gains_of(pairs, gains, owners[rivals[seen]], theirs, count) - own_gains[theirs]
    shares = np.ones(count)
    shares += np.bincount(rows, np.exp(np.minimum(odds, 0.0)), minlength=count)
    np.reciprocal(shares, out=shares)
    return shares


def _gains_of(
    pairs: Pairs, gains: NDArray[np.float64], objects: NDArray[np.int64], rows: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """(M,) the gain of each object (M,) with a row (M,) of ``count``, of ``gains`` (K,); little if no pair."""
    codes, wanted = pairs.objects * count + pairs.rows, objects * count + rows
    places = np.minimum(np.searchsorted(codes, wanted), len(codes) - 1)
    return np.where(codes[places] == wanted, gains[places], _NO_WAY)


def clean_rows(frame: Frame, pairs: Pairs, may_hide: NDArray[np.bool_], config: DefaultConfig) -> NDArray[np.bool_]:
    """(N,) bool: rows whose descriptor may be kept: sure of itself, and nothing else in the box.

    Args:
        frame: N rows, after the matching.
        pairs: its pairs.
        may_hide: (P,) objects that may be hidden in a box, unless they have been taken.
        config: the settings.
    """
    is_clean = frame.is_high.copy()
    crowded = frame.overlaps.above(config.clean_overlap)
    if len(crowded.a):
        both_high = frame.is_high[crowded.a] & frame.is_high[crowded.b]
        is_clean[crowded.a[both_high]] = False
        is_clean[crowded.b[both_high]] = False
    covers = (may_hide & ~pairs.is_taken)[pairs.objects] & (pairs.overlap > config.hidden_overlap)
    is_clean[pairs.rows[covers]] = False
    return is_clean
