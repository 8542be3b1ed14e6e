"""The best one-to-one choice among weighted pairs: many small problems side by side, solved only where they are hard.

A pair that outweighs the best other pair of its row and the best other pair of its column taken together is in every
best choice. Most pairs are settled so; a solver gets what is left, in parts that share no row and no column.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import lap
import numpy as np
from numpy.typing import NDArray

__all__ = ["components", "is_only_best", "is_single", "settle", "solve_dense", "solve_few", "solve_sparse"]

TOLERANCE = 1e-12
"""Of the largest weight: sums that differ by less are taken as equal, for the solvers round."""

_FEW = 64  # pairs: up to so many plain numbers are faster than arrays


def settle(
    rows: NDArray[np.int64], columns: NDArray[np.int64], weights: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which pairs are in every choice of largest weight, and which are still open: places (S,), (O,) int64, rising.

    Args:
        rows: (P,) int64, in rising order.
        columns: (P,) int64.
        weights: (P,) float64, above 0; a row or a column may stay without pair.
        tolerance: choices that weigh so little less than the best are taken as good as it.
    """
    if len(rows) <= _FEW:
        few, left = _settle_few(rows.tolist(), columns.tolist(), weights.tolist(), tolerance)
        return np.array(few, np.int64), np.array(left, np.int64)
    open_pairs, weight = np.arange(len(rows)), weights
    settled = [open_pairs[:0]]
    row, column = rows - rows.min(), columns - columns.min()
    ends = np.stack([row, column + (row.max() + 1)])  # of each pair, among rows and columns together
    while len(open_pairs):
        is_settled = weight > _others(ends, weight) + tolerance
        if not is_settled.any():
            break
        settled.append(open_pairs[is_settled])
        is_taken = np.zeros(int(ends.max()) + 1, np.bool_)
        is_taken[ends[:, is_settled]] = True
        is_left = ~is_taken[ends].any(axis=0)
        open_pairs, weight, ends = open_pairs[is_left], weight[is_left], ends[:, is_left]
    return np.sort(np.concatenate(settled)), open_pairs


def _settle_few(
    rows: list[int], columns: list[int], weights: list[float], tolerance: float
) -> tuple[list[int], list[int]]:
    """``settle`` without arrays, which is faster for a handful of pairs."""
    left = list(range(len(rows)))
    if len(set(rows)) == len(set(columns)) == len(rows) and min(weights, default=0.0) > tolerance:
        return left, []
    pairs = list(zip(rows, columns, weights, strict=True))
    settled: list[int] = []
    while left:
        by_row: dict[int, list[float]] = {}
        by_column: dict[int, list[float]] = {}
        for place in left:
            row, column, weight = pairs[place]
            by_row.setdefault(row, []).append(weight)
            by_column.setdefault(column, []).append(weight)
        for rivals in (*by_row.values(), *by_column.values()):
            rivals.append(0.0)
            rivals.sort(reverse=True)
        chosen = []
        for place in left:
            row, column, weight = pairs[place]
            at_row, at_column = by_row[row], by_column[column]
            other = at_row[weight == at_row[0]] + at_column[weight == at_column[0]]  # the best, or the best but itself
            if weight > other + tolerance:
                chosen.append(place)
        if not chosen:
            break
        settled += chosen
        taken_rows, taken_columns = {rows[place] for place in chosen}, {columns[place] for place in chosen}
        left = [place for place in left if rows[place] not in taken_rows and columns[place] not in taken_columns]
    return sorted(settled), left


