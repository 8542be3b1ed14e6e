"""Who is who in each frame: the choice of pairs of largest weight, one to one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.assignment import (
    TOLERANCE,
    components,
    is_only_best,
    settle,
    solve_dense,
    solve_few,
    solve_sparse,
)
from lookonce.evaluation.tracking.overlaps import Pairs, Scene
from lookonce.evaluation.tracking.shortest_paths import assign_as_scipy

__all__ = ["best_pairs", "best_sum", "choose", "solve_part"]

_MANY = 64  # rows: with more it takes longer to see whether a choice is the only one than to choose as SciPy does
_FEW = 6  # pairs: up to 21 choices if they form a chain, 13 if they form a block


def best_pairs(scene: Scene, pairs: Pairs, weights: NDArray[np.float64]) -> NDArray[np.int64]:
    """Places of the pairs chosen, (S,) int64, rising: in each frame those whose weights have the largest sum.

    Of several equally good choices the one that SciPy makes of the frame's whole table, rows and columns in the given
    order; it depends on that order.

    Args:
        scene: whose pairs they are.
        pairs: P pairs of whole frames.
        weights: (P,) float64, above 0; pairs that are not there weigh 0 and are never chosen.
    """
    chosen, is_sure = choose(pairs.truths, pairs.results, weights)
    if is_sure.all():
        return chosen
    unsure = np.unique(pairs.frames[~is_sure])
    redone = [_as_scipy(scene, pairs, weights, int(frame)) for frame in unsure]
    return np.sort(np.concatenate([chosen[~np.isin(pairs.frames[chosen], unsure)], *redone]))


def choose(
    rows: NDArray[np.int64], columns: NDArray[np.int64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Places of the pairs of a best choice, (S,) int64, rising, and which pairs (P,) bool are surely in all or in none.

    Args:
        rows: (P,) int64, rising.
        columns: (P,) int64.
        weights: (P,) float64, above 0.
    """
    is_sure = np.ones(len(rows), np.bool_)
    settled, open_pairs = settle(rows, columns, weights, TOLERANCE * float(weights.max(initial=0.0)))
    chosen = [settled]
    for part in components(rows[open_pairs], columns[open_pairs]):
        places = open_pairs[part]
        best, is_only = solve_part(rows[places].tolist(), columns[places].tolist(), weights[places].tolist())
        chosen.append(places[best])
        is_sure[places] = is_only
    return np.sort(np.concatenate(chosen)), is_sure


def best_sum(rows: NDArray[np.int64], columns: NDArray[np.int64], weights: NDArray[np.float64]) -> float:
    """The largest weight that a choice of pairs can have, also of very many rows and columns.

    Args:
        rows: (P,) int64, rising.
        columns: (P,) int64.
        weights: (P,) float64, above 0.
    """
    settled, open_pairs = settle(rows, columns, weights, TOLERANCE * float(weights.max(initial=0.0)))
    total = float(weights[settled].sum())
    for part in components(rows[open_pairs], columns[open_pairs]):
        places = open_pairs[part]
        _, row = np.unique(rows[places], return_inverse=True)
        _, column = np.unique(columns[places], return_inverse=True)
        total += float(weights[places][solve_sparse(row, column, weights[places])].sum())
    return total


def solve_part(rows: list[int], columns: list[int], weights: list[float]) -> tuple[list[int], bool]:
    """Places of a best choice of pairs that hang together, and whether it is surely the only one.

    Args:
        rows: P of them, P > 0.
        columns: P of them.
        weights: P of them, above 0.
    """
    tolerance = TOLERANCE * max(weights)
    if len(rows) <= _FEW:
        places, ahead = solve_few(rows, columns, weights)
        return places, ahead > tolerance
    row_names, row = np.unique(rows, return_inverse=True)
    column_names, column = np.unique(columns, return_inverse=True)
    table = np.zeros((len(row_names), len(column_names)))
    table[row, column] = weights
    column_of = solve_dense(table)
    is_only = len(table) <= _MANY and is_only_best(table, column_of, tolerance)
    return np.flatnonzero(column_of[row] == column).tolist(), is_only


def _as_scipy(scene: Scene, pairs: Pairs, weights: NDArray[np.float64], frame: int) -> NDArray[np.int64]:
    first, last = np.searchsorted(pairs.frames, [frame, frame + 1])
    truth, result = scene.truth.starts[frame : frame + 2], scene.result.starts[frame : frame + 2]
    rows, columns = pairs.truths[first:last] - truth[0], pairs.results[first:last] - result[0]
    cost = np.zeros((truth[1] - truth[0], result[1] - result[0]))
    cost[rows, columns] = -weights[first:last]
    column_of = np.full(len(cost), -1, np.int64)
    chosen_rows, chosen_columns = assign_as_scipy(cost)
    column_of[chosen_rows] = chosen_columns
    chosen: NDArray[np.int64] = first + np.flatnonzero(column_of[rows] == columns)
    return chosen
