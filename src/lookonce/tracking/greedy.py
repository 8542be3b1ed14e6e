"""Greedy one-to-one assignment: the smallest cost first, each row and column once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lookonce.distances import Floats

__all__ = ["assign_greedily"]


def assign_greedily(cost: Floats, limit: float) -> NDArray[np.intp]:
    """For each column the row that the greedy rule gives it: repeatedly take the smallest cost that is left.

    A pair that is the smallest of its row and of its column is taken by that rule whatever happens elsewhere, so all
    such pairs are taken at once, and again among the rest: a few rounds instead of a sort of all pairs. Of equal costs
    the lowest row wins, then the lowest column.

    Args:
        cost: (T, N), lower is better.
        limit: pairs above it are never taken.

    Returns:
        (N,) row of each column; -1 where there is none.

    Raises:
        ValueError: a cost is NaN.
    """
    row_of = np.full(cost.shape[1], -1)
    rows, columns = np.arange(cost.shape[0]), np.arange(cost.shape[1])
    while rows.size and columns.size:
        # argmin gives the first of equal costs.
        best_column, best_row = cost.argmin(axis=1), cost.argmin(axis=0)
        numbers = np.arange(rows.size)
        lowest = cost[numbers, best_column]
        if math.isnan(lowest.max()):
            raise ValueError("cost: expected numbers, got NaN")
        is_open = lowest <= limit
        is_pair = (best_row[best_column] == numbers) & is_open
        row_of[columns[best_column[is_pair]]] = rows[is_pair]
        is_open &= ~is_pair
        if not np.count_nonzero(is_open):
            break
        is_column_left = np.ones(columns.size, np.bool_)
        is_column_left[best_column[is_pair]] = False
        rows, columns = rows[is_open], columns[is_column_left]
        cost = cost[is_open][:, is_column_left]
    return row_of
