"""The preset `default` with every kind of input: clocks, gaps, absent and impossible values, order, repeats."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from lookonce.structures import NO_ID, Detections
from lookonce.tracking import DefaultConfig, Tracker
from lookonce.tracking.border import Border
from tracking.moving import STEP_S, crowd, ids_of, seen
from tracking.scenes import at_angle

LEFT, RIGHT = (100.0, 100.0), (400.0, 100.0)
NOTHING = seen()


# --- time ------------------------------------------------------------------------------------------------------------


def _run(times, frames=None, preset="default"):
    tracker = Tracker(preset)
    frames = frames or [seen((100 + 3 * n, 100)) for n in range(len(times))]
    return tracker, [tracker.update(frame, time_s).ids.tolist() for frame, time_s in zip(frames, times, strict=True)]


def test_without_times_frames_come_at_the_configured_rate():
    frames = [seen((100 + 3 * n, 100), (900, 100)) for n in range(8)]
    evenly, without = Tracker(), Tracker()
    for number, frame in enumerate(frames):
        expected = evenly.update(frame, number / DefaultConfig().frame_rate)
        found = without.update(frame)
        assert found.ids.tolist() == expected.ids.tolist()
    assert without._rule.clock.now_s == pytest.approx(evenly._rule.clock.now_s)
    slow = Tracker(DefaultConfig(frame_rate=2.0))
    for frame in frames:
        slow.update(frame)
    assert slow._rule.clock.now_s == pytest.approx(3.5)


@pytest.mark.parametrize("start_s", [-5.0, 0.0, 1.7e9])
def test_clock_may_start_anywhere(start_s):
    times = [start_s + number * STEP_S for number in range(12)]
    tracker, answers = _run(times)
    assert answers == [[NO_ID]] + [[1]] * 11
    assert tracker._rule.clock.faults == 0


def test_time_that_stands_still_or_goes_back_is_counted_and_harms_nobody():
    tracker, answers = _run([0.0, 0.04, 0.04, 0.04, 0.02, 0.08, 0.12])
    assert answers == [[NO_ID]] + [[1]] * 6
    assert tracker._rule.clock.faults == 3


def test_clock_that_was_set_back_goes_on_from_there():
    """A camera that restarts at 0 after an hour: for an hour every frame counted as a millisecond."""
    times = [3600.0, 3600.04, 3600.08, 0.0, 0.04, 0.08, 0.12]
    tracker, answers = _run(times)
    assert answers == [[NO_ID]] + [[1]] * 6
    assert tracker._rule.clock.faults == 2
    again = tracker.update(seen((100, 100)), 60.0)  # a minute later there is somebody else
    assert again.ids.tolist() == [NO_ID]


@pytest.mark.parametrize("gap_s", [60.0, 7200.0, 1e9])
def test_gap_of_hours_makes_all_objects_new(gap_s):
    there = seen(LEFT, RIGHT, looks=at_angle(0, 90))
    _, answers = _run([0.0, 0.1, 0.1 + gap_s, 0.2 + gap_s], [there] * 4)
    assert answers == [[NO_ID, NO_ID], [1, 2], [NO_ID, NO_ID], [3, 4]]


@pytest.mark.parametrize("step_s", [0.001, 0.04, 0.5, 2.0])
def test_objects_that_stand_are_kept_at_any_frame_rate(step_s):
    frames = [seen(LEFT, RIGHT, looks=at_angle(0, 90))] * 10
    assert ids_of(frames, times=[step_s * number for number in range(10)]) == [[1, 2]] * 10


# --- what is there ---------------------------------------------------------------------------------------------------


def test_no_detections_no_objects_and_neither():
    tracker = Tracker()
    for number in range(3):
        tracks = tracker.update(NOTHING, number * STEP_S)
        assert (len(tracks), len(tracks.unseen_ids), tracks.unseen_xyxy.shape) == (0, 0, (0, 4))
        assert (tracks.ids.dtype, tracks.unseen_xyxy.dtype) == (np.int64, np.float32)
    assert tracker.update(seen(LEFT), 0.12).ids.tolist() == [NO_ID]
    assert tracker.update(seen(LEFT), 0.16).ids.tolist() == [1]
    assert tracker.update(NOTHING, 0.20).unseen_ids.tolist() == [1]


@pytest.mark.parametrize("looks", [None, at_angle(0)], ids=["boxes-only", "described"])
@pytest.mark.parametrize("preset", ["default", "iou"])
def test_one_of_each(preset, looks):
    assert ids_of([seen(LEFT, looks=looks)] * 2, preset) == [[1]] * 2


def test_detections_without_descriptors_are_tracked_by_motion():
    """As by the preset that does without."""
    frames = [seen((100 + 4 * n, 100), (130 + 4 * n, 100)) for n in range(10)]
    assert ids_of(frames) == ids_of(frames, "iou") == [[1, 2]] * 10


def test_descriptors_make_no_difference_to_the_preset_that_does_without():
    frames = [seen((100, 100), (114, 100), looks=at_angle(0, 90)), seen((102, 100), (112, 100), looks=at_angle(90, 0))]
    without = [Detections(frame.xyxy, frame.scores, frame.labels) for frame in frames]
    assert ids_of(frames * 4, "iou") == ids_of(without * 4, "iou")


def test_detectors_without_scores_are_fine():
    """All are 1."""
    assert ids_of([seen(LEFT, RIGHT, scores=1.0)] * 4) == [[1, 2]] * 4


@pytest.mark.parametrize("scores", [[1e30, -5.0], [2.0, 0.0]])
def test_scores_out_of_range_disturb_nobody(scores):
    assert ids_of([seen(LEFT, RIGHT, scores=scores)] * 4) == [[1, NO_ID]] * 4


def test_descriptors_may_come_and_go():
    described, plain = seen(LEFT, RIGHT, looks=at_angle(0, 90)), seen(LEFT, RIGHT)
    assert ids_of([plain, described, plain, NOTHING, described, plain, described]) == [[1, 2]] * 3 + [[]] + [[1, 2]] * 3


def test_zero_descriptors_are_none():
    looks = [[0.0, 0.0], [1.0, 0.0]]
    assert ids_of([seen(LEFT, RIGHT, looks=looks)] * 5) == [[1, 2]] * 5
    assert ids_of([seen(LEFT, RIGHT, looks=np.zeros((2, 2)))] * 5) == [[1, 2]] * 5


def test_descriptors_of_another_length_are_refused():
    tracker = Tracker()
    tracker.update(seen(LEFT, looks=np.eye(1, 8)))
    with pytest.raises(ValueError, match="descriptors: expected 8 values as before, got 9"):
        tracker.update(seen(LEFT, looks=np.eye(1, 9)))
    assert Tracker("iou").update(seen(LEFT, looks=np.eye(1, 9))).ids.tolist() == [NO_ID]


@pytest.mark.parametrize("labels", [[-1, -(2**63)], [10**6, 2**63 - 1], [0, 0]])
def test_labels_may_be_any_number(labels):
    tracker = Tracker()
    for number in range(4):
        tracks = tracker.update(seen(LEFT, RIGHT, labels=labels), number * STEP_S)
    assert tracks.ids.tolist() == [1, 2]
    assert tracks.labels.tolist() == labels


@pytest.mark.parametrize(
    "box",
    [
        pytest.param([0, 0, 1e-45, 1e-45], id="smallest"),
        pytest.param([1e6, 1e6, 1e6 + 0.0625, 1e6 + 1000], id="thin"),
        pytest.param([-1e7, -1e7, 1e7, 1e7], id="largest"),
        pytest.param([9e6, 9e6, 9.1e6, 9.1e6], id="farthest"),
    ],
)
def test_extreme_boxes_are_tracked_beside_usual_ones(box):
    boxes = np.array([box, [10, 10, 30, 50]], np.float32)
    frame = Detections(boxes, np.full(2, 0.9, np.float32), np.zeros(2, np.int64))
    assert ids_of([frame, frame, NOTHING, frame, frame]) == [[1, 2], [1, 2], [], [1, 2], [1, 2]]


@pytest.mark.parametrize("box", [[-3e38, -3e38, 3e38, 3e38], [1e12, 1e12, 1.01e12, 1.01e12]])
def test_boxes_beyond_any_picture_are_nobody(box, tmp_path):
    """And make nothing slow: one of them would leave all pairs of a crowd within what rounding takes away."""
    tracker, usual = Tracker(), [[float(x), 10, x + 20.0, 50] for x in range(0, 4000, 40)]
    stray, scores = np.array([box, *usual], np.float32), np.full(len(usual) + 1, 0.9, np.float32)
    frame = Detections(stray, scores, np.zeros(len(stray), np.int64))
    for number in range(4):
        ids = tracker.update(frame, number * STEP_S).ids.tolist()
    assert ids == [NO_ID, *range(1, len(usual) + 1)]
    tracker.save(tmp_path / "state")
    assert Tracker.load(tmp_path / "state").update(frame, 4 * STEP_S).ids.tolist() == ids


def test_refused_frames_change_nothing():
    clean, poked = Tracker(), Tracker()
    rows = np.array([[10, 10, 50, 90, 0.9, 0], [np.nan, 10, 50, 90, 0.9, 0]])
    for number in range(6):
        answers = [one.update(rows, number * STEP_S, descriptors=np.eye(2, 8)).tolist() for one in (clean, poked)]
        assert str(answers[0]) == str(answers[1])
        with pytest.raises(ValueError, match="expected 8 values as before, got 9"):
            poked.update(rows, 100.0, descriptors=np.eye(2, 9))
        assert poked.dropped_rows == clean.dropped_rows == number + 1
        assert poked.given_back.frames.tolist() == clean.given_back.frames.tolist()
    assert poked._rule.clock == clean._rule.clock


def test_one_weak_stray_box_is_no_border():
    """Who walks out of what has been seen of the picture has left, whatever nonsense there was once."""
    left = []
    for has_stray in (False, True):
        tracker = Tracker()
        for number in range(60):
            standing = [(100.0 * place, 100.0) for place in range(11)]
            walking = [(900.0 + 30 * number, 300.0)] if number < 12 else []
            stray = [(1e6, 1e6)] if has_stray and number == 3 else []
            scores = [0.9] * (len(standing) + len(walking)) + [0.15] * len(stray)
            tracker.update(seen(*standing, *walking, *stray, scores=scores), number * 0.04)
        left.append(tracker._rule.objects.ids.tolist())
    assert left[0] == left[1] == list(range(1, 12))


def test_before_there_are_boxes_the_picture_has_no_end():
    border = Border()
    assert border.xyxy(None) == (-np.inf, -np.inf, np.inf, np.inf)
    assert border.xyxy((480, 640)) == (0, 0, 640, 480)
    border.widen(np.array([[10.0, 20, 30, 40], [-5, 25, 15, 60]]), np.arange(2))
    assert border.xyxy(None) == (-5, 20, 30, 60)


def test_seen_in_the_frame_before_means_that_frame():
    """A step a hundred times as long as the one before makes nobody seen who was missed."""
    found = []
    for gap_s in (3.5, 3.99, 4.0, 6.0):
        tracker = Tracker()
        times = [0.04 * number for number in range(11)]
        for time_s in times[:-1]:
            tracker.update(seen((100, 100)), time_s)
        tracker.update(seen(), times[-1])
        for time_s in (times[-1] + gap_s, times[-1] + gap_s + 0.04):
            ids = tracker.update(seen((400, 100)), time_s).ids.tolist()
        found.append(ids)
    assert found == [[2]] * 4


def test_of_equal_boxes_the_order_of_rows_does_not_choose():
    """Two boxes of one object with the same score, as from a detector without scores."""
    boxes = np.array([[10, 10, 50, 90], [16, 10, 56, 90]], np.float32)
    for order in ([0, 1], [1, 0]):
        tracker = Tracker()
        for number in range(4):
            frame = Detections(boxes[order], np.full(2, 0.9, np.float32), np.zeros(2, np.int64))
            ids = tracker.update(frame, number * STEP_S).ids
        assert ids[np.argsort(order)].tolist() == [1, NO_ID]


@pytest.mark.parametrize(
    "camera",
    [
        pytest.param(np.full((2, 3), np.nan), id="nan"),
        pytest.param(np.zeros((2, 3)), id="flat"),
        pytest.param(np.eye(3), id="shape"),
        pytest.param(np.array([[np.inf, 0, 0], [0, 1, 0]]), id="infinite"),
    ],
)
def test_impossible_camera_motion_is_refused(camera):
    tracker = Tracker()
    tracker.update(seen(LEFT))
    with pytest.raises(ValueError, match="camera: expected"):
        tracker.update(seen(LEFT), camera=camera)


# --- whole scenes ----------------------------------------------------------------------------------------------------


def _detections(frame, rows=slice(None)):
    looks = frame.looks[rows] / np.linalg.norm(frame.looks[rows], axis=1, keepdims=True)
    table = frame.rows[rows].astype(np.float32)
    return Detections(table[:, :4], table[:, 4], table[:, 5].astype(np.int64), looks.astype(np.float32))


def _answers(stream, preset="default"):
    """Everything that a tracker says, as bytes."""
    tracker, said = Tracker(preset), []
    for frame in stream:
        tracks = tracker.update(_detections(frame), frame.time_s)
        back = tracks.given_back
        parts = (tracks.ids, tracks.labels, tracks.unseen_ids, tracks.unseen_xyxy, back.frames, back.rows, back.ids)
        said.append(b"".join(np.ascontiguousarray(part).tobytes() for part in parts))
    return said


@pytest.mark.parametrize("preset", ["default", "iou"])
def test_same_input_gives_the_same_bytes(preset):
    assert _answers(crowd(20, 60, seed=1), preset) == _answers(crowd(20, 60, seed=1), preset)


def test_two_trackers_do_not_meet():
    alone = _answers(crowd(12, 40, seed=2)), _answers(crowd(12, 40, seed=3))
    one, two, said = Tracker(), Tracker(), ([], [])
    for frames in zip(crowd(12, 40, seed=2), crowd(12, 40, seed=3), strict=True):
        for tracker, frame, answers in zip((one, two), frames, said, strict=True):
            tracks = tracker.update(_detections(frame), frame.time_s)
            back = tracks.given_back
            parts = (tracks.ids, tracks.labels, tracks.unseen_ids, tracks.unseen_xyxy, back.frames, back.rows, back.ids)
            answers.append(b"".join(np.ascontiguousarray(part).tobytes() for part in parts))
    assert said == alone


def _in_two_orders(seed):
    """Ids of the same rows by trackers that get them in different order."""
    rng, one, two = np.random.default_rng(seed), Tracker(), Tracker()
    pairs = []
    for frame in crowd(25, 80, seed):
        order = rng.permutation(len(frame.rows))
        first = one.update(_detections(frame), frame.time_s).ids[order]
        second = two.update(_detections(frame, order), frame.time_s).ids
        pairs += list(zip(first.tolist(), second.tolist(), strict=True))
    return pairs


@pytest.mark.parametrize("seed", range(3))
def test_order_of_rows_makes_no_difference_to_who_is_who(seed):
    """The scores differ, so nothing is left to the order; the same objects may be called by other ids."""
    pairs = set(_in_two_orders(seed))
    assert len({first for first, _ in pairs}) == len({second for _, second in pairs}) == len(pairs)
    assert (NO_ID, NO_ID) in pairs
    assert len(pairs) > 20


def test_order_of_rows_makes_no_difference_to_ids():
    """Objects that begin in one frame are numbered by their scores."""
    assert all(first == second for first, second in _in_two_orders(0))


def test_crowd_is_told_apart():
    """Most rows of a scene in which boxes cover each other all the time have the id of their object."""
    tracker, names, right, total = Tracker(), {}, 0, 0
    for frame in crowd(20, 150, seed=5):
        ids = tracker.update(_detections(frame), frame.time_s).ids
        for identity, name in zip(ids.tolist(), frame.objects.tolist(), strict=True):
            if identity != NO_ID:
                total += 1
                right += names.setdefault(identity, name) == name
    assert total > 2000
    assert right / total > 0.95


def test_thousands_of_boxes_at_one_place_are_one_object():
    """10^8 pairs would take gigabytes; beside them somebody is tracked as ever."""
    rng, tracker = np.random.default_rng(0), Tracker("iou")
    for number in range(4):
        corner = np.concatenate([rng.uniform(0, 1, (10_000, 2)), [[500.0 + number, 100]]])
        rows = np.column_stack(
            [corner, np.add(corner, (40, 80)), np.append(rng.uniform(0.5, 0.9, 10_000), 0.95), np.zeros(10_001)]
        )
        tracemalloc.start()
        ids = tracker.update(rows, number * 0.04)[:, 6]
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 100e6
    assert sorted(ids[ids > 0].tolist()) == [1, 2]
    assert ids[-1] > 0
