"""When an object is taken as real, its class by vote, and its rows kept aligned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lookonce.errors import ConfigError
from lookonce.structures import NO_ID
from lookonce.tracking import EvidenceConfig, MotionConfig
from lookonce.tracking.motion import MOTION_ROWS
from lookonce.tracking.objects import MovingScores, Objects

EVIDENCE = EvidenceConfig(
    hits=2,
    score=0.7,
    least_score=0.45,
    score_mean_s=0.0,
    score_memory_s=3.0,
    travel=0.5,
    travels=2,
    travel_memory_s=3.0,
)
ONE = np.zeros(1, np.int64)
NAMES = (
    *("serials", "ids", "slots", "labels", "hits", "travels", "votes", "seen_s", "score_mean", "score_peak"),
    *("travel_s", "anchor", "heading", "surprise", "box", "is_real"),
)


def _begin(count=1, scores=0.5, labels=0):
    states = np.tile([[100.0, 50.0, np.log(20), np.log(40)]], (count, 1))
    numbers = np.arange(count)
    return Objects.begin(
        numbers, numbers + 10, np.full(count, labels), np.full(count, scores), states, 0.0, MotionConfig()
    )


def _see(objects, score=0.5, label=0, now_s=0.04, place=None, evidence=EVIDENCE, moving=None):
    if place is not None:
        objects.motions.place[0] = place
    objects.see_(ONE, np.array([label]), np.array([score]), now_s, evidence, moving or MovingScores())


def test_new_object_is_not_real_yet():
    objects = _begin(3, scores=1.0)
    assert objects.is_real.tolist() == [False] * 3
    assert objects.ids.tolist() == [NO_ID] * 3
    assert objects.hits.tolist() == [1, 1, 1]


@pytest.mark.parametrize(("second", "is_real"), [(0.89, False), (0.91, True)])
def test_seen_twice_with_enough_score_is_real(second, is_real):
    """A mean of 0.7 is enough: 0.5 and 0.9."""
    objects = _begin(scores=0.5)
    _see(objects, second)
    assert objects.is_real[0] == is_real


def test_one_good_sight_is_not_enough():
    objects = _begin(scores=1.0)
    assert not objects.is_real[0]
    objects = _begin(scores=1.0)
    _see(objects, 1.0, evidence=replace(EVIDENCE, hits=3))
    assert not objects.is_real[0]
    _see(objects, 1.0, now_s=0.08, evidence=replace(EVIDENCE, hits=3))
    assert objects.is_real[0]


def test_mean_is_of_about_the_last_three():
    objects = _begin(scores=0.0)
    for number, score in enumerate([0.6, 0.6, 0.9]):
        _see(objects, score, now_s=0.04 * (number + 1))
    # 0, then (0 + 0.6) / 2 = 0.3, then 0.3 + 0.3 / 3 = 0.4, then 0.4 + 0.5 / 3
    assert objects.score_mean[0] == pytest.approx(0.4 + 0.5 / 3)


@pytest.mark.parametrize(("step_s", "weight"), [(0.04, 1 / 25), (0.2, 1 / 5), (0.5, 1 / 3), (2.0, 1 / 3)])
def test_mean_is_of_about_a_second_and_three_scores_at_least(step_s, weight):
    """At 25 frames/s the last three scores are a tenth of a second, in which nothing changes but noise."""
    objects, evidence = _begin(scores=0.5), replace(EVIDENCE, score_mean_s=1.0)
    for number in range(40):
        _see(objects, 0.5, now_s=step_s * (number + 1), evidence=evidence)
    _see(objects, 1.0, now_s=step_s * 41, evidence=evidence)
    assert objects.score_mean[0] == pytest.approx(0.5 + 0.5 * weight)


def test_score_that_was_high_once_is_remembered_and_fades():
    objects = _begin(scores=1.0)
    _see(objects, 1.0)
    for number in range(2, 20):
        _see(objects, 0.2, now_s=0.04 * number)
    assert objects.is_real[0]
    assert objects.score_mean[0] < 0.25
    _see(objects, 0.2, now_s=5.0)
    assert not objects.is_real[0]


def test_two_travels_make_real_whatever_the_score_until_they_are_long_ago():
    """A travel is half the square root of the area: 14 px for a box of 20 by 40."""
    objects = _begin(scores=0.2)
    _see(objects, 0.2, now_s=0.1, place=[113.0, 50.0])
    assert objects.travels[0] == 0
    _see(objects, 0.2, now_s=0.2, place=[115.0, 50.0])
    assert (objects.travels[0], objects.is_real[0]) == (1, False)
    _see(objects, 0.2, now_s=0.3, place=[125.0, 62.0])
    assert (objects.travels[0], objects.is_real[0]) == (2, True)
    _see(objects, 0.2, now_s=3.2, place=[125.0, 62.0])
    assert objects.is_real[0]
    _see(objects, 0.2, now_s=3.4, place=[125.0, 62.0])
    assert not objects.is_real[0]
    _see(objects, 0.2, now_s=3.5, place=[140.0, 70.0])
    assert objects.is_real[0]


@pytest.mark.parametrize(("angle", "is_real"), [(0, True), (55, True), (65, False), (90, False), (180, False)])
def test_what_goes_to_and_fro_is_not_on_its_way(angle, is_real):
    """A box that trembles about a place travels as well, but not twice the same way."""
    objects, turn = _begin(scores=0.2), np.radians(angle)
    _see(objects, 0.2, now_s=0.1, place=[115.0, 50.0])
    _see(objects, 0.2, now_s=0.2, place=[115.0 + 15 * np.cos(turn), 50.0 + 15 * np.sin(turn)])
    assert objects.is_real[0] == is_real


def test_ways_turn_with_the_camera():
    objects = _begin(scores=0.2)
    _see(objects, 0.2, now_s=0.1, place=[115.0, 50.0])
    objects.move_camera_(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]))  # a quarter turn: right becomes down
    assert (objects.anchor.tolist(), objects.heading.tolist()) == ([[-50.0, 115.0]], [[0.0, 15.0]])
    _see(objects, 0.2, now_s=0.2, place=[-50.0, 130.0])
    assert objects.is_real[0]


def _moving(*scores):
    moving = MovingScores()
    for begin in range(0, len(scores), 7):
        moving.add(np.array(scores[begin : begin + 7]))
    return moving


def test_what_stands_needs_no_more_than_the_lower_scores_of_what_moves():
    """Objects on their way at 0.6, more or less: 0.55 is enough for one that stands, but 0.5 is not."""
    moving = _moving(*[0.65, 0.55] * 200)
    assert moving.enough(EVIDENCE) == pytest.approx(0.55)
    for score, is_real in [(0.56, True), (0.54, False)]:
        objects = _begin(scores=score)
        _see(objects, score, moving=moving)
        assert objects.is_real[0] == is_real


@pytest.mark.parametrize(
    ("scores", "expected"),
    [
        pytest.param([], 0.7, id="nothing-moves"),
        pytest.param([0.5] * 100, 0.6, id="half-convinced"),
        pytest.param([0.1] * 400, 0.45, id="never-less-than-the-least"),
        pytest.param([0.95] * 400, 0.7, id="never-more-than-is-enough"),
    ],
)
def test_score_that_is_enough(scores, expected):
    assert _moving(*scores).enough(EVIDENCE) == pytest.approx(expected)


def test_scores_of_what_moves_are_summed_up_and_old_ones_fade():
    scores = np.random.default_rng(0).uniform(0, 1, 3000)
    moving = _moving(*scores)
    assert moving.mean == pytest.approx(scores.mean())
    assert moving.squares == pytest.approx(scores.var())
    for _ in range(10_000):
        moving.add(np.array([0.25, 0.25, 0.25]))
    assert moving.mean == pytest.approx(0.25, abs=0.01)
    assert moving.squares == pytest.approx(0, abs=0.01)
    moving.add(np.zeros(0))
    assert moving.count == 5000


def test_only_what_is_on_its_way_is_asked_for_its_scores():
    objects, moving = _begin(scores=0.2), MovingScores()
    _see(objects, 0.2, now_s=0.1, place=[115.0, 50.0], moving=moving)
    assert moving.count == 0
    _see(objects, 0.3, now_s=0.2, place=[130.0, 50.0], moving=moving)
    assert (moving.count, moving.mean) == (1, pytest.approx(0.3))


def test_trembling_about_a_place_is_no_travel():
    objects = _begin(scores=0.2)
    for number in range(1, 50):
        _see(objects, 0.2, now_s=0.04 * number, place=[100.0 + 12 * (-1) ** number, 50.0])
    assert objects.travels[0] == 0


def test_class_is_the_one_with_most_score_behind_it():
    objects = _begin(scores=0.75, labels=2)
    _see(objects, 0.5, label=7)
    assert (objects.labels[0], objects.votes[0]) == (2, 0.25)
    for expected in (-0.25, -0.75):  # ahead, but not clearly
        _see(objects, 0.5, label=7)
        assert (objects.labels[0], objects.votes[0]) == (2, expected)
    _see(objects, 0.5, label=7)
    assert (objects.labels[0], objects.votes[0]) == (7, 1.0)
    _see(objects, 0.25, label=2)
    assert (objects.labels[0], objects.votes[0]) == (7, 0.75)


@pytest.mark.parametrize("scores", [(0.85, 0.9), (0.9, 0.9), (0.2, 0.25)])
def test_classes_that_come_in_turn_do_not_flicker(scores):
    objects, labels = _begin(scores=scores[0], labels=0), []
    for number in range(1, 200):
        _see(objects, scores[number % 2], now_s=0.04 * number, label=number % 2)
        labels.append(int(objects.labels[0]))
    assert np.count_nonzero(np.diff(labels)) <= 1


def test_votes_of_one_object_do_not_touch_another():
    objects, both = _begin(2, scores=0.75, labels=2), np.arange(2)
    for _ in range(4):
        objects.see_(both, np.array([2, 7]), np.array([0.5, 0.5]), 0.04, EVIDENCE, MovingScores())
    assert objects.labels.tolist() == [2, 7]
    objects.see_(both, np.array([9, 2]), np.array([0.25, 2.5]), 0.04, EVIDENCE, MovingScores())
    assert objects.labels.tolist() == [2, 2]


def test_class_seen_for_hours_is_outvoted_in_time():
    """The lead is bounded: ten of score, not hours of it; one more makes it clear."""
    objects = _begin(scores=1.0, labels=2)
    for _ in range(1000):
        _see(objects, 1.0, label=2)
    for _ in range(11):
        _see(objects, 1.0, label=7)
    assert objects.labels[0] == 2
    _see(objects, 1.0, label=7)
    assert objects.labels[0] == 7


@pytest.mark.parametrize("label", [-(2**63), -1, 2**63 - 1])
def test_labels_may_be_any_number(label):
    objects = _begin(labels=label)
    _see(objects, label=label)
    assert objects.labels[0] == label


def test_parts_and_joins_keep_all_arrays_aligned():
    objects = _begin(4)
    objects.motions.place[:, 0] = np.arange(4)
    objects.ids[:] = [5, 6, 7, 8]
    part = objects.part(np.array([False, True, False, True]))
    assert len(part) == 2
    assert (part.ids.tolist(), part.slots.tolist(), part.motions.place[:, 0].tolist()) == ([6, 8], [11, 13], [1, 3])
    joined = part.joined(objects)
    assert joined.ids.tolist() == [6, 8, 5, 6, 7, 8]
    for whole in (objects, part, joined):
        assert whole.motions.values.shape == (MOTION_ROWS, len(whole))
        rows = [getattr(whole, name) for name in NAMES]
        assert {len(values) for values in rows} == {len(whole)}
    part.ids[0] = 99
    assert objects.ids.tolist() == [5, 6, 7, 8]


@pytest.mark.parametrize(("name", "value"), [("hits", 0), ("score_memory_s", 0.0), ("score", -0.1)])
def test_impossible_settings_are_refused(name, value):
    with pytest.raises(ConfigError, match=name):
        EvidenceConfig(**{name: value})
