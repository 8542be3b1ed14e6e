"""One optimal assignment of several equally good ones: the one that SciPy gives.

Where the optimum is not unique, the figures of a tracker can depend on which one is taken, and published figures are
those of SciPy's ``linear_sum_assignment``. It is the shortest augmenting path algorithm of D. F. Crouse, "On
implementing 2D rectangular assignment algorithms", IEEE Transactions on Aerospace and Electronic Systems 52 (2016);
which of equal columns is taken is a matter of the program. Every step here rounds as its steps do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["assign_as_scipy"]


def assign_as_scipy(cost: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The assignment of least sum that ``scipy.optimize.linear_sum_assignment`` gives, equal sums included.

    Slow for a large table: in the mean one step of NumPy for each row.

    Args:
        cost: (R, C) float64, finite.

    Returns:
        Rows, rising, and their columns, both (min(R, C),) int64.

    >>> [part.tolist() for part in assign_as_scipy(np.zeros((2, 3)))]
    [[0, 1], [0, 1]]
    """
    rows, columns = cost.shape
    if columns < rows:
        transposed_rows, transposed_columns = assign_as_scipy(np.ascontiguousarray(cost.T))
        order = np.argsort(transposed_columns)
        return transposed_columns[order], transposed_rows[order]
    row_prices, column_prices = np.zeros(rows), np.zeros(columns)
    column_of, row_of = np.full(rows, -1, np.int64), np.full(columns, -1, np.int64)
    for row in range(rows):
        _augment(cost, row, row_prices, column_prices, column_of, row_of)
    return np.arange(rows), column_of


def _augment(
    cost: NDArray[np.float64],
    start: int,
    row_prices: NDArray[np.float64],
    column_prices: NDArray[np.float64],
    column_of: NDArray[np.int64],
    row_of: NDArray[np.int64],
) -> None:
    """Gives row ``start`` a column along the shortest path; modifies the prices and both assignments."""
    lengths = np.full(len(column_prices), np.inf)
    before = np.full(len(column_prices), -1, np.int64)
    remaining = np.arange(len(column_prices))[::-1].copy()  # SciPy's order
    count, row, reached = len(remaining), start, 0.0
    seen_rows, seen_columns = [], []
    while True:
        seen_rows.append(row)
        open_columns = remaining[:count]
        found = reached + cost[row, open_columns] - row_prices[row] - column_prices[open_columns]
        is_shorter = found < lengths[open_columns]
        shorter = open_columns[is_shorter]
        lengths[shorter], before[shorter] = found[is_shorter], row
        place, reached = _nearest(lengths[open_columns], row_of[open_columns])
        column = int(remaining[place])
        seen_columns.append(column)
        count -= 1
        remaining[place] = remaining[count]
        if row_of[column] < 0:
            break
        row = int(row_of[column])
    others = np.array(seen_rows[1:], np.int64)
    row_prices[start] += reached
    row_prices[others] += reached - lengths[column_of[others]]
    column_prices[seen_columns] -= reached - lengths[seen_columns]
    row = -1
    while row != start:
        row = int(before[column])
        row_of[column] = row
        column_of[row], column = column, int(column_of[row])


def _nearest(lengths: NDArray[np.float64], row_of: NDArray[np.int64]) -> tuple[int, float]:
    """Place and length of the shortest path; of equal ones the last that ends at a free column, else the first."""
    least = lengths.min()
    places = np.flatnonzero(lengths == least)
    free = places[row_of[places] < 0]
    return int(free[-1] if len(free) else places[0]), float(least)
