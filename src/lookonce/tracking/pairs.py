"""Pairs of objects and detections that are near enough to be looked at: never all with all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["near_pairs"]

_DENSE = 1 << 14  # up to so many combinations comparing all is faster than a grid
_LONGEST_STRIP = 64  # cells that one reach may span, so that a few huge ones cannot fill the memory


def near_pairs(
    places: NDArray[np.float64], reach: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All pairs of which the point lies within the square of half side ``reach`` around the place.

    Args:
        places: (P, 2) float64.
        reach: (P,) float64, 0 or more.
        points: (N, 2) float64.

    Returns:
        (K,) place and (K,) point of each pair, in rising order.
    """
    if len(places) * len(points) <= _DENSE:
        limit = reach[:, None]
        is_near = np.abs(places[:, :1] - points[:, 0]) <= limit
        is_near &= np.abs(places[:, 1:] - points[:, 1]) <= limit
        rows, columns = np.nonzero(is_near)
        return rows, columns
    return _by_grid(places, reach, points)


def _by_grid(
    places: NDArray[np.float64], reach: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The same by strips: points sorted by strip and x; a place looks at a run of points in each strip it reaches."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(2 * float(np.median(reach)), float(2 * reach.max() / _LONGEST_STRIP), (high[1] - low[1]) / 4096, 1e-9)
    width = float(high[0] - low[0]) + 1.0
    strip = np.floor((points[:, 1] - low[1]) / size)
    key = strip * width + (points[:, 0] - low[0])
    order = np.argsort(key, kind="stable")
    key = key[order]
    last = float(strip.max())
    first_strip = np.clip(np.floor((places[:, 1] - reach - low[1]) / size), 0, last + 1)
    end_strip = np.clip(np.floor((places[:, 1] + reach - low[1]) / size), -1, last) + 1
    rows, strips = _expanded(first_strip, end_strip)
    left = np.clip(places[rows, 0] - reach[rows] - low[0], 0, width)
    right = np.clip(places[rows, 0] + reach[rows] - low[0], -1, width - 1)
    begin = np.searchsorted(key, strips * width + left, side="left")
    end = np.searchsorted(key, strips * width + right, side="right")
    runs, positions = _expanded(begin.astype(np.float64), np.maximum(begin, end).astype(np.float64))
    rows, columns = rows[runs], order[positions.astype(np.intp)]
    near = (np.abs(places[rows] - points[columns]) <= reach[rows, None]).all(axis=1)
    rows, columns = rows[near], columns[near]
    rising = np.lexsort((columns, rows))
    return rows[rising], columns[rising]


def _expanded(begin: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """For each row i the numbers ``begin[i]`` to ``end[i]`` - 1: the row of each, and the number."""
    counts = np.maximum(end - begin, 0).astype(np.intp)
    rows = np.repeat(np.arange(len(counts)), counts)
    start = np.cumsum(counts) - counts
    return rows, begin[rows] + (np.arange(len(rows)) - start[rows])
