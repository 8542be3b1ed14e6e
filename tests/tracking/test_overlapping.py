"""Boxes over each other, against every box compared with every other."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.boxes import iou
from lookonce.tracking import overlapping
from lookonce.tracking.overlapping import Overlaps, keep_best, overlaps_of, thinned
from lookonce.tracking.pairs import TooManyPairsError


@pytest.fixture(params=[1 << 20, -1], ids=["sweep", "grid"], autouse=True)
def _way_of_finding(request, monkeypatch):
    monkeypatch.setattr(overlapping, "_MOST_SWEPT", request.param)


def _random_boxes(rng, count, area=300.0):
    corner = rng.uniform(0, area, (count, 2))
    return np.concatenate([corner, corner + rng.uniform(5, 80, (count, 2))], axis=1)


def _check(boxes, least=0.2):
    matrix = iou(boxes, boxes)
    expected = [(a, b) for a in range(len(boxes)) for b in range(a + 1, len(boxes)) if matrix[a, b] > least]
    found = overlaps_of(boxes, least)
    pairs = list(zip(found.a.tolist(), found.b.tolist(), strict=True))
    assert sorted(pairs) == expected
    np.testing.assert_allclose(found.overlap, [matrix[a, b] for a, b in pairs], rtol=1e-12)


@pytest.mark.parametrize("count", [0, 1, 2, 20, 127, 128, 129, 200])
@pytest.mark.parametrize("seed", range(3))
def test_pairs_are_those_of_all_with_all(seed, count):
    boxes = _random_boxes(np.random.default_rng(seed), count)
    for least in (0.0, 0.2, 0.5):
        _check(boxes, least)


@pytest.mark.parametrize("count", [5, 150])
@pytest.mark.parametrize(
    "boxes",
    [
        pytest.param(lambda n: np.tile([[3.0, 4, 30, 50]], (n, 1)), id="one-place"),
        pytest.param(lambda n: np.array([[0.0, 0, 10 + i, 10 + i] for i in range(n)]), id="nested"),
        pytest.param(lambda n: np.array([[10.0 * i, 0, 10.0 * i + 10, 10] for i in range(n)]), id="touching"),
        pytest.param(lambda n: np.array([[0.0, i, 1000, i + 1] for i in range(n)]), id="flat"),
        pytest.param(lambda n: np.array([[0.0, 0, 1e6, 1e6]] + [[i, i, i + 9.0, i + 9] for i in range(n)]), id="huge"),
    ],
)
def test_degenerate_boxes(boxes, count):
    _check(boxes(count))


def test_above_keeps_only_more():
    overlaps = Overlaps(np.array([0, 1]), np.array([2, 3]), np.array([0.5, 0.6]))
    above = overlaps.above(0.5)
    assert (above.a.tolist(), above.b.tolist(), above.overlap.tolist()) == ([1], [3], [0.6])


def _plain_best(pairs, order, is_wanted, is_set):
    stays = []
    for row in order:
        rivals = {b for a, b in pairs if a == row} | {a for a, b in pairs if b == row}
        if is_wanted[row] and not is_set[row] and not any(is_set[other] or other in stays for other in rivals):
            stays.append(row)
    return [row in stays for row in range(len(order))]


@pytest.mark.parametrize("seed", range(20))
def test_best_are_kept_as_one_by_one(seed):
    rng = np.random.default_rng(seed)
    overlaps = overlaps_of(_random_boxes(rng, 40, 150.0), 0.3)
    order, is_wanted, is_set = rng.permutation(40), rng.random(40) < 0.7, rng.random(40) < 0.2
    pairs = list(zip(overlaps.a.tolist(), overlaps.b.tolist(), strict=True))
    expected = _plain_best(pairs, order.tolist(), is_wanted, is_set)
    assert keep_best(overlaps, order.tolist().index, is_wanted, is_set).tolist() == expected


@pytest.mark.parametrize("limit", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("seed", range(3))
def test_boxes_are_thinned_as_the_best_are_kept(seed, limit):
    rng = np.random.default_rng(seed)
    boxes, order, is_wanted = _random_boxes(rng, 200, 150.0), rng.permutation(200), rng.random(200) < 0.7
    kept = keep_best(overlaps_of(boxes, limit), order.tolist().index, is_wanted, np.zeros(200, np.bool_))
    assert thinned(boxes, order, is_wanted, limit).tolist() == kept.tolist()


def test_too_many_pairs_are_refused():
    boxes = _random_boxes(np.random.default_rng(0), 300, 10.0)
    with pytest.raises(TooManyPairsError):
        overlaps_of(boxes, 0.2, 5_000)
    assert len(overlaps_of(boxes, 0.2, 1_000_000).a) > 5_000


def test_who_yields_makes_nobody_yield():
    """The best box takes the second's place; the third overlaps only the second and stays."""
    overlaps = Overlaps(np.array([0, 1]), np.array([1, 2]), np.array([0.7, 0.7]))
    every, nobody = np.ones(3, np.bool_), np.zeros(3, np.bool_)
    assert keep_best(overlaps, [0, 1, 2].index, every, nobody).tolist() == [True, False, True]
    assert keep_best(overlaps, [1, 0, 2].index, every, nobody).tolist() == [False, True, False]
    is_set = np.array([True, False, False])
    assert keep_best(overlaps, [1, 0, 2].index, every, is_set).tolist() == [False, False, True]


def test_nobody_wanted_and_nobody_there():
    none = overlaps_of(np.zeros((0, 4)), 0.2)
    assert keep_best(none, [].index, np.zeros(0, np.bool_), np.zeros(0, np.bool_)).shape == (0,)
