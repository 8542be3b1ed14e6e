"""The best choice among sparse pairs, against SciPy's on the full matrix."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from lookonce.tracking.components import assign_best


def _best_sum(rows, columns, gains):
    """The largest sum of gains, from a dense matrix."""
    matrix = np.zeros((int(rows.max()) + 1, int(columns.max()) + 1))
    matrix[rows, columns] = gains
    return matrix[linear_sum_assignment(matrix, maximize=True)].sum()


def _check(rows, columns, gains):
    places = assign_best(rows, columns, gains)
    assert places.dtype == np.int64
    assert (np.diff(places) > 0).all()
    assert len(set(rows[places].tolist())) == len(set(columns[places].tolist())) == len(places)
    assert gains[places].sum() == pytest.approx(_best_sum(rows, columns, gains), rel=1e-9)
    assert assign_best(rows, columns, gains).tolist() == places.tolist()


def _random_pairs(rng, row_count, column_count, share):
    rows, columns = np.nonzero(rng.random((row_count, column_count)) < share)
    return rows, columns


@pytest.mark.parametrize("share", [0.01, 0.03, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("seed", range(8))
def test_random_graphs(seed, share):
    rng = np.random.default_rng(seed)
    rows, columns = _random_pairs(rng, *rng.integers(1, 60, 2), share)
    if len(rows):
        _check(rows, columns, rng.exponential(3.0, len(rows)))


@pytest.mark.parametrize("seed", range(8))
def test_equal_gains(seed):
    """Whole gains: many choices are equally good, and some of them are hard to tell apart."""
    rng = np.random.default_rng(seed)
    rows, columns = _random_pairs(rng, 40, 40, 0.1)
    _check(rows, columns, rng.integers(1, 4, len(rows)).astype(float))


@pytest.mark.parametrize("seed", range(3))
def test_sure_pairs_beside_weak_ones(seed):
    """Gains from nearly nothing to those of pairs that are safe."""
    rng = np.random.default_rng(seed)
    rows, columns = _random_pairs(rng, 50, 50, 0.08)
    _check(rows, columns, rng.choice([1e-9, 0.3, 5.0, 50.0], len(rows)) * rng.uniform(0.5, 1, len(rows)))


def test_one_dense_component():
    rows, columns = np.divmod(np.arange(200 * 200), 200)
    _check(rows, columns, np.random.default_rng(0).uniform(0.1, 9, len(rows)))


@pytest.mark.parametrize(("row_count", "column_count"), [(400, 400), (200, 700)])
def test_one_large_component_is_solved_as_sparse(row_count, column_count):
    """More entries than a matrix is made for."""
    rng = np.random.default_rng(1)
    rows, columns = _random_pairs(rng, row_count, column_count, 0.02)
    _check(rows, columns, rng.uniform(0.1, 9, len(rows)))


def test_chain_where_the_greedy_choice_is_wrong():
    rows, columns = np.array([0, 0, 1]), np.array([0, 1, 0])
    assert assign_best(rows, columns, np.array([5.0, 4.0, 4.0])).tolist() == [1, 2]
    assert assign_best(rows, columns, np.array([9.0, 4.0, 4.0])).tolist() == [0]


def test_no_pairs_and_one_pair():
    none = np.zeros(0, np.int64)
    assert assign_best(none, none, np.zeros(0)).tolist() == []
    assert assign_best(np.array([4]), np.array([7]), np.array([0.1])).tolist() == [0]


def test_numbers_of_rows_and_columns_do_not_matter():
    """Rows and columns are names: gaps between them change nothing."""
    rng = np.random.default_rng(2)
    rows, columns = _random_pairs(rng, 30, 30, 0.2)
    gains = rng.exponential(1.0, len(rows))
    expected = assign_best(rows, columns, gains).tolist()
    assert assign_best(rows * 3 + 100, columns + 5, gains).tolist() == expected


@pytest.mark.parametrize(("rows", "columns"), [(4, 2), (2, 4), (3, 2), (2, 2), (9, 8), (1, 5)])
def test_of_equally_good_choices_the_lowest_are_taken(rows, columns):
    row, column = np.divmod(np.arange(rows * columns), columns)
    places = assign_best(row, column, np.ones(rows * columns))
    fewer = min(rows, columns)
    assert sorted(row[places].tolist()) == list(range(fewer))
    assert sorted(column[places].tolist()) == list(range(fewer))
