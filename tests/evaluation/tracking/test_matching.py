"""The best choice of pairs, and which one of several best ones."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.assignment import components, is_only_best, solve_dense
from lookonce.evaluation.tracking.matching import best_sum, choose
from lookonce.evaluation.tracking.shortest_paths import assign_as_scipy


def all_choices(weights: np.ndarray) -> dict[frozenset[tuple[int, int]], float]:
    """Every one-to-one choice of pairs of weight above 0, with its sum."""
    found: dict[frozenset[tuple[int, int]], float] = {}

    def extend(row: int, chosen: tuple[tuple[int, int], ...], total: float) -> None:
        if row == len(weights):
            found[frozenset(chosen)] = total
            return
        extend(row + 1, chosen, total)
        for column in np.flatnonzero(weights[row]).tolist():
            if all(column != taken for _, taken in chosen):
                extend(row + 1, (*chosen, (row, column)), total + weights[row, column])

    extend(0, (), 0.0)
    return found


def table(seed: int, most: int) -> np.ndarray:
    """Small whole numbers, which tie, or any; some pairs missing."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, most, 2))
    weights = (
        rng.integers(0, 4, shape).astype(np.float64) if seed % 2 else rng.random(shape) * (rng.random(shape) < 0.6)
    )
    return weights


def test_choice_is_best_and_said_to_be_sure_only_where_it_is():
    ties = 0
    for seed in range(600):
        weights = table(seed, 5)
        rows, columns = np.nonzero(weights)
        chosen, is_sure = choose(rows, columns, weights[rows, columns])
        choices = all_choices(weights)
        best = [choice for choice, total in choices.items() if total > max(choices.values()) - 1e-9]
        pairs = list(zip(rows.tolist(), columns.tolist(), strict=True))
        assert {pairs[place] for place in chosen} in best
        for pair, sure in zip(pairs, is_sure, strict=True):
            assert not sure or sum(pair in choice for choice in best) in (0, len(best))
        assert is_sure.all() or len(best) > 1
        ties += len(best) > 1
    assert ties > 50


def test_only_best_is_told_from_one_of_several():
    for seed in range(400):
        weights = table(seed, 5)
        totals = sorted(all_choices(weights).values())
        is_only = len(totals) < 2 or totals[-2] < totals[-1] - 1e-9
        assert is_only_best(weights, solve_dense(weights), 1e-9) == is_only, seed


@pytest.mark.parametrize("kind", ["whole", "any", "kept"])
def test_scipys_assignment_is_found_ties_included(kind):
    scipy = pytest.importorskip("scipy.optimize", reason="SciPy is absent: pip install scipy")
    rng = np.random.default_rng(0)
    for _ in range(700):
        shape = tuple(rng.integers(1, 14, 2))
        cost = -rng.random(shape) if kind == "any" else -rng.integers(0, 4, shape).astype(np.float64)
        if kind == "kept":
            cost = cost / 8 - 1000.0 * (rng.random(shape) < 0.2)
        for got, expected in zip(assign_as_scipy(cost), scipy.linear_sum_assignment(cost), strict=True):
            np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize("shape", [(60, 60), (30, 200), (200, 30), (3, 4), (1, 9)])
def test_choice_of_many_has_the_weight_that_scipy_finds(shape):
    scipy = pytest.importorskip("scipy.optimize", reason="SciPy is absent: pip install scipy")
    for seed in range(20):
        rng = np.random.default_rng(seed)
        weights = rng.integers(0, 30, shape) * (rng.random(shape) < 0.2).astype(np.float64)
        rows, columns = np.nonzero(weights)
        chosen, _ = choose(rows, columns, weights[rows, columns])
        assert len(set(rows[chosen])) == len(set(columns[chosen])) == len(chosen)
        expected = weights[scipy.linear_sum_assignment(-weights)].sum()
        assert weights[rows[chosen], columns[chosen]].sum() == expected
        assert best_sum(rows, columns, weights[rows, columns]) == expected


def test_parts_share_no_row_and_no_column():
    rows, columns = np.array([0, 0, 1, 2, 3, 4, 4]), np.array([7, 8, 8, 1, 2, 2, 3])
    assert [part.tolist() for part in components(rows, columns)] == [[0, 1, 2], [3], [4, 5, 6]]
    assert list(components(rows[:0], columns[:0])) == []
    long = np.arange(200)
    (part,) = components(np.repeat(long, 2)[1:], np.repeat(long, 2)[:-1])
    assert len(part) == 399


def test_no_pairs_give_no_choice():
    none = np.zeros(0, np.int64)
    chosen, is_sure = choose(none, none, np.zeros(0))
    assert len(chosen) == len(is_sure) == 0
    assert best_sum(none, none, np.zeros(0)) == 0
