"""Ignored regions of UA-DETRAC: which boxes lie in them, as its toolkit counts pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["covered_share", "rounded"]

_DECIMALS = 6  # what is left of a number after corners were made of left and width, and the other way round
_BLOCK_BOXES = 4096


def rounded(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nearest whole numbers, halves away from zero.

    >>> rounded(np.array([0.5, 1.4, -0.5, 2.5])).tolist()
    [1.0, 1.0, -1.0, 3.0]
    """
    whole: NDArray[np.float64] = np.copysign(np.floor(np.abs(np.round(numbers, _DECIMALS)) + 0.5), numbers)
    return whole


def covered_share(ltwh: NDArray[np.float64], regions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The share of each box that the regions cover together; of the whole box, also where it leaves the picture.

    The toolkit counts pixels from 1 and adds up those from the one after ``left`` to ``left + width``; a region holds
    those from its left to its right, both included.

    Args:
        ltwh: (N, 4) float64, whole numbers, width and height above 0.
        regions: (M, 4) float64, xyxy, any numbers; nothing outside the picture.

    Returns:
        (N,) float64, 0 without regions.
    """
    if not len(regions):
        return np.zeros(len(ltwh))
    low, high = np.maximum(1, rounded(regions[:, :2])) - 1, rounded(regions[:, 2:])
    columns, rows = (np.unique(np.concatenate([low[:, axis], high[:, axis]])) for axis in (0, 1))
    # Of the grid that all edges make, the cells that lie in a region.
    in_columns = (low[:, None, 0] <= columns[:-1]) & (columns[1:] <= high[:, None, 0])  # (M, X)
    in_rows = (low[:, None, 1] <= rows[:-1]) & (rows[1:] <= high[:, None, 1])  # (M, Y)
    is_covered = (in_rows[:, :, None] & in_columns[:, None, :]).any(axis=0).astype(np.float64)  # (Y, X)
    shares = [np.zeros(0)]
    for first in range(0, len(ltwh), _BLOCK_BOXES):
        left, top, width, height = ltwh[first : first + _BLOCK_BOXES].T
        wide = _common(np.maximum(1, left), left + width, columns)  # (B, X)
        high_ = _common(np.maximum(1, top), top + height, rows)  # (B, Y)
        shares.append(((high_ @ is_covered) * wide).sum(axis=1) / (width * height))
    return np.concatenate(shares)


def _common(low: NDArray[np.float64], high: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """(B, E - 1): the length that each interval has in common with each space between edges."""
    ends = np.minimum(high[:, None], edges[None, 1:])
    common: NDArray[np.float64] = np.clip(ends - np.maximum(low[:, None], edges[None, :-1]), 0, None)
    return common
