import numpy as np
import pytest

from evaluation.described import gallery, make_objects, on_circle, random_objects
from lookonce.evaluation import nearest_distances
from lookonce.make.probing import choose_queries, nearest

CONFUSED_FRAMES = [1, 2, 15, 16, 29]
GAPS = 3, 12  # from one confused frame no other one of the same object is in reach


def _scene(confused=3):
    """Six objects over 30 frames at 2 frames per second, of which the first ones now and then look like the last."""
    identities, frames = np.tile(np.arange(6), 30), np.repeat(np.arange(30), 6)
    angles = identities + 0.001 * frames
    is_confused = (identities < confused) & np.isin(frames, CONFUSED_FRAMES)
    angles[is_confused] = 5.2 + 0.001 * frames[is_confused]
    return make_objects(on_circle(angles), identities, frames, times_s=frames / 2)


def _is_wrong(objects, rows):
    return [objects.identities[gallery(objects, row, *GAPS)[0]] != objects.identities[row] for row in rows]


def test_neighbours_are_the_nearest_with_two_moments_of_each_identity():
    #                       query  1    2    2    2    3    other sequence
    objects = make_objects(
        on_circle([0.0, 0.3, 0.1, 0.11, 0.2, 0.25, 0.4, 0.0]),
        [1, 1, 2, 2, 2, 2, 3, 2],
        [0, 5, 5, 6, 7, 8, 5, 5],
        sequences=[0] * 7 + [1],
        times_s=[0, 5, 5, 5.5, 7, 8, 5, 5],
    )
    assert nearest(objects, 0, 1, 10, 7).tolist() == [2, 4, 1, 6]  # 3 is too near 2 in time, 5 would be the third
    assert nearest(objects, 0, 1, 10, 2).tolist() == [2, 4]
    assert nearest(objects, 0, 1, 10, 0).tolist() == []
    assert nearest(objects, 0, 6, 10, 7).tolist() == [3, 4]
    assert nearest(objects, 7, 1, 10, 7).tolist() == []


def test_first_neighbour_is_the_nearest_of_all():
    objects = random_objects(3)
    for query in range(len(objects)):
        assert nearest(objects, query, 1, 12, 1).tolist() == gallery(objects, query, 1, 12)[:1]


def test_second_half_is_the_worst_cases():
    objects = _scene()
    rows = choose_queries(objects, *GAPS, 6, seed=0)
    assert len(set(rows.tolist())) == 6
    assert all(_is_wrong(objects, rows[3:]))
    assert sorted(objects.identities[rows[3:]].tolist()) == [0, 1, 2]
    queries, genuine, impostor = nearest_distances(objects, *GAPS)
    lead = dict(zip(queries.tolist(), (genuine - impostor).tolist(), strict=True))
    for row in rows[3:].tolist():
        own = [lead[other] for other in lead if objects.identities[other] == objects.identities[row]]
        assert lead[row] == max(own)


def test_every_identity_comes_before_one_comes_twice():
    objects = _scene()
    for count in (6, 7, 12):
        seen = np.bincount(objects.identities[choose_queries(objects, *GAPS, count, seed=1)], minlength=6)
        assert seen.max() - seen.min() <= 1


def test_without_mistakes_all_are_ordinary_and_spread_in_time():
    objects = _scene(confused=0)
    rows = choose_queries(objects, *GAPS, 4, seed=2)
    assert not any(_is_wrong(objects, rows))
    assert np.diff(np.sort(objects.times_s[rows])).min() > 2


def test_worst_cases_of_one_object_are_of_different_moments():
    objects = _scene(confused=1)
    rows = choose_queries(objects, *GAPS, 6, seed=0)[3:]
    assert objects.identities[rows].tolist() == [0, 0, 0]
    assert np.diff(np.sort(objects.times_s[rows])).min() >= 1


def test_same_seed_same_choice():
    objects = random_objects(1)
    first = choose_queries(objects, 1, 12, 10, seed=5).tolist()
    assert choose_queries(objects, 1, 12, 10, seed=5).tolist() == first
    assert any(choose_queries(objects, 1, 12, 10, seed=seed).tolist() != first for seed in range(5))


@pytest.mark.parametrize(
    ("identities", "frames", "count", "expected"),
    [
        pytest.param([], [], 4, 0, id="no-objects"),
        pytest.param([1, 2], [0, 1], 4, 0, id="nobody-comes-again"),
        pytest.param([1, 1, 2], [0, 1, 1], 4, 2, id="fewer-than-asked"),
        pytest.param([1, 1, 2], [0, 1, 1], 0, 0, id="none-asked"),
        pytest.param([1, 1, 2], [0, 1, 1], 1, 1, id="one-asked"),
    ],
)
def test_few_candidates(identities, frames, count, expected):
    objects = make_objects(on_circle(np.arange(len(identities))), identities, frames)
    assert len(choose_queries(objects, 1, 5, count, seed=0)) == expected
