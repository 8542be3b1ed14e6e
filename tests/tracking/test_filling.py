"""Boxes for the frames in which an object was missed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lookonce.tracking import DefaultConfig, Tracker
from lookonce.tracking.filling import MOST_PASSED, PassedFrames
from tracking.moving import STEP_S, seen

CONFIG = DefaultConfig(steady=False, fill_s=1.0)


def _filled(hidden: range, frames: int = 40, config: DefaultConfig = CONFIG, step_s: float = STEP_S, **update):
    """All boxes that are filled in for an object that walks and is hidden in some frames, and its id."""
    tracker, found = Tracker(config), []
    for number in range(frames):
        places = [(900.0, 100.0)] + ([] if number in hidden else [(100.0 + 4 * number, 100.0)])
        given = {name: values[number] for name, values in update.items()}
        tracks = tracker.update(seen(*places), number * step_s, **given)
        found.append((number, tracks.filled))
    return found, int(tracks.ids[1])


def test_gap_is_filled_on_the_straight_line_when_the_object_is_seen_again() -> None:
    found, identity = _filled(range(15, 20))
    assert [number for number, filled in found if len(filled)] == [20]
    filled = found[20][1]
    assert filled.frames.tolist() == [15, 16, 17, 18, 19]
    assert filled.ids.tolist() == [identity] * 5
    expected = [[100 + 4 * number - 10, 80, 100 + 4 * number + 10, 120] for number in range(15, 20)]
    assert filled.xyxy == pytest.approx(np.array(expected), abs=1e-3)
    assert filled.xyxy.dtype == np.float32
    assert filled.labels.tolist() == [0] * 5


def test_longer_gaps_stay_open() -> None:
    longest = round(CONFIG.fill_s / STEP_S)  # 25 frames
    found, _ = _filled(range(12, 12 + longest - 1), 60)
    assert sum(len(filled) for _, filled in found) == longest - 1
    found, _ = _filled(range(12, 12 + longest + 1), 60)
    assert sum(len(filled) for _, filled in found) == 0


def test_zero_fills_nothing() -> None:
    found, _ = _filled(range(15, 20), config=replace(CONFIG, fill_s=0.0))
    assert not any(len(filled) for _, filled in found)


def test_frames_are_called_as_the_caller_calls_them() -> None:
    numbers = [1000 + 3 * number for number in range(40)]
    found, _ = _filled(range(15, 18), frame=numbers)
    assert found[18][1].frames.tolist() == [1045, 1048, 1051]


def test_share_of_the_way_goes_by_time() -> None:
    tracker = Tracker(replace(CONFIG, frame_rate=10.0))
    times = [0.1 * number for number in range(10)] + [1.3, 1.4]
    for number, time_s in enumerate(times):
        places = [(100.0 + 100 * time_s, 100.0)] if number != 10 else []
        tracks = tracker.update(seen(*places), time_s)
    (box,) = tracks.filled.xyxy.tolist()  # at 1.3 s, between 190 px at 0.9 s and 240 px at 1.4 s
    assert (box[0] + box[2]) / 2 == pytest.approx(190 + 50 * 0.4 / 0.5, abs=1e-3)


def test_object_that_is_not_confirmed_is_not_filled_in() -> None:
    tracker = Tracker(CONFIG)
    for number in range(12):
        places = [(100.0, 100.0)] if number in (8, 11) else []
        tracks = tracker.update(seen(*places, scores=0.3), number * STEP_S)
        assert len(tracks.filled) == 0


def test_gap_of_an_object_that_has_to_be_confirmed_again_stays_open() -> None:
    """Weak and still for long, so not taken as real; missed, seen weakly, and only then sure again."""
    tracker, filled, weak = Tracker(CONFIG), 0, 0.15
    for number in range(420):
        places = [] if 300 <= number < 305 else [(100.0, 100.0)]
        score = 0.9 if number < 50 or number >= 310 else weak
        tracks = tracker.update(seen(*places, scores=score), number * STEP_S)
        filled += len(tracks.filled)
    assert tracks.ids[0] == 1
    assert filled == 0


def test_array_form_has_them_at_the_tracker() -> None:
    tracker = Tracker(CONFIG)
    box = np.array([[10, 10, 50, 90, 0.9, 3]])
    for number in range(6):
        tracker.update(box if number != 4 else box[:0], number * STEP_S)
    assert (tracker.filled.frames.tolist(), tracker.filled.labels.tolist()) == ([4], [3])
    tracker.update(box, 6 * STEP_S)
    assert len(tracker.filled) == 0


def test_frames_remembered_are_bounded() -> None:
    passed = PassedFrames(1e9)
    for number in range(3 * MOST_PASSED):
        passed.add(number, number * 1e-4)
    assert len(passed.frames) == MOST_PASSED
    assert passed.have_missed(np.array([0.0]), 1.0).tolist() == []  # further back than what is remembered
    passed = PassedFrames(0.5)
    for number in range(100):
        passed.add(number, number * 0.1)
        assert len(passed.frames) <= 6
