"""Boxes that shake less: how far they are moved from the detections towards the filter, measured on the stream itself.

A detection errs by noise ``n``, and the filter expected something else by the surprise ``e``. Moved by ``-c e``, the
box errs by ``n - c e``, least on average where ``c`` is the variance R of the noise over that of the surprises, C0. R
follows from how surprises of one object in a row go together (Mehra, "On the identification of variances and adaptive
Kalman filtering", IEEE Transactions on Automatic Control 15, 1970): with their covariance C1 and the filter's gain K,
``R = (1 - K) C0 - C1``, so ``c = 1 - K - C1 / C0``. Where the filter takes the detector for what it is, surprises are
independent, and ``c`` is the filter's own answer. A detector more precise than that makes it lag: surprises repeat
themselves, ``c`` falls to 0, and boxes stay as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.tracking.motion import Correction, boxes_around

__all__ = ["CHANGED_S", "Steadying", "in_boxes"]

_F = NDArray[np.float64]

_REMEMBERED = 2000.0  # pairs of surprises
_CONVINCING = 50.0  # with fewer, boxes are moved less
CHANGED_S = 0.5  # what was not seen for longer has changed itself, the more the longer
_LARGEST = 1.0  # surprise, boxes or logarithm of a size; more is another object


class Steadying:
    """What the surprises of a stream say of its detector, and the boxes that follow from it.

    Attributes:
        pairs: how many surprises in a row were seen, fading.
        products: sums of their products, of places and of sizes, fading as ``pairs``.
        squares: sums of their squares.
    """

    def __init__(self) -> None:
        self.pairs = 0.0
        self.products, self.squares = [0.0, 0.0], [0.0, 0.0]

    def state(self) -> _F:
        """(5,) all numbers, for ``restore``."""
        return np.array([self.pairs, *self.products, *self.squares])

    def restore(self, state: _F) -> None:
        """Goes on with the numbers (5,) of ``state``.

        Raises:
            ValueError: they are no such sums.
        """
        if (state < 0)[[0, 3, 4]].any():
            raise ValueError("steadying: expected sums of squares from 0")
        self.pairs, *sums = state.tolist()
        self.products, self.squares = sums[:2], sums[2:]

    def boxes(self, correction: Correction, states: _F, unseen_s: _F) -> _F:
        """Boxes xyxy (M, 4) for detections ``box_states`` (M, 4), by which filters were corrected.

        ``unseen_s`` (M,): how long ago each object was seen before.
        """
        share = self._noise() - correction.gains
        np.maximum(share, 0.0, out=share)
        share *= min(1.0, self.pairs / _CONVINCING)
        share *= (CHANGED_S / np.maximum(unseen_s, CHANGED_S)) ** 2
        count = len(states)
        way = correction.surprise.reshape(2, 2, count) * share[:, np.newaxis]
        moved = states.T - way.reshape(4, count)
        return boxes_around(moved[:2], np.exp(moved[2:]))

    def _noise(self) -> _F:
        """(2, 1), at most 1: ``1 - C1 / C0`` of places and of sizes; 0 where nothing is known."""
        (of_places, of_sizes), (place_squares, size_squares) = self.products, self.squares
        place = 1.0 - of_places / place_squares if place_squares > 0 else 0.0
        size = 1.0 - of_sizes / size_squares if size_squares > 0 else 0.0
        return np.array([[min(1.0, place)], [min(1.0, size)]])

    def learn(self, before: _F, now: _F) -> None:
        """Surprises (4, M) of objects and those (4, M) at the sighting before, in boxes and as logarithms."""
        count = now.shape[1]
        if not count:
            return
        kept = max(0.0, 1.0 - count / _REMEMBERED)
        products = np.add.reduce(before * now, axis=1).tolist()
        squares = np.add.reduce(before * before + now * now, axis=1).tolist()
        for of_what, (one, other) in enumerate(((0, 1), (2, 3))):
            self.products[of_what] = kept * self.products[of_what] + products[one] + products[other]
            self.squares[of_what] = kept * self.squares[of_what] + 0.5 * (squares[one] + squares[other])
        self.pairs = kept * self.pairs + count


def in_boxes(surprise: _F, side: _F) -> _F:
    """Surprises (4, M) of boxes of such longer ``side`` (M,) px in these and as logarithms, far ones cut."""
    scaled = surprise.copy()
    scaled[:2] /= side
    np.maximum(scaled, -_LARGEST, out=scaled)
    np.minimum(scaled, _LARGEST, out=scaled)
    return scaled
