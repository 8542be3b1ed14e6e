"""Pairs of objects and detections that are near enough to be looked at: never all with all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["near_pairs"]

_DENSE = 1 << 14  # up to so many combinations comparing all is faster than a grid
_SLACK = 1e-9
_MOST_STRIPS = 4096
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
    low = points.min(axis=0)
    span = points.max(axis=0) - low
    wide = reach * (1 + _SLACK) + _SLACK * float(span.max())  # what rounding adds is taken away at the end
    size = max(2 * float(np.median(wide)), float(2 * wide.max() / _LONGEST_STRIP), float(span[1]) / _MOST_STRIPS, 1e-9)
    strip = np.floor((points[:, 1] - low[1]) / size)
    last = float(strip.max())
    pad = max(float(span[0]), 1.0)  # between the runs of two strips lies nothing for 3 pads
    key = strip * (4 * pad) + (points[:, 0] - low[0])
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.clip(np.floor((places[:, 1] - wide - low[1]) / size), 0, last + 1).astype(np.intp)
    end = np.clip(np.floor((places[:, 1] + wide - low[1]) / size), -1, last).astype(np.intp) + 1
    rows, strips = _expanded(first, end)
    origin = strips * (4 * pad)
    left = np.clip(places[rows, 0] - wide[rows] - low[0], -pad, 2 * pad)
    right = np.clip(places[rows, 0] + wide[rows] - low[0], -pad, 2 * pad)
    runs, positions = _expanded(
        np.searchsorted(key, origin + left, side="left"), np.searchsorted(key, origin + right, side="right")
    )
    rows, columns = rows[runs], order[positions]
    near = np.abs(places[rows, 0] - points[columns, 0]) <= reach[rows]
    near &= np.abs(places[rows, 1] - points[columns, 1]) <= reach[rows]
    rows, columns = rows[near], columns[near]
    rising = np.lexsort((columns, rows))
    return rows[rising], columns[rising]


def _expanded(begin: NDArray[np.intp], end: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """For each row i the numbers ``begin[i]`` to ``end[i]`` - 1: the row of each, and the number."""
    counts = np.maximum(end - begin, 0)
    rows = np.repeat(np.arange(len(counts)), counts)
    numbers = np.arange(len(rows))
    numbers += np.repeat(begin - (np.cumsum(counts) - counts), counts)
    return rows, numbers
