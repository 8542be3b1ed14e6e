"""Truth and result as values: what is refused, and where they come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lookonce.datasets import LabelledFrame, LabelledObjects, LabelledSequence
from lookonce.evaluation import TrackingResult, TrackingTruth
from lookonce.evaluation.tracking.values import all_frames

BOXES = np.array([[0, 0, 10, 10], [20, 0, 30, 10], [1, 0, 11, 10.0]])
FRAMES, IDS = np.array([0, 0, 2]), np.array([4, 5, 4])
EVERY, NONE, LABELS = np.ones(3, np.bool_), np.zeros(3, np.bool_), np.array([0, 1, 0])


def make_truth(**fields: object) -> TrackingTruth:
    truth = TrackingTruth(np.arange(3), FRAMES, IDS, BOXES, LABELS, EVERY, NONE)
    return replace(truth, **fields)


def make_result(**fields: object) -> TrackingResult:
    return replace(TrackingResult(FRAMES, IDS, BOXES, LABELS), **fields)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        pytest.param({"frames": np.array([0, 2, 2])}, "frames: expected 0 or more, each once", id="frames-twice"),
        pytest.param({"frames": np.array([-1, 0, 2])}, "frames: expected 0 or more", id="negative-frame"),
        pytest.param({"frames": np.array([0, 1])}, "row_frames: expected frames among", id="row-in-another-frame"),
        pytest.param(
            {"ids": np.array([4, 4, 4])}, "ids: expected each once a frame, got 4 twice in frame 0", id="twin"
        ),
        pytest.param({"ids": IDS.astype(np.int32)}, r"ids: expected \(N,\) int64", id="dtype"),
        pytest.param({"labels": LABELS[:2]}, r"labels: expected \(3,\) int64", id="length"),
        pytest.param({"xyxy": BOXES.astype(np.float32)}, r"xyxy: expected \(3, 4\) float64", id="float32"),
        pytest.param({"xyxy": BOXES * np.nan}, "xyxy: expected finite", id="nan"),
        pytest.param({"xyxy": BOXES * 1e9}, "xyxy: expected numbers up to 10,000,000 px", id="far"),
        pytest.param({"xyxy": BOXES[:, [2, 1, 0, 3]]}, "xyxy: expected left < right", id="negative-size"),
        pytest.param({"is_counted": EVERY[:1]}, r"is_counted: expected \(3,\) bool", id="flags"),
        pytest.param({"is_distractor": EVERY}, "is_distractor: expected only rows that do not count", id="distractor"),
        pytest.param({"ignored": BOXES[:, :2]}, r"ignored: expected \(N, 4\) float64", id="regions"),
    ],
)
def test_truth_that_cannot_be_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        make_truth(**fields)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        pytest.param({"row_frames": FRAMES - 1}, "row_frames: expected 0 or more, got -1", id="negative-frame"),
        pytest.param({"ids": np.array([4, 4, 4])}, "ids: expected each once a frame", id="twin"),
        pytest.param({"xyxy": BOXES + np.inf}, "xyxy: expected finite", id="infinite"),
    ],
)
def test_result_that_cannot_be_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        make_result(**fields)


def test_box_of_negative_size_may_be_in_a_result():
    assert len(make_result(xyxy=BOXES[:, [2, 1, 0, 3]])) == 3


def labelled(*indices: int) -> LabelledSequence:
    objects = LabelledObjects(
        np.array([[1, 2, 3, 4]], np.float32), np.array([7]), np.array([1]), np.ones(1, np.float32)
    )
    return LabelledSequence(
        name="one",
        layout="cvat",
        pictures=Path("pictures"),
        fps=None,
        frames=tuple(LabelledFrame(index, objects) for index in indices),
        classes=("car", "van"),
        ignored=np.array([[0, 0, 5, 5]], np.float32),
        left_out={"no identity": 2},
    )


def test_truth_of_a_labelled_sequence_goes_to_its_last_frame():
    truth = TrackingTruth.of_sequence(labelled(1, 3))
    assert truth.frames.tolist() == [0, 1, 2, 3]
    assert truth.row_frames.tolist() == [1, 3]
    assert (truth.ids.tolist(), truth.labels.tolist()) == ([7, 7], [1, 1])
    assert (truth.xyxy.tolist(), truth.ignored.tolist()) == ([[1, 2, 3, 4]] * 2, [[0, 0, 5, 5]])
    assert truth.is_counted.all()
    assert truth.left_out == {"no identity": 2}
    assert len(TrackingTruth.of_sequence(labelled(1, 3), frame_count=9).frames) == 9
    assert len(TrackingTruth.of_sequence(labelled()).frames) == 0


def test_frames_without_end_are_refused():
    with pytest.raises(ValueError, match="frame_count: expected 0 to 20,000,000"):
        all_frames(10**12)
    with pytest.raises(ValueError, match="frame_count"):
        TrackingTruth.of_sequence(labelled(1), frame_count=-1)


def test_one_class_keeps_frames_and_counts_its_own_rows():
    truth = make_truth().of_class(1)
    assert truth.is_counted.tolist() == [False, True, False]
    assert truth.frames.tolist() == [0, 1, 2]
    result = make_result(left_out={"why": 1}).of_class(0)
    assert result.ids.tolist() == [4, 4]
    assert result.left_out == {"why": 1}
