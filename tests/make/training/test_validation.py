"""The held-out measure: means over the sources, of pairs that are known."""

from __future__ import annotations

import numpy as np
import pytest

from datasets.making import refusal
from evaluation.described import make_objects, on_circle
from lookonce.errors import ConfigError
from lookonce.evaluation import DescribedObjects
from lookonce.make.training.validation import Validation, check_comparable, validate

ALWAYS = (0, 2**31 - 1)


def for_ever(count: int) -> np.ndarray:
    return np.tile(np.array(ALWAYS), (count, 1))


def in_one_scene(objects: DescribedObjects, lifetimes: np.ndarray) -> Validation:
    return validate(objects, lifetimes, np.zeros(len(lifetimes), np.int64))


def test_rate_and_threshold_are_means_over_the_sources():
    """One source is perfect, in the other one of two objects is found where the other was; lengths do not matter."""
    good = on_circle([0.0, 0.0, 1.0, 1.0])
    mixed = on_circle([0.0, 1.0, 1.0, 0.0])
    objects = make_objects(
        np.concatenate([good, *[mixed] * 5]),
        [0, 0, 1, 1] + [2, 2, 3, 3] * 5,
        [0, 1, 0, 1] + [frame for n in range(5) for frame in (2 * n, 2 * n + 1) * 2],
        [0] * 4 + [1] * 20,
    )
    both = in_one_scene(objects, for_ever(4))
    alone = [in_one_scene(objects[objects.sequences == source], for_ever(4)) for source in (0, 1)]
    assert alone[0].error_rate == 0
    assert alone[1].error_rate > 0.4
    assert both.error_rate == pytest.approx((alone[0].error_rate + alone[1].error_rate) / 2)
    assert both.threshold == pytest.approx((alone[0].threshold + alone[1].threshold) / 2)
    assert both.pairs == alone[0].pairs + alone[1].pairs
    assert both.identities == 4


def test_pairs_of_one_frame_do_not_count():
    objects = make_objects(on_circle([0.0, 0.0, 1.0, 1.0]), [0, 0, 1, 1], [0, 1, 0, 1])
    # two of one object, and 0 at frame 0 with 1 at frame 1 and so on
    assert in_one_scene(objects, for_ever(2)).pairs == 4


def test_tracks_that_may_be_one_object_are_not_held_against_each_other():
    """Pieces of one object look alike, and would have counted as two that were mistaken for each other."""
    angles = [0.0, 0.01, 0.0, 0.01, 1.5, 1.51]
    objects = make_objects(on_circle(angles), [0, 0, 1, 1, 2, 2], [0, 1, 10, 11, 0, 11])
    lifetimes = np.array([[0, 1], [10, 11], [0, 11]])
    assert in_one_scene(objects, lifetimes).error_rate == 0
    assert in_one_scene(objects, for_ever(3)).error_rate > 0


@pytest.mark.parametrize(("frames", "is_hard"), [(6, True), (2, False)])
def test_objects_are_compared_with_those_beside_them_where_there_are_many(frames, is_hard):
    """Two in each of twelve scenes look alike, and the scenes differ: easy, were all compared with all."""
    scene, side, frame = (grid.ravel() for grid in np.mgrid[:12, :2, :frames])
    angles = scene * np.pi / 24 + 0.001 * np.where(side, frame, -frame)
    objects = make_objects(on_circle(angles), (2 * scene + side).tolist(), frame.tolist())
    assert (validate(objects, for_ever(24), np.repeat(np.arange(12), 2)).error_rate > 0.2) == is_hard
    assert in_one_scene(objects, for_ever(24)).error_rate < 0.2


def test_sources_without_pairs_of_both_kinds_are_left_out():
    objects = make_objects(
        on_circle([0.0, 0.0, 1.0, 1.0, 2.0, 2.0]), [0, 0, 1, 1, 2, 2], [0, 1, 0, 1, 0, 1], [0] * 4 + [1] * 2
    )
    found = in_one_scene(objects, for_ever(3))
    assert found.error_rate == 0
    assert found.pairs == 4
    assert found.identities == 3


@pytest.mark.parametrize(
    ("identities", "frames", "lifetimes"),
    [
        pytest.param([], [], for_ever(0), id="none"),
        pytest.param([0, 0, 0], [0, 1, 2], for_ever(1), id="one"),
        pytest.param([0, 1, 2], [0, 1, 2], for_ever(3), id="each seen once"),
        pytest.param([0, 0, 1, 1], [0, 1, 5, 6], np.array([[0, 1], [5, 6]]), id="never together"),
    ],
)
def test_too_few_identities_are_one_line(identities, frames, lifetimes):
    objects = make_objects(on_circle(np.zeros(len(identities))), identities, frames)
    message = refusal(ConfigError, lambda: in_one_scene(objects, lifetimes))
    assert "give more data" in message


@pytest.mark.parametrize(
    ("lifetimes", "is_enough"),
    [
        pytest.param([], False, id="no source"),
        pytest.param([for_ever(0), for_ever(1)], False, id="one"),
        pytest.param([for_ever(1), for_ever(2)], True, id="two"),
        pytest.param([np.array([[5, 6], [0, 1], [2, 4]])], False, id="never together"),
        pytest.param([np.array([[5, 6], [0, 9], [20, 30]])], True, id="one within another"),
        pytest.param([np.array([[0, 5]]), np.array([[0, 5]])], False, id="of two sources"),
    ],
)
def test_what_can_be_compared_is_known_beforehand(lifetimes, is_enough):
    if is_enough:
        check_comparable(lifetimes)
    else:
        assert "give more data" in refusal(ConfigError, lambda: check_comparable(lifetimes))