def _others(ends: NDArray[np.int64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P,): for each pair the largest other weight at its row and the largest other one at its column, together.

    Args:
        ends: (2, P) int64, the row and the column of each pair; no number is of both.
        weights: (P,) float64, above 0.
    """
    nodes, both = ends.ravel(), np.concatenate([weights, weights])
    count = int(nodes.max()) + 1
    best, second = np.zeros(count), np.zeros(count)
    np.maximum.at(best, nodes, both)
    is_best = both == best[nodes]
    np.maximum.at(second, nodes, np.where(is_best, 0.0, both))
    is_shared = np.bincount(nodes[is_best], minlength=count) > 1
    second[is_shared] = best[is_shared]
    others = np.where(is_best, second[nodes], best[nodes])
    return others[: len(weights)] + others[len(weights) :]


def is_single(values: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(P,) bool: which values come only once; ``values`` (P,) lie close together."""
    if not len(values):
        return np.zeros(0, np.bool_)
    offset = values - values.min()
    once: NDArray[np.bool_] = np.bincount(offset)[offset] == 1
    return once


def components(rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """The pairs in parts that share no row and no column: places (Q,) int64, rising; parts by their first place.

    Args:
        rows: (P,) int64.
        columns: (P,) int64.
    """
    if not len(rows):
        return
    _, row = np.unique(rows, return_inverse=True)
    _, column = np.unique(columns, return_inverse=True)
    part = np.arange(len(rows))  # of each pair: the lowest place that is known to belong to it
    while True:
        before = part
        for ends in (row, column):
            lowest = np.full(int(ends.max()) + 1, len(rows))
            np.minimum.at(lowest, ends, part)
            part = lowest[ends]
        part = part[part]  # and what that place knows
        if (part == before).all():
            break
    order = np.argsort(part, kind="stable")
    cuts = np.flatnonzero(np.diff(part[order])) + 1
    yield from (order[first:last] for first, last in pairwise([0, *cuts.tolist(), len(order)]))


def solve_few(rows: list[int], columns: list[int], weights: list[float]) -> tuple[list[int], float]:
    """Places of a choice of largest weight, and by how much the second best weighs less; for a handful of pairs.

    Args:
        rows: P of them.
        columns: P of them.
        weights: P of them, above 0.
    """
    choices: list[tuple[float, list[int], set[int]]] = [(0.0, [], set())]  # weight, places, rows and ~columns used
    for place, (row, column, weight) in enumerate(zip(rows, columns, weights, strict=True)):
        choices += [
            (total + weight, [*places, place], used | {row, ~column})
            for total, places, used in choices
            if row not in used and ~column not in used
        ]
    totals = [total for total, _, _ in choices]
    best = max(range(len(totals)), key=totals.__getitem__)
    return choices[best][1], totals[best] - max(*totals[:best], *totals[best + 1 :], 0.0, 0.0)


def solve_dense(weights: NDArray[np.float64]) -> NDArray[np.int64]:
    """The column of each row, -1 = none, of a choice of largest weight; (R,) int64.

    Args:
        weights: (R, C) float64, 0 or more; pairs of weight 0 are never chosen.
    """
    _, column_of, _ = lap.lapjv(weights.max() - weights, extend_cost=True)
    columns = np.asarray(column_of, np.int64)
    chosen = np.where(columns < 0, 0.0, weights[np.arange(len(columns)), columns])
    return np.where(chosen > 0, columns, -1)


def solve_sparse(
    rows: NDArray[np.int64], columns: NDArray[np.int64], weights: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Places of the pairs of a choice of largest weight, (S,) int64; for many rows and columns with few pairs.

    Args:
        rows: (P,) int64, 0 to R - 1, each at least once.
        columns: (P,) int64, 0 to C - 1, each at least once.
        weights: (P,) float64, above 0.
    """
    row_count, column_count, most = int(rows.max()) + 1, int(columns.max()) + 1, float(weights.max())
    row_numbers, column_numbers = np.arange(row_count), np.arange(column_count)
    # Each row and each column has a partner of its own that stands for "nobody". These take each other for nothing
    # where row and column are a pair, so that who is left over always finds somebody.
    i = np.concatenate([rows, row_numbers, row_count + column_numbers, row_count + columns])
    k = np.concatenate([columns, column_count + row_numbers, column_numbers, column_count + rows])
    cost = np.concatenate([most - weights, np.full(row_count + column_count + len(rows), most)])
    order = np.lexsort((k, i))
    starts = np.searchsorted(i[order], np.arange(row_count + column_count + 1))
    _, column_of, _ = lap.lapmod(row_count + column_count, cost[order], starts, k[order])
    return np.flatnonzero(np.asarray(column_of)[rows] == columns)


def is_only_best(weights: NDArray[np.float64], columns: NDArray[np.int64], tolerance: float) -> bool:
    """Whether every other choice weighs less, by more than ``tolerance``, than this one, which is best.

    To go over to another choice, rows take over columns from each other in a ring, or in a chain that starts and ends
    with "nobody", who holds the free columns. The cheapest ring is looked for with the Floyd-Warshall algorithm.

    Args:
        weights: (R, C) float64, 0 or more.
        columns: (R,) int64, of each row, -1 = none.
        tolerance: of the sum of weights.
    """
    count = len(weights)
    holds = columns >= 0
    own = np.where(holds, weights[np.arange(count), columns], 0.0)
    is_free = np.ones(weights.shape[1], np.bool_)
    is_free[columns[holds]] = False
    loss = np.full((count + 1, count + 1), np.inf)  # [i, k]: what row i loses by taking what k holds; last = nobody
    loss[:count, :count][:, holds] = own[:, None] - weights[:, columns[holds]]
    best_free = np.where(is_free, weights, 0.0).max(axis=1)
    # A row that holds nothing gains nothing from "no column", and a free column of weight 0 is no change.
    loss[:count, count] = np.where(holds | (best_free > 0), own - best_free, np.inf)
    loss[count, :count] = 0.0
    np.fill_diagonal(loss, np.inf)
    for via in range(count + 1):
        np.minimum(loss, loss[:, via, None] + loss[None, via, :], out=loss)
    return bool(np.diagonal(loss).min() > tolerance)
