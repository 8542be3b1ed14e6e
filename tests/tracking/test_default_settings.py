"""What the settings of the preset `default`, as they ship, keep and refuse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from lookonce.errors import ConfigError
from lookonce.structures import NO_ID, Detections
from lookonce.tracking import DefaultConfig, Tracker
from tracking.moving import STEP_S, ids_of, seen
from tracking.scenes import at_angle

ONE, OTHER = at_angle(0)[0], at_angle(90)[0]


def _kept(frames: Sequence[Detections]) -> list[int]:
    """How many descriptors each object has after the frames, in the order in which they were first seen."""
    tracker = Tracker("default")
    for number, frame in enumerate(frames):
        tracker.update(frame, number * STEP_S)
    return tracker._rule.looks.seen[tracker._rule.objects.slots].tolist()


def test_descriptor_of_a_box_that_another_one_touches_is_not_kept():
    """15 px beside each other boxes share a seventh: half of what was kept at a crossing was of the other person."""
    apart, touching = (seen((100, 100), (100 + px, 100), looks=[ONE, OTHER]) for px in (18, 15))
    assert _kept([apart] * 9) == [9, 9]
    assert _kept([*[apart] * 5, *[touching] * 4]) == [5, 5]


def test_descriptor_of_a_box_beside_a_hidden_object_is_not_kept():
    both, one = seen((100, 100), (118, 100), looks=[ONE, OTHER]), seen((115, 100), looks=[OTHER])
    assert _kept([*[both] * 5, *[one] * 4]) == [5, 5]


def test_doubtful_box_does_not_continue_an_object_elsewhere():
    """At 0.35 it may only be where the object is expected."""
    before = [seen((100, 100), looks=[ONE])] * 5
    nothing = [seen(looks=at_angle()[:0])] * 10
    for score, expected in ((0.35, NO_ID), (0.45, 1)):
        elsewhere = seen((121, 100), scores=score, looks=[ONE])
        assert ids_of([*before, *nothing, elsewhere])[-1] == [expected]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"memory_s": "4"}, "memory_s='4': expected a number"),
        ({"views": 2.5}, "views=2.5: expected a whole number"),
        ({"steady": 1}, "steady=1: expected true or false"),
        ({"memory_s": True}, "memory_s=True: expected a number"),
    ],
)
def test_values_of_another_kind_are_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        DefaultConfig(**change)


def test_numbers_of_numpy_are_numbers():
    assert DefaultConfig(memory_s=np.float32(4), views=np.int64(2)) == DefaultConfig(memory_s=4.0, views=2)


@pytest.mark.parametrize("preset", [None, {}, 3])
def test_what_is_no_preset_is_refused(preset):
    with pytest.raises(ConfigError, match="expected a preset's name, or settings"):
        Tracker(preset)


@pytest.mark.parametrize("name", ["low_score", "birth_score", "high_score", "same_overlap", "hidden_overlap"])
def test_shares_beyond_one_are_refused(name):
    with pytest.raises(ConfigError, match=f"{name}=40: expected 0 to 1"):
        DefaultConfig(**{name: 40})
