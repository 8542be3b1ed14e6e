"""Pairs of objects and detections that are near enough to be looked at: never all with all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["TooManyPairsError", "expanded", "near_pairs", "unravelled"]

_DENSE = 1 << 15  # up to so many combinations comparing all is faster than a grid
_SLACK = 1e-9
_MOST_STRIPS = 4096
_LONGEST_STRIP = 64  # cells that one reach may span, so that a few huge ones cannot fill the memory


class TooManyPairsError(Exception):
    """More pairs are near each other than are asked for at most."""


def near_pairs(
    places: NDArray[np.float64], reach: NDArray[np.float64], points: NDArray[np.float64], most: int | None = None
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All pairs of which the point lies within the square of half side ``reach`` around the place.

    Args:
        places: (P, 2) float64.
        reach: (P,) float64, 0 or more.
        points: (N, 2) float64.
        most: refuse to list more than about so many pairs, which saves the memory for them; None: list them all.

    Returns:
        (K,) place and (K,) point of each pair, in rising order.

    Raises:
        TooManyPairsError: there are more.
    """
    if len(places) * len(points) <= _DENSE:
        apart = places.T[:, :, None] - points.T[:, None]  # (2, P, N)
        np.abs(apart, out=apart)
        near = np.maximum(apart[0], apart[1], out=apart[0]) <= reach[:, None]
        return unravelled(near.ravel().nonzero()[0], len(points))  # np.nonzero of two dimensions is slow
    return _by_grid(places, reach, points, most)


def _by_grid(
    places: NDArray[np.float64], reach: NDArray[np.float64], points: NDArray[np.float64], most: int | None = None
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The same by strips: points sorted by strip and x; a place looks at a run of points in each strip it reaches."""
    low = points.min(axis=0)
    span = points.max(axis=0) - low
    wide = reach * (1 + _SLACK) + _SLACK * float(span.max())  # what rounding adds is taken away at the end
    middle = float(np.partition(wide, len(wide) // 2)[len(wide) // 2])
    size = max(2 * middle, float(2 * wide.max() / _LONGEST_STRIP), float(span[1]) / _MOST_STRIPS, 1e-9)
    strip = np.floor((points[:, 1] - low[1]) / size)
    last = float(strip.max())
    pad = max(float(span[0]), 1.0)  # between the runs of two strips lies nothing for 3 pads
    key = strip * (4 * pad) + (points[:, 0] - low[0])
    order = np.argsort(key, kind="stable")
    key = key[order]
    x, y = places[:, 0] - low[0], places[:, 1] - low[1]
    first = _between(np.floor((y - wide) / size), 0, last + 1).astype(np.intp)
    end = _between(np.floor((y + wide) / size), -1, last).astype(np.intp) + 1
    rows, strips = expanded(first, end)
    origin = strips * (4 * pad)
    left, right = _between(x - wide, -pad, 2 * pad)[rows], _between(x + wide, -pad, 2 * pad)[rows]
    begin, end = np.searchsorted(key, origin + left, side="left"), np.searchsorted(key, origin + right, side="right")
    if most is not None and int(np.maximum(end - begin, 0).sum()) > most:
        raise TooManyPairsError
    runs, positions = expanded(begin, end)
    rows, columns = rows[runs], order[positions]
    apart = np.abs(places.take(rows, axis=0) - points.take(columns, axis=0))
    near = np.maximum(apart[:, 0], apart[:, 1]) <= reach[rows]
    code = rows[near] * len(points) + columns[near]
    code.sort()
    return unravelled(code, len(points))


def _between(values: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """``np.clip``, faster."""
    return np.minimum(np.maximum(values, low), high)


def unravelled(places: NDArray[np.intp], columns: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of places in a matrix of so many columns."""
    rows = places // max(columns, 1)
    return rows, places - rows * columns


def expanded(begin: NDArray[np.intp], end: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """For each row i the numbers ``begin[i]`` to ``end[i]`` - 1: the row of each, and the number."""
    counts = np.maximum(end - begin, 0)
    rows = np.arange(len(counts)).repeat(counts)
    numbers = np.arange(len(rows))
    numbers += (begin - (counts.cumsum() - counts))[rows]
    return rows, numbers
