"""Boxes that shake less, and no more than the detector does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lookonce.structures import Detections
from lookonce.tracking import DefaultConfig, Tracker
from lookonce.tracking.motion import Correction, box_states
from lookonce.tracking.steadying import Steadying, in_boxes
from tracking.moving import STEP_S, seen

FRAMES, OBJECTS = 200, 8
CONFIG = DefaultConfig(appearance=False)


def _walk(frame: int) -> np.ndarray:
    """True boxes (OBJECTS, 4): each walks in a lane of its own, and grows."""
    lane = np.arange(OBJECTS)
    centre = np.stack([40 + 3.0 * frame + 5 * lane, 100.0 + 120 * lane], axis=1)
    half = np.array([15, 35]) * (1 + 0.002 * frame) / 2
    return np.concatenate([centre - half, centre + half], axis=1)


def _errors(noise: float, config: DefaultConfig = CONFIG, step_s: float = STEP_S) -> tuple[float, float]:
    """Mean distance of corners from the truth, px: of the detections and of what the tracker gives, after a while."""
    rng = np.random.default_rng(7)
    tracker, detected, given = Tracker(config), [], []
    for frame in range(FRAMES):
        true = _walk(frame)
        boxes = (true + rng.normal(0, noise, true.shape)).astype(np.float32)
        found = Detections(boxes, np.full(OBJECTS, 0.9, np.float32), np.zeros(OBJECTS, np.int64))
        tracks = tracker.update(found, frame * step_s)
        if frame >= 50:
            assert (tracks.ids > 0).all()
            detected.append(np.abs(boxes - true).mean())
            given.append(np.abs(tracks.xyxy - true).mean())
    return float(np.mean(detected)), float(np.mean(given))


def test_boxes_of_a_noisy_detector_come_nearer_to_the_truth() -> None:
    detected, given = _errors(3.0)
    assert given < 0.75 * detected


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_boxes_of_a_precise_detector_hardly_change(noise: float) -> None:
    """A filter made for a detector that errs by an eighth of the box would lag behind by pixels."""
    detected, given = _errors(noise)
    assert given < detected + 0.15


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_gaps_do_not_make_a_precise_detector_look_noisy(noise: float) -> None:
    """After a second unseen on a winding way an object is far from where it was expected, whatever the noise."""
    rng = np.random.default_rng(9)
    tracker, detected, given = Tracker(CONFIG), [], []
    hidden = np.zeros(OBJECTS, np.int64)
    for frame in range(600):
        hidden = np.where(hidden > 0, hidden - 1, np.where(rng.random(OBJECTS) < 0.05, 25, 0))
        true = _walk(0) + 40 * np.sin(frame / 12 + np.arange(OBJECTS))[:, np.newaxis] * np.array([1, 0, 1, 0])
        boxes = (true + rng.normal(0, noise, true.shape)).astype(np.float32)
        rows = np.flatnonzero(hidden == 0)
        found = Detections(boxes[rows], np.full(len(rows), 0.9, np.float32), np.zeros(len(rows), np.int64))
        tracks = tracker.update(found, frame * STEP_S)
        if frame >= 100:
            detected.append(np.abs(boxes[rows] - true[rows]).sum())
            given.append(np.abs(tracks.xyxy - true[rows]).sum())
    assert sum(given) < 1.05 * sum(detected) + 0.05 * len(given)


def test_without_it_boxes_are_as_detected() -> None:
    detected, given = _errors(3.0, replace(CONFIG, steady=False))
    assert given == detected


def test_ids_do_not_depend_on_it() -> None:
    rng = np.random.default_rng(3)
    trackers = Tracker(CONFIG), Tracker(replace(CONFIG, steady=False))
    for frame in range(60):
        boxes = (_walk(frame) + rng.normal(0, 2, (OBJECTS, 4))).astype(np.float32)
        rows = np.flatnonzero(rng.random(OBJECTS) < 0.8)
        found = Detections(boxes[rows], np.full(len(rows), 0.9, np.float32), np.zeros(len(rows), np.int64))
        one, other = (tracker.update(found, frame * STEP_S) for tracker in trackers)
        assert one.ids.tolist() == other.ids.tolist()


def test_input_is_left_as_it_is() -> None:
    tracker, rng = Tracker(CONFIG), np.random.default_rng(5)
    for frame in range(60):
        boxes = (_walk(frame) + rng.normal(0, 2, (OBJECTS, 4))).astype(np.float32)
        kept = boxes.copy()
        tracks = tracker.update(Detections(boxes, np.full(OBJECTS, 0.9, np.float32), np.zeros(OBJECTS, np.int64)))
        assert (boxes == kept).all()
    assert (tracks.xyxy != boxes).any()


def test_rows_of_nobody_are_as_detected() -> None:
    tracker = Tracker(CONFIG)
    for frame in range(60):
        boxes = np.concatenate([_walk(frame), [[900, 900 - 9 * frame, 920, 940 - 9 * frame]]]).astype(np.float32)
        scores = np.array([0.9] * OBJECTS + [0.05], np.float32)  # the last one is too weak for anybody
        tracks = tracker.update(Detections(boxes, scores, np.zeros(OBJECTS + 1, np.int64)), frame * STEP_S)
    assert tracks.ids[-1] == -1
    assert (tracks.xyxy[-1] == boxes[-1]).all()


def _learnt(repeated: float, count: int = 2000) -> Steadying:
    """After surprises whose neighbours are correlated by ``repeated``."""
    rng = np.random.default_rng(11)
    before = rng.normal(0, 0.1, (4, count))
    now = repeated * before + np.sqrt(1 - repeated**2) * rng.normal(0, 0.1, (4, count))
    steadying = Steadying()
    steadying.learn(before, now)
    return steadying


@pytest.mark.parametrize(("repeated", "share"), [(0.0, 0.6), (0.3, 0.3), (0.9, 0.0)])
def test_share_is_what_the_gain_leaves_less_the_correlation(repeated: float, share: float) -> None:
    """c = 1 - K - C1 / C0, with K = 0.4, and never below 0."""
    states = box_states(np.array([[100.0, 100.0, 120.0, 150.0]]))
    surprise = np.array([[10.0], [-5.0], [0.2], [0.1]])
    gains = np.full((2, 1), 0.4)
    box = _learnt(repeated).boxes(Correction(surprise, gains), states, np.full(1, 0.04))
    moved = box_states(box).T - states.T
    assert moved == pytest.approx(-share * surprise, abs=0.05 * np.abs(surprise).max())


def test_little_is_moved_before_much_was_seen_and_after_a_long_time() -> None:
    states = box_states(np.array([[100.0, 100.0, 120.0, 150.0]]))
    correction = Correction(np.array([[10.0], [0.0], [0.0], [0.0]]), np.full((2, 1), 0.4))

    def way(steadying: Steadying, unseen_s: float) -> float:
        return float(110 - box_states(steadying.boxes(correction, states, np.full(1, unseen_s)))[0, 0])

    assert way(Steadying(), 0.04) == 0
    assert way(_learnt(0.0, 25), 0.04) == pytest.approx(way(_learnt(0.0), 0.04) / 2, rel=0.5)
    assert way(_learnt(0.0), 1.0) == pytest.approx(way(_learnt(0.0), 0.5) / 4)


def test_surprises_are_counted_in_boxes_and_far_ones_cut() -> None:
    surprise = np.array([[5.0, 500.0], [-10.0, -500.0], [0.3, 3.0], [-0.2, -3.0]])
    assert in_boxes(surprise, np.array([50.0, 50.0])).T == pytest.approx(
        np.array([[0.1, -0.2, 0.3, -0.2], [1, -1, 1, -1]])
    )
    assert surprise[0, 1] == 500


def test_wide_boxes_tremble_as_tall_ones():
    """The same stream lying on its side."""
    noise, learnt = np.random.default_rng(0).normal(0, 2, (40, 2)), []
    for axes in ([0, 1], [1, 0]):
        tracker = Tracker("iou")
        for number in range(40):
            place = np.array([100 + 2 * number, 200]) + noise[number]
            tracker.update(seen(place[axes], size=tuple(np.array([20, 80])[axes])), number / 10)
        learnt.append(tracker._rule.own_boxes.steadying.state())
    np.testing.assert_allclose(learnt[0], learnt[1], rtol=1e-9)
    assert learnt[0][3] > 0
