"""Jumps of the whole picture, found from the boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lookonce import Tracker
from lookonce.tracking import DefaultConfig
from lookonce.tracking.default_config import iou_config
from tracking.moving import STEP_S, ids_of, seen

BOXES = iou_config()
PLACES = np.array([[100, 100], [180, 140], [400, 90], [330, 300], [150, 420], [520, 380], [610, 200]], np.float64)
EVERYBODY = list(range(1, len(PLACES) + 1))


def _frames(shifts, places=PLACES, rows=None):
    """Everybody walks; of each frame the shift from the first one, and which rows are seen."""
    speeds = np.random.default_rng(1).normal(0, 1, places.shape)
    seen_rows = [np.arange(len(places))] * len(shifts) if rows is None else rows
    return [
        seen(*(places + number * speeds + shift)[one])
        for number, (shift, one) in enumerate(zip(np.array(shifts, np.float64), seen_rows, strict=True))
    ]


@pytest.mark.parametrize("shift", [(40, 0), (-30, 120), (300, -250), (0, 460)])
def test_a_bumped_camera_costs_no_identity(shift):
    frames = _frames([(0, 0)] * 5 + [shift] * 5)
    assert ids_of(frames, BOXES) == [EVERYBODY] * 10
    assert not set(ids_of(frames, replace(BOXES, jolts=False))[-1]) & set(EVERYBODY)


def test_a_camera_that_turns_faster_than_its_frames_come():
    """Three boxes from frame to frame, three frames a second, from the first frame on."""
    frames = _frames([(120 * number, 15 * number) for number in range(8)])
    times = [0.33 * number for number in range(8)]
    assert ids_of(frames, BOXES, times) == [EVERYBODY] * 8


def test_some_are_missed_when_the_picture_jumps():
    rows = [np.arange(7)] * 5 + [np.array([6, 3, 0, 1, 4])] + [np.arange(7)] * 3
    answers = ids_of(_frames([(0, 0)] * 5 + [(150, 60)] * 4, rows=rows), BOXES)
    assert answers[5] == [7, 4, 1, 2, 5]
    assert answers[-1] == EVERYBODY  # those who were missed have been moved along


@pytest.mark.parametrize("count", [2, 3])
def test_a_few_have_to_agree_with_all_that_is_there(count):
    shifts = [(0, 0)] * 5 + [(150, 60)] * 5
    assert ids_of(_frames(shifts, PLACES[:count]), BOXES)[-1] == EVERYBODY[:count]
    frames = [seen(*PLACES[:count])] * 5
    for change in (PLACES[:count] + [[150, 60], [60, 150], [0, 0]][:count], [*(PLACES[:count] + 150), [900, 600]]):
        after = ids_of([*frames, *[seen(*change)] * 3], BOXES)[-1]
        assert not set(after[:2]) & set(EVERYBODY[:count])


@pytest.mark.parametrize(("look", "same"), [([1, 0], True), ([0.8, 0.6], True), ([0, 1], False), (None, False)])
def test_one_alone_has_to_look_as_it_did(look, same):
    before = seen((100, 100), looks=None if look is None else [[1, 0]])
    after = seen((250, 160), looks=None if look is None else [look])
    assert ids_of([before] * 5 + [after] * 3)[-1] == [1 if same else 2]


@pytest.mark.parametrize("like", [0, 1])
def test_those_who_agree_have_to_look_as_they_did(like):
    looks = np.eye(8)
    shifted = seen(*np.add(PLACES, [90, 50]), looks=looks[:7] if like else np.roll(looks[:7], 3, axis=0))
    answers = ids_of([seen(*PLACES, looks=looks[:7])] * 5 + [shifted] * 3)
    assert answers[-1] == EVERYBODY if like else answers[-1] != EVERYBODY


def test_many_cannot_agree_by_one_detection():
    """A group of four that vanishes, and one who comes: that is no jump, and who stands keeps the id."""
    group = [(100, 100), (114, 100), (100, 126), (114, 126)]
    before = seen(*group, (1000, 100), (1000, 600))
    after = seen((1000, 100), (1000, 600), (300, 250), (2000, 100))
    assert ids_of([before] * 10 + [after] * 2)[-1][:2] == [5, 6]
    two = ids_of([seen((100, 100), (116, 100))] * 5 + [seen((300, 250), (2000, 900))], BOXES)
    assert two[-1] == [-1, -1]


def test_some_who_set_off_together_are_no_jump():
    """Five of eight walk off at three boxes a second, two frames a second; the others stand."""
    walkers = np.array([[100, 100], [300, 180], [120, 260], [420, 390], [500, 50]], np.float64)
    standing = [(1900, 100), (1800, 300), (1850, 500)]
    tracker = Tracker(BOXES, explain=True)
    for number in range(16):
        way = 60.0 * max(0, number - 5)
        tracks = tracker.update(seen(*np.add(walkers, [way, 0]), *standing), number * 0.5)
        assert not any("jumped" in row.reason for row in tracks.story.rows)
    speeds = {
        one: tracker._rule.objects.motions.velocity[place, 0] for place, one in enumerate(tracker._rule.objects.ids)
    }
    assert [speeds[one] for one in tracks.ids[5:].tolist()] == pytest.approx([0, 0, 0], abs=1)


def test_a_jump_that_goes_on_is_a_movement():
    """All go the same way from one frame on: twice that is a jump, then it is what is expected."""
    tracker, jumped = Tracker(BOXES, explain=True), []
    for number, frame in enumerate(_frames([(60.0 * max(0, n - 4), 0.0) for n in range(12)])):
        tracks = tracker.update(frame, number * 0.5)
        jumped.append(any("jumped" in row.reason for row in tracks.story.rows))
        assert tracks.ids.tolist() == EVERYBODY or number == 0
    assert jumped == [number in (5, 6) for number in range(12)]


@pytest.mark.parametrize("seed", range(5))
def test_a_cut_to_another_scene_is_no_jump(seed):
    """Other objects at other places: all are new."""
    rng = np.random.default_rng(seed)
    frames = [seen(*PLACES)] * 5 + [seen(*(rng.uniform(0, 700, (7, 2))))] * 5
    tracker = Tracker(BOXES, explain=True)
    for number, frame in enumerate(frames):
        tracks = tracker.update(frame, number * STEP_S)
        assert not any("jumped" in row.reason for row in tracks.story.rows)


@pytest.mark.parametrize("step_s", [0.04, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_objects_that_move_by_themselves_are_no_jump(step_s, seed):
    rng = np.random.default_rng(seed)
    places, speeds = rng.uniform(0, 700, (12, 2)), rng.normal(0, 40, (12, 2))
    tracker = Tracker(DefaultConfig(), explain=True)
    for number in range(10):
        tracks = tracker.update(seen(*(places + speeds * number * step_s)), number * step_s)
        assert not any("jumped" in row.reason for row in tracks.story.rows)


def test_the_story_says_that_the_picture_has_jumped():
    tracker = Tracker(BOXES, explain=True)
    for number, frame in enumerate(_frames([(0, 0)] * 5 + [(80, -24)])):
        story = tracker.update(frame, number * STEP_S).story
    assert all(row.decision == "kept" for row in story.rows)
    (x, y) = story.rows[0].reason.split("has jumped by ")[1].removesuffix(" px").split(", ")
    assert int(x) == pytest.approx(80, abs=3)
    assert int(y) == pytest.approx(-24, abs=3)


def test_where_too_many_would_vote_nobody_does(monkeypatch):
    monkeypatch.setattr("lookonce.tracking.jolts._MOST", 48)
    assert not set(ids_of(_frames([(0, 0)] * 5 + [(150, 60)] * 5), BOXES)[-1]) & set(EVERYBODY)
