"""The IOU tracker and KIOU, rule by rule."""

from __future__ import annotations

import numpy as np
import pytest

from compare.moving import ids_by_lane, lane, make_sequence, nothing
from lookonce.compare.contenders.box_filter import BoxFilter
from lookonce.compare.contenders.iou import IouSettings, associate_iou, associate_kiou

BOTH = pytest.mark.parametrize("associate", [associate_iou, associate_kiou])


@BOTH
def test_objects_keep_their_ids_whatever_the_order_of_rows(associate):
    sequence, owners = make_sequence([lane(0), lane(60, 100, -3), lane(120, 50, 0)], mixed=True)
    found = ids_by_lane(associate(sequence), owners)
    assert [len(ids) for ids in found] == [1, 1, 1]
    assert len(set.union(*found)) == 3
    assert (associate(sequence) >= 0).all()


@BOTH
def test_nothing_gives_nothing(associate):
    assert associate(nothing()).tolist() == []


@BOTH
def test_track_without_a_sure_detection_does_not_count(associate):
    sequence, owners = make_sequence([lane(0), lane(100)], scores=(0.9, 0.6))
    assert [len(ids) for ids in ids_by_lane(associate(sequence), owners)] == [1, 0]


def test_one_sure_detection_is_enough():
    sequence, _ = make_sequence([lane(0)], scores=(0.3,))
    sequence.scores[5] = 0.7
    assert (associate_iou(sequence) == 1).all()


def test_short_track_does_not_count():
    once = [lane(0), lane(100, hidden=tuple(range(1, 12))), lane(200, hidden=tuple(range(2, 12)))]
    sequence, owners = make_sequence(once)
    assert [len(ids) for ids in ids_by_lane(associate_iou(sequence), owners)] == [1, 0, 1]


def test_detections_below_low_are_not_looked_at():
    sequence, owners = make_sequence([lane(0), lane(100)], scores=(0.9, 0.4))
    ids = associate_iou(sequence, IouSettings(low=0.5, high=0.0))
    assert [len(found) for found in ids_by_lane(ids, owners)] == [1, 0]


def test_overlap_at_the_limit_continues_and_below_ends():
    near, _ = make_sequence([lane(0, step=20 / 3)], frames=3)  # IoU (20 - 20/3) / (20 + 20/3) = 0.5
    assert len(set(associate_iou(near, IouSettings(overlap=0.49)).tolist())) == 1
    far, _ = make_sequence([lane(0, step=8)], frames=3)
    assert associate_iou(far).tolist() == [-1, -1, -1]


def test_iou_ends_at_a_miss_and_kiou_outlives_it():
    sequence, _ = make_sequence([lane(0, step=4, hidden=(6, 7, 8))], frames=14)
    assert set(associate_iou(sequence).tolist()) == {1, 2}
    assert set(associate_kiou(sequence).tolist()) == {1}


def test_kiou_forgets_after_a_second():
    sequence, _ = make_sequence([lane(0, step=0, hidden=tuple(range(4, 16)))], frames=22)
    assert len(set(associate_kiou(sequence).tolist())) == 2


def test_filter_learns_the_speed_and_looks_ahead():
    box = np.array([0, 0, 20, 40], np.float32)
    tracked = BoxFilter(box, 0.0)
    for step in range(1, 15):
        tracked.correct(box + np.float32(6 * step) * np.array([1, 0, 1, 0], np.float32), step / 10)
    assert tracked.predict(2.4)[0] == pytest.approx(6 * 24, abs=6)
    assert tracked.predict(1.4) == pytest.approx([84, 0, 104, 40], abs=2)


def test_covariance_stays_symmetric_and_positive():
    tracked = BoxFilter(np.array([0, 0, 20, 40], np.float32), 0.0)
    time_s = 0.0
    for step in range(1, 300):
        time_s += 0.04 if step % 7 else 3.0
        tracked.correct(np.array([step, 0, step + 20, 40], np.float32), time_s)
        covariance = tracked._covariance
        assert np.allclose(covariance, covariance.T)
        assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_expected_box_keeps_a_size():
    tracked = BoxFilter(np.array([0, 0, 20, 40], np.float32), 0.0)
    tracked.correct(np.array([8, 16, 12, 24], np.float32), 0.1)
    left, top, right, bottom = tracked.predict(5.0).tolist()
    assert right - left >= 1
    assert bottom - top >= 1
