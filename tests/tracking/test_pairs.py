"""Pairs within reach: the grid finds what comparing all finds."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from lookonce.tracking.pairs import _by_grid, near_pairs


def _all(places, reach, points):
    """Row by row."""
    found = [
        (row, column)
        for row, place in enumerate(places)
        for column, point in enumerate(points)
        if abs(place[0] - point[0]) <= reach[row] and abs(place[1] - point[1]) <= reach[row]
    ]
    return [row for row, _ in found], [column for _, column in found]


def _check(places, reach, points):
    expected = _all(places.tolist(), reach.tolist(), points.tolist())
    for find in (near_pairs, _by_grid) if len(points) and len(places) else (near_pairs,):
        rows, columns = find(places, reach, points)
        assert (rows.tolist(), columns.tolist()) == expected, find.__name__


@pytest.mark.parametrize("seed", range(20))
def test_random_scenes(seed):
    rng = np.random.default_rng(seed)
    many, points = rng.integers(1, 60, 2)
    scale = 10.0 ** rng.integers(0, 5)
    places, centres = (rng.normal(0, scale, (count, 2)).astype(np.float32).astype(float) for count in (many, points))
    _check(places, rng.exponential(scale * rng.choice([0.01, 0.2, 3]), many), centres)


@pytest.mark.parametrize("seed", range(10))
def test_whole_numbers_where_many_points_lie_on_the_edge(seed):
    rng = np.random.default_rng(seed)
    places, points = rng.integers(-6, 7, (40, 2)).astype(float), rng.integers(-6, 7, (50, 2)).astype(float)
    _check(places, rng.integers(0, 5, 40).astype(float), points)


def test_rightmost_point_is_found_whatever_its_place():
    """A point at the very right was lost where the width of all, plus 1, minus 1, was not the width again."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        _check(rng.normal(0, 1e-3, (20, 2)), np.full(20, 1e-3), rng.normal(0, 1e-3, (20, 2)))


@pytest.mark.parametrize("unit", [0.1, 0.01, 1 / 3])
def test_fractions_where_many_points_lie_on_the_edge(unit):
    """Place minus reach was rounded to beyond a point that is within reach of the place."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        places, points = rng.integers(-30, 60, (40, 2)) * unit, rng.integers(-30, 60, (40, 2)) * unit
        _check(places, rng.integers(0, 30, 40) * unit, points)


SCENES = [
    pytest.param(np.full((20, 2), 7.0), np.full(20, 3.0), np.full((30, 2), 7.0), id="all-at-one-place"),
    pytest.param(np.full((5, 2), 7.0), np.zeros(5), np.array([[7.0, 7], [7, 7.001]]), id="zero-reach"),
    pytest.param(np.arange(20.0).reshape(10, 2), np.full(10, 1e9), np.arange(18.0).reshape(9, 2), id="huge-reach"),
    pytest.param(np.arange(20.0).reshape(10, 2), 10.0 ** np.arange(-5, 5), np.arange(18.0).reshape(9, 2), id="mixed"),
    pytest.param(np.zeros((3, 2)), np.ones(3), np.array([[1e6, 1e6], [0, 0], [0.5, -1]]), id="one-far-away"),
    pytest.param(np.array([[0.0, 1e6]]), np.ones(1), np.array([[0.0, 1], [0, 1e6]]), id="tall"),
    pytest.param(np.array([[50.0, -9e3]]), np.ones(1), np.array([[0.0, 1], [100, 5]]), id="place-outside"),
    pytest.param(np.array([[50.0, 3]]), np.array([2.0]), np.array([[0.0, 3], [100, 3]]), id="between-the-points"),
    pytest.param(np.zeros((0, 2)), np.zeros(0), np.ones((3, 2)), id="no-places"),
    pytest.param(np.ones((3, 2)), np.ones(3), np.zeros((0, 2)), id="no-points"),
    pytest.param(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)), id="neither"),
    pytest.param(np.ones((1, 2)), np.zeros(1), np.ones((1, 2)), id="one-of-each"),
]


@pytest.mark.parametrize(("places", "reach", "points"), SCENES)
def test_degenerate_scenes(places, reach, points):
    _check(places, reach, points)


@pytest.mark.parametrize("largest_reach", [pytest.param(50.0, id="even"), pytest.param(1e6, id="one-huge")])
def test_large_scene_takes_the_grid_and_little_memory(largest_reach):
    """20,000 by 20,000: comparing all would take gigabytes."""
    rng = np.random.default_rng(0)
    places, points = rng.uniform(0, 20_000, (20_000, 2)), rng.uniform(0, 20_000, (20_000, 2))
    reach = np.full(20_000, 50.0)
    reach[0] = largest_reach  # one that may be anywhere must not make the others look everywhere
    tracemalloc.start()
    rows, columns = near_pairs(places, reach, points)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 150e6
    assert (np.abs(places[rows] - points[columns]) <= reach[rows, None]).all()
    for row in (0, 77, 19_999):
        near = np.flatnonzero((np.abs(points - places[row]) <= reach[row]).all(axis=1))
        assert columns[rows == row].tolist() == near.tolist()
