"""An object and a detection that have only each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lookonce import Tracker
from lookonce.structures import NO_ID
from lookonce.tracking import DefaultConfig
from tracking.moving import STEP_S, ids_of, seen

CONFIG = DefaultConfig()
BOXES = DefaultConfig(appearance=False, jolts=False)  # a jump of all that is there is another story
FAR = (2000, 2000)
# Half a box, and a third of one in a frame: so far away may be who is alone, of 40 px.
REACH = 40 * (0.5 + CONFIG.motion.alone_speed * STEP_S)


def _after(way, config=BOXES, others=(), looks=None, scores=0.9, **fields):
    """One stands still for a second, and is away by so much; what ids its row and the others' have then."""
    before = seen((100, 100), FAR, *others, looks=looks and [looks[0]] * (2 + len(others)))
    after = seen(
        (100 + way, 100), FAR, *others, scores=scores, looks=looks and [looks[1]] * (2 + len(others)), **fields
    )
    return ids_of([before] * 25 + [after], config)[-1]


def test_who_is_alone_may_have_gone_anywhere_near():
    assert _after(REACH - 2) == [1, 2]
    assert _after(REACH + 2)[0] == NO_ID
    assert _after(REACH - 2, replace(BOXES, motion=replace(BOXES.motion, alone_speed=0.0)))[0] == NO_ID


@pytest.mark.parametrize("other", [(100, 150), (165, 70), (100 - 45, 60), (100 - 70, 100)])
def test_where_others_are_near_nobody_is_alone(other):
    assert _after(REACH - 2, others=[other])[0] == NO_ID


def test_who_is_hidden_may_be_the_one_that_comes():
    """Somebody who was seen until a moment ago is nearer to the detection than the one that is missed."""
    both, one, away = seen((100, 100), (155, 100), FAR), seen((100, 100), FAR), seen((100 + REACH - 2, 100), FAR)
    assert ids_of([both] * 25 + [one] * 2 + [away], BOXES)[-1] == [NO_ID, 3]
    assert ids_of([one] * 27 + [away], BOXES)[-1] == [1, 2]


@pytest.mark.parametrize("other", [(100 + REACH + 40, 100), (100 + REACH, 160)])
def test_where_another_detection_is_near_nobody_is_alone(other):
    """It is no known object's, and weak."""
    after = seen((100 + REACH - 2, 100), FAR, other, scores=[0.9, 0.9, 0.3])
    assert ids_of([seen((100, 100), FAR)] * 25 + [after], BOXES)[-1][0] == NO_ID


SLOW = [0.04 * n for n in range(25)] + [0.96 + 0.5]  # after half a second one may be four boxes and a half away
STIFF = replace(BOXES, motion=replace(BOXES.motion, turn_share=0.0, lag=1e6))


def test_one_object_and_two_detections_have_not_only_each_other():
    frames = [seen((1000, 100), FAR)] * 25
    assert ids_of([*frames, seen((1000 + 150, 100), FAR)], STIFF, SLOW)[-1] == [1, 2]
    assert ids_of([*frames, seen((1000 + 150, 100), (1000 - 150, 100), FAR)], STIFF, SLOW)[-1] == [NO_ID, NO_ID, 2]


def test_two_objects_and_one_detection_have_not_only_each_other():
    frames = [seen((1000 - 170, 100), (1000 + 150, 100), FAR)] * 25
    assert ids_of([*frames, seen((1000, 100), FAR)], STIFF, SLOW)[-1] == [NO_ID, 3]


def test_two_who_are_missed_and_one_that_comes():
    before, after = seen((100, 100), (160, 100), FAR), seen((130, 100), FAR)
    assert ids_of([before] * 25 + [after], BOXES)[-1] == [NO_ID, 3]


@pytest.mark.parametrize(("way", "found"), [(11.5, True), (12.5, False)])
def test_nobody_is_alone_farther_away_than_twelve_boxes(way, found):
    """However long it is since the frame before: it is not known how it moves."""
    times = [*SLOW[:-1], 0.04 * 24 + 5]
    frames = [seen((100, 100), FAR)] * 25 + [seen((100 + 40 * way, 100), FAR)]
    assert (ids_of(frames, STIFF, times)[-1][0] == 1) == found


def test_others_who_are_farther_away_do_not_matter():
    assert _after(REACH - 2, others=[(100, 250), (250, 100)]) == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("look", "same"), [([1, 0], True), ([0.8, 0.6], True), ([0.65, 0.76], True), ([0, 1], False), ([0, 0], True)]
)
def test_who_is_alone_must_not_look_different(look, same):
    answer = _after(REACH - 2, replace(CONFIG, jolts=False), looks=([1, 0], look))
    assert answer[0] == (1 if same else NO_ID)


def test_weak_rows_other_sizes_and_other_classes_are_others():
    for changed in ({"scores": [0.3, 0.9]}, {"labels": [1, 0]}):
        assert _after(REACH - 2, **changed)[0] == NO_ID
    frames = [seen((100, 100), FAR)] * 25
    for factor, same in ((1.8, True), (2.3, False)):
        sizes = np.array([[20, 40]]) * np.array([[factor], [1]])
        last = seen((100 + REACH - 2, 100), FAR)
        last.xyxy[:, :2], last.xyxy[:, 2:] = (
            np.array([[100 + REACH - 2, 100], FAR]) - sizes / 2,
            np.array([[100 + REACH - 2, 100], FAR]) + sizes / 2,
        )
        assert (ids_of([*frames, last], BOXES)[-1][0] == 1) == same


def test_a_second_box_of_what_was_found_is_nobody_alone():
    """One stays, the other is missed, and the one that stays has two boxes."""
    config = replace(BOXES, same_overlap=0.9)
    before, after = seen((100, 100), (140, 100), FAR), seen((100, 100), (108, 104), FAR)
    assert ids_of([before] * 25 + [after], config)[-1] == [1, NO_ID, 3]


def test_who_is_not_confirmed_or_was_missed_is_not_looked_for():
    still, away, gone = seen((100, 100), FAR), seen((100 + REACH - 2, 100), FAR), seen(FAR)
    assert ids_of([still] * 25 + [gone, away], BOXES)[-1][0] == NO_ID
    weak = replace(BOXES, evidence=replace(BOXES.evidence, hits=100))
    tracker = Tracker(weak)
    for number, frame in enumerate([still] * 25 + [away]):
        tracker.update(frame, number * STEP_S)
    assert tracker._rule.objects.hits.tolist() == [25, 26, 1]


def test_the_story_says_that_nobody_else_was_near():
    tracker = Tracker(BOXES, explain=True)
    for number in range(26):
        place = (100 + (REACH - 2 if number == 25 else 0), 100)
        story = tracker.update(seen(place, FAR), number * STEP_S).story
    assert story.rows[0].decision == "kept"
    assert "nobody else is near" in story.rows[0].reason
    assert "nobody else is near" not in story.rows[1].reason


def test_where_there_are_too_many_pairs_nobody_is_alone(monkeypatch):
    monkeypatch.setattr("lookonce.tracking.pairs._DENSE", 0)
    assert _after(REACH - 2) == [1, 2]
    monkeypatch.setattr("lookonce.tracking.alone._MOST_PAIRS", 0)
    assert _after(REACH - 2)[0] == NO_ID
