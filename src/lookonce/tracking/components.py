"""The best choice among sparse pairs: each connected component by itself, never one dense matrix."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lookonce.assignment import components, settle, solve_dense, solve_few, solve_sparse

__all__ = ["assign_best"]

_FEW = 6  # pairs: up to so many all choices are tried
_TRIFLE = 1e-12  # of the largest gain
_DENSE = 1 << 16  # entries of a component's matrix; larger ones are solved as sparse


def assign_best(rows: NDArray[np.int64], columns: NDArray[np.int64], gains: NDArray[np.float64]) -> NDArray[np.int64]:
    """The pairs that together gain the most, each row and column at most once.

    Of equally good choices that of the first rows is taken, then of the first columns.

    Args:
        rows: (P,) int64, in rising order.
        columns: (P,) int64.
        gains: (P,) float64, above 0.

    Returns:
        (M,) int64, the places of the pairs taken, rising.
    """
    if not len(rows):
        return np.zeros(0, np.int64)
    settled, still_open = settle(rows, columns, gains, 0.0)
    if not len(still_open):
        return settled
    chosen, trifle = [settled], _TRIFLE * float(gains.max())
    # Earlier pairs count a trifle more: a convex function of the place, so that the first pair and the last together
    # have more than two between them.
    gains = gains + trifle * (math.sqrt(len(rows)) - np.sqrt(np.arange(len(rows))))
    for part in components(rows[still_open], columns[still_open]):
        pairs = still_open[part]
        chosen.append(pairs[_solve(rows[pairs], columns[pairs], gains[pairs])])
    return np.sort(np.concatenate(chosen))


def _solve(rows: NDArray[np.int64], columns: NDArray[np.int64], gains: NDArray[np.float64]) -> NDArray[np.int64]:
    """The places (M,) of the best choice in one component."""
    if len(rows) <= _FEW:
        places, _ = solve_few(rows.tolist(), columns.tolist(), gains.tolist())
        return np.array(places, np.int64)
    row_names, row = np.unique(rows, return_inverse=True)
    column_names, column = np.unique(columns, return_inverse=True)
    if len(row_names) * len(column_names) > _DENSE:
        return solve_sparse(row, column, gains)
    weights = np.zeros((len(row_names), len(column_names)))
    weights[row, column] = gains
    column_of = solve_dense(weights)
    return np.flatnonzero(column_of[row] == column)
