"""Distances: exact, and of a pair alone."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.tracking.distance import SCALE, quantize, squared_distances, squared_lengths


def _units(rng, count, size):
    rows = rng.normal(size=(count, size))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def _distances(a, b):
    return squared_distances(a, b, squared_lengths(a), squared_lengths(b))


def test_quantized_values_are_whole_numbers_near_the_descriptors():
    rows = _units(np.random.default_rng(0), 20, 128)
    quantized = quantize(rows)
    assert quantized.dtype == np.float64
    np.testing.assert_array_equal(quantized, np.rint(quantized))
    assert np.abs(quantized / SCALE - rows).max() <= 0.5 / SCALE


@pytest.mark.parametrize("size", [2, 3, 128, 608, 2048])
def test_distances_equal_whole_number_arithmetic(size):
    rng = np.random.default_rng(size)
    a, b = quantize(_units(rng, 5, size)), quantize(_units(rng, 7, size))
    b[0], b[1] = a[0], -a[1]  # nothing apart, and as far apart as can be
    expected = [[sum((int(x) - int(y)) ** 2 for x, y in zip(row, other, strict=True)) for other in b] for row in a]
    result = _distances(a, b)
    assert [[int(value) for value in row] for row in result] == expected
    np.testing.assert_array_equal(result, np.rint(result))
    assert result[0, 0] == 0


def test_medians_of_three_stay_exact():
    """A median of unit vectors may be longer than 1; its products still fit."""
    longest = np.full((1, 2048), 1 / np.sqrt(2048), np.float32) * np.float32(np.sqrt(2))
    a, b = quantize(longest), quantize(-longest)
    assert int(_distances(a, b)[0, 0]) == sum((int(x) - int(y)) ** 2 for x, y in zip(a[0], b[0], strict=True))


@pytest.mark.parametrize("seed", range(10))
def test_distance_of_a_pair_does_not_depend_on_other_pairs(seed):
    """Rows, their number, their order and memory layout change how a matrix product sums; the bytes stay."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 700))
    a, b = quantize(_units(rng, int(rng.integers(1, 40)), size)), quantize(_units(rng, int(rng.integers(1, 40)), size))
    together = _distances(a, b)
    for _ in range(30):
        i, j = rng.integers(len(a)), rng.integers(len(b))
        alone = _distances(a[i : i + 1], b[j : j + 1])
        assert alone.tobytes() == together[i : i + 1, j : j + 1].tobytes()
    rows, columns = rng.permutation(len(a)), rng.permutation(len(b))
    shuffled = _distances(a[rows], np.asfortranarray(b[columns]))
    assert shuffled.tobytes() == together[rows][:, columns].tobytes()
    np.testing.assert_array_equal(_distances(b, a).T, together)


def test_rounding_moves_a_distance_by_less_than_a_millionth():
    rng = np.random.default_rng(3)
    a, b = _units(rng, 30, 608), _units(rng, 30, 608)
    exact = np.linalg.norm(np.float64(a)[:, None] - np.float64(b)[None], axis=2)
    assert np.abs(np.sqrt(_distances(quantize(a), quantize(b))) / SCALE - exact).max() < 1e-6


def test_no_rows_give_no_distances():
    none, some = np.zeros((0, 4)), np.ones((3, 4))
    assert _distances(none, some).shape == (0, 3)
    assert _distances(some, none).shape == (3, 0)
