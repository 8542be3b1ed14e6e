"""The tracker that users hold: rows of every kind in, the same kind out, bad rows set aside."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import supervision

from lookonce.errors import ConfigError
from lookonce.tracking import PRESETS, DefaultConfig, PaperConfig, Tracker
from tracking.scenes import at_angle, make_detections


def _rows(count, dtype=np.float64):
    """Boxes side by side: x1 y1 x2 y2 score label."""
    left = np.arange(count) * 30.0
    return np.stack([left, left * 0, left + 20, left * 0 + 40, left * 0 + 0.5, np.arange(count)], 1).astype(dtype)


def test_preset_is_chosen_by_name_or_settings():
    assert Tracker().config == Tracker("default").config == PRESETS["default"]() == DefaultConfig()
    assert Tracker("paper").config == PRESETS["paper"]() == PaperConfig()
    assert Tracker("iou").config == PRESETS["iou"]()
    assert not Tracker("iou").config.appearance
    assert Tracker(PaperConfig(0.5)).config.match_threshold == 0.5
    with pytest.raises(ConfigError, match="tracker 'papper': expected one of default, iou, paper"):
        Tracker("papper")


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64])
def test_array_in_array_out(dtype):
    tracker, rows = Tracker("paper"), _rows(3, dtype)
    before = rows.copy()
    first = tracker.update(rows, descriptors=at_angle(0, 90, 180))
    assert (first.shape, first.dtype) == ((3, 7), np.float64)
    np.testing.assert_array_equal(first[:, :6], rows)
    assert first[:, 6].tolist() == [1, 2, 3]
    second = tracker.update(rows, time_s=0.1, descriptors=at_angle(180, 0, 90))
    assert second[:, 6].tolist() == [3, 1, 2]
    np.testing.assert_array_equal(rows, before)


def test_array_without_rows():
    tracker = Tracker("paper")
    assert tracker.update(np.zeros((0, 6)), descriptors=np.zeros((0, 2))).shape == (0, 7)
    assert tracker.update(_rows(1), descriptors=at_angle(0))[:, 6].tolist() == [1]
    assert tracker.update(np.zeros((0, 6)), descriptors=np.zeros((0, 2))).shape == (0, 7)
    assert tracker.dropped_rows == 0


def test_descriptors_of_any_length_and_type_are_scaled():
    """Only the direction counts; lists, whole numbers and numbers whose squares overflow are fine."""
    tracker = Tracker("paper")
    looks = [[1e300, 0], [0, 1e-300], [-5, 0]]
    assert tracker.update(_rows(3), descriptors=looks)[:, 6].tolist() == [1, 2, 3]
    assert tracker.update(_rows(3), descriptors=np.array([[0, 7], [-1, 0], [3, 0]]))[:, 6].tolist() == [2, 3, 1]
    assert tracker.dropped_rows == 0


BAD_ROWS = [
    pytest.param([np.nan, 0, 9, 9, 0.5, 0], id="nan"),
    pytest.param([0, 0, np.inf, 9, 0.5, 0], id="infinite"),
    pytest.param([0, 0, 1e300, 9, 0.5, 0], id="beyond-float32"),
    pytest.param([0, 0, 9, 9, np.nan, 0], id="score-nan"),
    pytest.param([0, 0, 9, 9, 0.5, np.nan], id="label-nan"),
    pytest.param([0, 0, 9, 9, 0.5, 1e300], id="label-huge"),
    pytest.param([9, 0, 0, 9, 0.5, 0], id="negative-width"),
    pytest.param([0, 9, 9, 0, 0.5, 0], id="negative-height"),
    pytest.param([5, 0, 5, 9, 0.5, 0], id="zero-width"),
    pytest.param([0, 5, 9, 5, 0.5, 0], id="zero-height"),
]


@pytest.mark.parametrize("bad", BAD_ROWS)
@pytest.mark.parametrize("where", [0, 1, 3])
def test_bad_row_gets_no_id_is_counted_and_leaves_the_others_alone(bad, where):
    clean, dirty = Tracker("paper"), Tracker("paper")
    for angles in [(0, 90, 180), (180, 0, 90), (90, 180, 0)]:
        rows, looks = _rows(3), at_angle(*angles)
        expected = clean.update(rows, descriptors=looks)
        result = dirty.update(np.insert(rows, where, bad, axis=0), descriptors=np.insert(looks, where, [0.6, 0.8], 0))
        assert result[where, 6] == -1
        np.testing.assert_array_equal(result[where, :6], bad)
        np.testing.assert_array_equal(np.delete(result, where, axis=0), expected)
    assert (clean.dropped_rows, dirty.dropped_rows) == (0, 3)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_bad_descriptor_sets_the_row_aside(value):
    tracker = Tracker("paper")
    looks = at_angle(0, 90, 180)
    looks[1, 0] = value
    assert tracker.update(_rows(3), descriptors=looks)[:, 6].tolist() == [1, -1, 2]
    assert tracker.dropped_rows == 1


def test_zero_descriptor_has_no_id_but_is_no_bad_row():
    tracker = Tracker("paper")
    looks = at_angle(0, 90)
    looks[0] = 0
    assert tracker.update(_rows(2), descriptors=looks)[:, 6].tolist() == [-1, 1]
    assert tracker.dropped_rows == 0


def test_only_bad_rows_are_a_frame_without_detections():
    tracker = Tracker("paper")
    tracker.update(_rows(1), descriptors=at_angle(0))
    assert tracker.update(np.full((2, 6), np.nan), descriptors=at_angle(0, 0))[:, 6].tolist() == [-1, -1]
    assert tracker.update(_rows(1), descriptors=at_angle(0))[:, 6].tolist() == [2]


@pytest.mark.parametrize(
    ("rows", "looks", "message"),
    [
        pytest.param(_rows(2)[:, :5], at_angle(0, 1), r"expected \(N, 6\) numbers", id="five-columns"),
        pytest.param(_rows(1)[0], at_angle(0), r"expected \(N, 6\) numbers", id="one-row-flat"),
        pytest.param(_rows(2).astype(str), at_angle(0, 1), r"expected \(N, 6\) numbers", id="texts"),
        pytest.param(_rows(2), at_angle(0), r"descriptors: expected \(2, D\)", id="too-few-descriptors"),
        pytest.param(_rows(2), at_angle(0, 1)[0], r"descriptors: expected \(2, D\)", id="flat-descriptors"),
        pytest.param(_rows(2), [["a", "b"]] * 2, r"descriptors: expected \(2, D\) numbers", id="texts-as-descriptors"),
        pytest.param(_rows(2), None, "these detections have none", id="no-descriptors"),
    ],
)
def test_wrong_arrays_are_value_errors(rows, looks, message):
    with pytest.raises(ValueError, match=message):
        Tracker("paper").update(rows, descriptors=looks)


def test_other_kinds_are_type_errors():
    for other in (None, [[0, 0, 9, 9, 0.5, 0]], "rows", 3):
        with pytest.raises(TypeError, match="expected Detections, an"):
            Tracker("paper").update(other)


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), -1e308])
def test_time_must_be_finite(time_s):
    with pytest.raises(ValueError, match="time_s: expected finite seconds"):
        Tracker("paper").update(make_detections(at_angle(0)), time_s=time_s)


def test_descriptors_are_given_once():
    with pytest.raises(ValueError, match="Detections carry their own"):
        Tracker("paper").update(make_detections(at_angle(0)), descriptors=at_angle(0))


def test_arrays_and_detections_get_the_same_ids():
    one, two = Tracker("paper"), Tracker("paper")
    for angles in [(0, 90), (90, 180, 0), (10, 170)]:
        expected = one.update(make_detections(at_angle(*angles))).ids
        assert two.update(_rows(len(angles)), descriptors=at_angle(*angles))[:, 6].tolist() == expected.tolist()


def _supervision(*angles, **fields):
    rows = _rows(len(angles))
    fields = {"confidence": rows[:, 4], "class_id": rows[:, 5].astype(int)} | fields
    return supervision.Detections(
        xyxy=rows[:, :4], data={"descriptor": at_angle(*angles), "plate": np.array(["x"] * len(angles))}, **fields
    )


def test_supervision_in_supervision_out_and_the_argument_is_unchanged():
    tracker = Tracker("paper")
    given = _supervision(0, 90)
    before = copy.deepcopy(given)
    answer = tracker.update(given)
    assert isinstance(answer, supervision.Detections)
    assert answer is not given
    assert answer.tracker_id.tolist() == [1, 2]
    assert given == before
    assert given.tracker_id is None
    answer.tracker_id = None
    assert answer == given
    again = tracker.update(_supervision(90, 180, 0), 0.1)
    assert again.tracker_id.tolist() == [2, 3, 1]
    assert again[again.tracker_id == 1].data["plate"].tolist() == ["x"]


def test_supervision_without_scores_and_classes():
    assert Tracker("paper").update(_supervision(0, 90, confidence=None, class_id=None)).tracker_id.tolist() == [1, 2]


def test_supervision_bad_rows_are_kept_without_id():
    tracker, given = Tracker("paper"), _supervision(0, 90, 180)
    given.xyxy[1, 2] = np.nan
    answer = tracker.update(given)
    assert answer.tracker_id.tolist() == [1, -1, 2]
    assert len(answer) == 3
    assert tracker.dropped_rows == 1


@pytest.mark.parametrize(
    "data",
    [
        pytest.param({"descriptor": np.zeros((0, 2))}, id="no-rows"),
        pytest.param({"descriptor": np.zeros(0)}, id="flat"),
        pytest.param({"descriptor": []}, id="list"),
        pytest.param({}, id="absent"),
    ],
)
def test_empty_supervision_is_a_frame_without_detections(data):
    """`supervision.Detections.empty()` carries no data at all; a frame without objects must not stop a program."""
    tracker = Tracker("paper")
    assert tracker.update(_supervision(0)).tracker_id.tolist() == [1]
    empty = supervision.Detections.empty()
    empty.data = data
    answer = tracker.update(empty)
    assert isinstance(answer, supervision.Detections)
    assert len(answer) == 0
    assert answer.tracker_id.tolist() == []
    assert tracker.update(_supervision(0)).tracker_id.tolist() == [2]


def test_supervision_without_descriptors_is_refused():
    given = _supervision(0)
    given.data = {}
    with pytest.raises(ValueError, match="these detections have none"):
        Tracker("paper").update(given)
