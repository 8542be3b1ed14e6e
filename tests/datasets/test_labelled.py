"""The values check themselves."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from lookonce.datasets import LabelledFrame, LabelledObjects, LabelledSequence, LabelledStills


def make_objects(count=2, **changes):
    fields = {
        "xyxy": np.tile(np.array([[0, 0, 2, 3]], np.float32), (count, 1)),
        "identities": np.arange(count, dtype=np.int64),
        "labels": np.zeros(count, np.int64),
        "visibility": np.ones(count, np.float32),
    }
    return LabelledObjects(**(fields | changes))


def make_sequence(**changes):
    fields = {
        "name": "a",
        "layout": "kitti",
        "pictures": Path("a"),
        "fps": 10.0,
        "frames": (LabelledFrame(0, make_objects()), LabelledFrame(4, LabelledObjects.empty())),
        "classes": ("car",),
        "ignored": np.zeros((0, 4), np.float32),
        "left_out": {},
    }
    return LabelledSequence(**(fields | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param({"xyxy": np.zeros((3, 5))}, r"xyxy: expected \(N, 4\) float32, got \(3, 5\) float64", id="shape"),
        pytest.param({"xyxy": [1]}, r"xyxy: expected \(N, 4\) float32, got list", id="no-array"),
        pytest.param({"xyxy": np.full((2, 4), np.nan, np.float32)}, "xyxy: expected finite", id="nan"),
        pytest.param({"xyxy": np.zeros((2, 4), np.float32)}, "zero or negative size", id="no-area"),
        pytest.param({"identities": np.zeros(3, np.int64)}, r"identities: expected \(2,\) int64", id="rows"),
        pytest.param({"identities": np.array([1, -1])}, "identities: expected 0 or more, got -1", id="no-identity"),
        pytest.param({"labels": np.zeros(2, np.int32)}, r"labels: expected \(2,\) int64, got \(2,\) int32", id="dtype"),
        pytest.param({"labels": np.array([0, -2])}, "labels: expected 0 or more, got -2", id="negative-label"),
        pytest.param({"visibility": np.array([0, 1.5], np.float32)}, "visibility: expected shares", id="share"),
        pytest.param({"visibility": np.array([0, np.inf], np.float32)}, "visibility: expected finite", id="inf"),
    ],
)
def test_objects_refuse_what_is_no_object(changes, message):
    with pytest.raises(ValueError, match=message):
        make_objects(**changes)


def test_objects_are_chosen_by_row_with_all_fields_aligned():
    chosen = make_objects(3)[np.array([2, 0])]
    assert chosen.identities.tolist() == [2, 0]
    assert len(chosen) == 2
    assert len(make_objects(3)[np.zeros(3, bool)]) == len(LabelledObjects.empty()) == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param({"layout": "coco"}, "layout: expected one of motchallenge", id="layout"),
        pytest.param({"fps": 0.0}, "fps: expected frames per second > 0", id="fps"),
        pytest.param({"frames": (LabelledFrame(1, make_objects()),) * 2}, "rising order", id="frame-twice"),
        pytest.param({"classes": ()}, "labels: expected below 0", id="label-without-name"),
        pytest.param({"ignored": np.zeros((1, 4), np.float32)}, "ignored: expected left < right", id="ignored"),
    ],
)
def test_sequence_refuses_what_contradicts_itself(changes, message):
    with pytest.raises(ValueError, match=message):
        make_sequence(**changes)


def test_negative_frame_is_refused():
    with pytest.raises(ValueError, match="index: expected 0 or more"):
        LabelledFrame(-1, make_objects())


def test_stills_need_objects_for_each_picture_and_a_name_for_each_label():
    with pytest.raises(ValueError, match="objects: expected 1, one a picture, got 0"):
        LabelledStills("a", (Path("a.jpg"),), (), ())
    with pytest.raises(ValueError, match="labels: expected below 0"):
        LabelledStills("a", (Path("a.jpg"),), (make_objects(),), ())


def test_values_travel_to_other_processes():
    copy = pickle.loads(pickle.dumps(make_sequence()))
    assert copy.frames[0].objects.xyxy.tolist() == make_objects().xyxy.tolist()
