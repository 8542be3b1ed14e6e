"""Greedy assignment equals sorting all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.tracking.greedy import assign_greedily


def _plain(cost, limit):
    """All pairs by cost, then row, then column; each row and column once."""
    row_of = [-1] * cost.shape[1]
    for value, row, column in sorted((c, i, j) for (i, j), c in np.ndenumerate(cost)):
        if value <= limit and row not in row_of and row_of[column] < 0:
            row_of[column] = row
    return row_of


def _matrices():
    rng = np.random.default_rng(8)
    for number in range(300):
        shape = rng.integers(0, 9, 2)
        match number % 4:
            case 0:
                cost = rng.uniform(0, 1, shape)
            case 1:
                cost = rng.integers(0, 3, shape).astype(np.float64)  # many ties
            case 2:
                cost = np.where(rng.uniform(size=shape) < 0.5, np.inf, rng.integers(0, 4, shape))
            case _:
                cost = np.full(shape, float(rng.integers(0, 2)))
        yield cost, [0.5, 1.0, 2.0, np.inf][number // 4 % 4]


def test_random_matrices_equal_a_sorted_list_of_pairs():
    matched = 0
    for cost, limit in _matrices():
        before = cost.copy()
        result = assign_greedily(cost, limit)
        assert result.tolist() == _plain(cost, limit), (cost, limit)
        np.testing.assert_array_equal(cost, before)
        matched += int((result >= 0).sum())
    assert matched > 300


def test_large_matrix_equals_a_sorted_list_of_pairs():
    cost = np.random.default_rng(2).integers(0, 50, (60, 70)).astype(np.float64)
    assert assign_greedily(cost, 40).tolist() == _plain(cost, 40)


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_no_rows_or_columns(shape):
    assert assign_greedily(np.zeros(shape), 1.0).tolist() == [-1] * shape[1]


def test_greedy_differs_from_the_least_sum():
    """The pair of cost 1 is taken although it forces the pair of cost 9; the least sum would be 3 + 3."""
    assert assign_greedily(np.array([[3.0, 1.0], [9.0, 3.0]]), 10).tolist() == [1, 0]


def test_cost_at_the_limit_is_taken_and_above_is_not():
    cost = np.array([[1.0]])
    assert assign_greedily(cost, 1.0).tolist() == [0]
    assert assign_greedily(cost, np.nextafter(1.0, 0)).tolist() == [-1]


def test_ties_go_to_the_lowest_row_then_the_lowest_column():
    assert assign_greedily(np.zeros((2, 3)), 0).tolist() == [0, 1, -1]
    assert assign_greedily(np.zeros((3, 2)), 0).tolist() == [0, 1]


@pytest.mark.parametrize("place", [(0, 0), (1, 2), (2, 1)])
def test_nan_is_refused_wherever_it_is(place):
    cost = np.arange(9, dtype=np.float64).reshape(3, 3)
    cost[place] = np.nan
    with pytest.raises(ValueError, match="cost: expected numbers, got NaN"):
        assign_greedily(cost, 100)
