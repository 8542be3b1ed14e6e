"""Where the picture ends, and who has gone beyond."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lookonce.tracking.objects import Objects

__all__ = ["Border"]

_ENOUGH = 10  # objects: where so many have been says where the picture ends
_FAR_OUT = 5.0  # pictures beyond the border: so far no camera turns and comes back


class Border:
    """The border of one stream's pictures: as it is said, or where boxes have been.

    Attributes:
        extent: (4,) float64, xyxy of all these boxes, px; infinite before the first.
    """

    def __init__(self) -> None:
        self.extent = np.array([np.inf, np.inf, -np.inf, -np.inf])

    def widen(self, xyxy: NDArray[np.float64], rows: NDArray[np.intp]) -> None:
        """Take in the boxes ``xyxy`` (N, 4) at ``rows`` (M,): those of high score and of objects, not weak strays."""
        if len(rows):
            columns, low, high = xyxy.T.take(rows, axis=1), self.extent[:2], self.extent[2:]
            np.minimum(low, columns[:2].min(axis=1), out=low)
            np.maximum(high, columns[2:].max(axis=1), out=high)

    def xyxy(self, size: tuple[int, int] | None) -> tuple[float, float, float, float]:
        """The border of pictures of ``size`` (height, width), px; None: where boxes have been, if any have."""
        if size is not None:
            return 0.0, 0.0, size[1], size[0]
        left, top, right, bottom = self.extent.tolist()
        return (left, top, right, bottom) if left < right else (-math.inf, -math.inf, math.inf, math.inf)

    def are_outside(self, objects: Objects, size: tuple[int, int] | None, next_id: int) -> NDArray[np.bool_]:
        """(P,) bool: objects that are believed to have gone beyond the border, not the camera from them.

        Args:
            objects: P of them; whom the camera has left behind is noted there.
            size: (height, width) of the pictures, px; None: unknown.
            next_id: the first that was not given out yet.
        """
        if size is None and next_id <= _ENOUGH:
            return np.zeros(len(objects), np.bool_)
        left, top, right, bottom = self.xyxy(size)
        x, y = objects.motions.values[0], objects.motions.values[1]
        is_outside: NDArray[np.bool_] = (x < left) | (x > right) | (y < top) | (y > bottom)
        if np.count_nonzero(is_outside):
            left_behind = objects.left_behind
            left_behind[is_outside & objects.are_carried()] = 1.0
            far = _FAR_OUT * max(right - left, bottom - top)
            is_far = (x < left - far) | (x > right + far) | (y < top - far) | (y > bottom + far)
            is_outside &= (left_behind == 0) | is_far
        return is_outside
