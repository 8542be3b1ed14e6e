import dataclasses
import math

import numpy as np
import pytest

from evaluation.described import all_pairs, make_objects, on_circle, random_objects
from lookonce.evaluation import PairDistances, break_down, equal_error_rate, pair_distances, rates_at, roc_auc

LIMITS = {"time_gap": [1, 2, 5, 10, 30], "size_change": [1.1, 1.25, 1.5, 2], "height": [16, 32, 64, 128]}


def _value(objects, by, a, b):
    if by == "time_gap":
        return abs(round(float(objects.times_s[a] - objects.times_s[b]), 6))
    if by == "height":
        return float(min(objects.heights_px[a], objects.heights_px[b]))
    areas = [float(objects.heights_px[row]) * float(objects.widths_px[row]) for row in (a, b)]
    return math.sqrt(max(areas)) / math.sqrt(min(areas))


@pytest.mark.parametrize("by", list(LIMITS))
@pytest.mark.parametrize("seed", range(3))
def test_parts_match_all_pairs_sorted_one_by_one(by, seed):
    objects = random_objects(seed)
    counts = np.zeros((len(LIMITS[by]) + 1, 2, 4096), np.int64)
    for a, b, apart, is_same in all_pairs(objects, 1, 10):
        part = sum(_value(objects, by, a, b) >= limit for limit in LIMITS[by])
        counts[part, int(is_same), min(int(apart * 2048), 4095)] += 1
    found = break_down(objects, 1, 10, by, 0.8)
    assert [(part.genuine, part.impostor) for part in found] == [tuple(c) for c in counts.sum(axis=2)[:, ::-1].tolist()]
    for part, (impostor, genuine) in zip(found, counts, strict=True):
        pairs = PairDistances(genuine, impostor, 1, 1, 10)
        accepts, rejects = rates_at(pairs, 0.8)
        values = [part.equal_error_rate, part.roc_auc, part.genuine_within, part.impostor_within]
        expected = [equal_error_rate(pairs)[0], roc_auc(pairs), 1 - rejects, accepts]
        np.testing.assert_allclose(values, expected, atol=1e-12)


@pytest.mark.parametrize("by", list(LIMITS))
def test_parts_add_up_to_all_pairs(by):
    objects = random_objects(8)
    pairs = pair_distances(objects, 1, 10)
    parts = break_down(objects, 1, 10, by, 0.8)
    assert sum(part.genuine for part in parts) == pairs.genuine_count
    assert sum(part.impostor for part in parts) == pairs.impostor_count
    assert max(part.identities for part in parts) <= pairs.identities


def test_parts_are_named_for_their_limits():
    objects = random_objects(0)
    names = {by: [part.name for part in break_down(objects, 1, 10, by, 1)] for by in LIMITS}
    assert names["time_gap"] == ["under 1 s", "1 to 2 s", "2 to 5 s", "5 to 10 s", "10 to 30 s", "30 s and more"]
    assert names["size_change"] == ["1 to 1.1 x", "1.1 to 1.25 x", "1.25 to 1.5 x", "1.5 to 2 x", "2 x and more"]
    assert names["height"] == ["under 16 px", "16 to 32 px", "32 to 64 px", "64 to 128 px", "128 px and more"]


def test_a_limit_belongs_to_the_part_above_it():
    apart = break_down(
        make_objects(on_circle([0, 0]), [1, 1], [0, 1], times_s=[2.0000000001, 3.0]), 1, 1, "time_gap", 1
    )
    assert [part.genuine for part in apart] == [0, 1, 0, 0, 0, 0]
    height = break_down(make_objects(on_circle([0, 0]), [1, 1], [0, 1], heights_px=[16, 99]), 1, 1, "height", 1)
    assert [part.genuine for part in height] == [0, 1, 0, 0, 0]
    equal = break_down(make_objects(on_circle([0, 0]), [1, 1], [0, 1]), 1, 1, "size_change", 1)
    assert [part.genuine for part in equal] == [1, 0, 0, 0, 0]


def test_growing_and_shrinking_are_the_same_change():
    sizes = {"heights_px": [10, 20, 10], "widths_px": [10, 30, 10]}
    parts = break_down(make_objects(on_circle([0, 0, 0]), [1, 1, 1], [0, 1, 2], **sizes), 1, 1, "size_change", 1)
    assert [part.genuine for part in parts] == [0, 0, 0, 0, 2]


def test_parts_without_pairs_have_nan_rates():
    parts = break_down(make_objects(np.zeros((0, 4)), [], []), 1, 10, "height", 0.8)
    assert len(parts) == 5
    assert all(part.genuine == part.impostor == part.identities == 0 for part in parts)
    assert all(math.isnan(part.equal_error_rate) and math.isnan(part.genuine_within) for part in parts)


def test_an_unknown_aspect_is_refused():
    with pytest.raises(ValueError, match="by: expected one of time_gap, size_change, height, grid_change, got colour"):
        break_down(random_objects(0), 1, 2, "colour", 1)


def _at(grids, identities=(1, 1, 1, 2)):
    objects = make_objects(on_circle([0.0, 0.1, 0.2, 3.0]), identities, [0, 1, 2, 3])
    return dataclasses.replace(objects, grids=np.array(grids, np.int64))


def test_change_of_grid_comes_before_change_of_anchor():
    #        grid 0 anchor 1, grid 0 anchor 2, grid 1 anchor 1, grid 0 anchor 1
    parts = break_down(_at([1, 2, 1001, 1]), 1, 3, "grid_change", 0.5)
    assert [part.name for part in parts] == ["same grid and anchor", "same grid, other anchor", "other grid"]
    assert [(part.genuine, part.impostor) for part in parts] == [(0, 1), (1, 1), (2, 1)]
    assert [part.lower for part in parts] == [0, 1, 2]


def test_grids_that_are_not_known_cannot_be_broken_down_by():
    with pytest.raises(ValueError, match="grids: expected all to be known"):
        break_down(random_objects(0), 1, 2, "grid_change", 1)
    with pytest.raises(ValueError, match="grids: expected all to be known"):
        break_down(_at([1, 2, -1, 1]), 1, 2, "grid_change", 1)


def test_grids_are_checked_and_stay_aligned():
    objects = _at([1, 2, 1001, 3])
    assert objects[np.array([2, 0])].grids.tolist() == [1001, 1]
    assert random_objects(0).grids.tolist() == [-1] * len(random_objects(0))
    with pytest.raises(ValueError, match=r"grids: expected \(4,\) int64, got \(2,\) int64"):
        _at([1, 2])
