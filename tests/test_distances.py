"""Distances: exact, and of a pair alone."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.distances import COARSE, FINE, Quantized, distances, quantize, squared_distances


def _units(rng, count, size):
    rows = rng.normal(size=(count, size))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def test_quantized_values_are_whole_numbers_near_the_descriptors():
    rows = _units(np.random.default_rng(0), 20, 128)
    quantized = quantize(rows).units
    assert quantized.dtype == np.float64
    np.testing.assert_array_equal(quantized, np.rint(quantized))
    assert np.abs(quantized / FINE.scale - rows).max() <= 0.5 / FINE.scale


@pytest.mark.parametrize("size", [2, 3, 128, 608, 2048])
def test_distances_equal_whole_number_arithmetic(size):
    rng = np.random.default_rng(size)
    a, b = quantize(_units(rng, 5, size)).units, quantize(_units(rng, 7, size)).units
    b[0], b[1] = a[0], -a[1]  # nothing apart, and as far apart as can be
    expected = [[sum((int(x) - int(y)) ** 2 for x, y in zip(row, other, strict=True)) for other in b] for row in a]
    result = squared_distances(Quantized.of(a), Quantized.of(b))
    assert [[int(value) for value in row] for row in result] == expected
    np.testing.assert_array_equal(result, np.rint(result))
    assert result[0, 0] == 0


def test_medians_of_three_stay_exact():
    """A median of unit vectors may be longer than 1; its products still fit."""
    longest = np.full((1, 2048), 1 / np.sqrt(2048), np.float32) * np.float32(np.sqrt(2))
    a, b = quantize(longest), quantize(-longest)
    expected = sum((int(x) - int(y)) ** 2 for x, y in zip(a.units[0], b.units[0], strict=True))
    assert int(squared_distances(a, b)[0, 0]) == expected


@pytest.mark.parametrize("seed", range(10))
def test_distance_of_a_pair_does_not_depend_on_other_pairs(seed):
    """Rows, their number, their order and memory layout change how a matrix product sums; the bytes stay."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 700))
    a, b = quantize(_units(rng, int(rng.integers(1, 40)), size)), quantize(_units(rng, int(rng.integers(1, 40)), size))
    together = squared_distances(a, b)
    for _ in range(30):
        i, j = rng.integers(together.shape)
        alone = squared_distances(a.part(slice(i, i + 1)), b.part(slice(j, j + 1)))
        assert alone.tobytes() == together[i : i + 1, j : j + 1].tobytes()
    rows, columns = rng.permutation(together.shape[0]), rng.permutation(together.shape[1])
    shuffled = squared_distances(a.part(rows), Quantized.of(np.asfortranarray(b.units[columns])))
    assert shuffled.tobytes() == together[rows][:, columns].tobytes()
    np.testing.assert_array_equal(squared_distances(b, a).T, together)


def test_rounding_moves_a_distance_by_less_than_a_millionth():
    rng = np.random.default_rng(3)
    a, b = _units(rng, 30, 608), _units(rng, 30, 608)
    exact = np.linalg.norm(np.float64(a)[:, None] - np.float64(b)[None], axis=2)
    assert np.abs(distances(quantize(a), quantize(b)) - exact).max() < 1e-6


def test_coarse_precision_is_exact_in_float32_and_close_to_the_descriptors():
    """Sums of products stay below 2^24, so rows and their order change nothing; medians of three fit as well."""
    rng = np.random.default_rng(5)
    rows, others = _units(rng, 30, 128), _units(rng, 40, 128)
    others[0] = rows[0]
    a, b = quantize(rows, COARSE), quantize(others, COARSE)
    assert a.units.dtype == a.squared_lengths.dtype == np.float32
    expected = [
        [sum((int(x) - int(y)) ** 2 for x, y in zip(one, two, strict=True)) for two in b.units] for one in a.units
    ]
    np.testing.assert_array_equal(squared_distances(a, b), expected)
    exact = np.linalg.norm(np.float64(rows)[:, None] - np.float64(others)[None], axis=2)
    wrong = np.sqrt(expected) / COARSE.scale - exact
    assert np.sqrt((wrong**2).mean()) < 3e-4
    assert np.abs(wrong).max() < 2e-3
    np.testing.assert_allclose(distances(a, b), exact, atol=2e-3)
    # A median is longest where each value is in two of three: 1.5 times the square of the length.
    x = np.full((1, 683), 1 / np.sqrt(2 * 683), np.float32)
    three = [quantize(np.hstack(parts), COARSE).units for parts in ([x, x, 0 * x], [x, 0 * x, x], [0 * x, x, x])]
    longest = np.median(three, axis=0).astype(np.float32)
    whole = longest.astype(np.float64) @ longest.T.astype(np.float64)
    assert 1.4 * COARSE.scale**2 < whole < 2**24
    assert longest @ longest.T == whole


def test_no_rows_give_no_distances():
    none, some = Quantized.of(np.zeros((0, 4))), Quantized.of(np.ones((3, 4)))
    for measure in (squared_distances, distances):
        assert measure(none, some).shape == (0, 3)
        assert measure(some, none).shape == (3, 0)


def test_equal_descriptors_are_at_exactly_zero_and_opposite_ones_at_two():
    rows = _units(np.random.default_rng(4), 5, 128)
    apart = distances(quantize(rows), quantize(np.concatenate([rows, -rows])))
    assert (np.diag(apart) == 0).all()
    np.testing.assert_allclose(np.diag(apart[:, 5:]), 2, atol=1e-6)
