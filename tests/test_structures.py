"""Detections and tracks check themselves and keep their rows together."""

from __future__ import annotations

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from lookonce.structures import NO_ID, Detections, Tracks


def _fields(count=3, size=4):
    left = np.arange(count, dtype=np.float32)
    looks = np.zeros((count, size), np.float32)
    looks[:, 0] = 1
    return {
        "xyxy": np.stack([left, left, left + 1, left + 2], axis=1),
        "scores": left / 10,
        "labels": np.arange(count),
        "descriptors": looks,
    }


def _with(field, values):
    return {**_fields(), field: values}


def test_good_fields_are_kept_as_they_are():
    fields = _fields()
    detections = Detections(**fields)
    assert len(detections) == 3
    for name, values in fields.items():
        assert getattr(detections, name) is values
    assert Detections(**{**fields, "descriptors": None}).descriptors is None


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        pytest.param(
            _with("xyxy", np.zeros((3, 5))), r"xyxy: expected \(N, 4\) float32, got \(3, 5\) float64", id="columns"
        ),
        pytest.param(_with("xyxy", _fields()["xyxy"].astype(np.float64)), r"got \(3, 4\) float64", id="dtype"),
        pytest.param(_with("xyxy", [[0, 0, 1, 1]]), r"xyxy: expected \(N, 4\) float32, got list", id="list"),
        pytest.param(
            _with("scores", np.zeros(2, np.float32)), r"scores: expected \(3,\) float32, got \(2,\)", id="rows"
        ),
        pytest.param(
            _with("scores", np.zeros(3)), r"scores: expected \(3,\) float32, got \(3,\) float64", id="score64"
        ),
        pytest.param(_with("scores", np.full(3, np.nan, np.float32)), "scores: expected finite", id="score-nan"),
        pytest.param(_with("labels", np.zeros(3, np.int32)), r"labels: expected \(3,\) int64", id="label-dtype"),
        pytest.param(_with("labels", np.zeros((3, 1), np.int64)), r"labels: expected \(3,\) int64", id="label-shape"),
        pytest.param(_with("xyxy", np.full((3, 4), np.inf, np.float32)), "xyxy: expected finite", id="infinite"),
        pytest.param(_with("xyxy", np.zeros((3, 4), np.float32)), "zero or negative size", id="zero-size"),
        pytest.param(_with("xyxy", -_fields()["xyxy"]), "zero or negative size", id="negative-size"),
        pytest.param(
            _with("descriptors", np.ones((2, 4), np.float32)),
            r"descriptors: expected \(3, D\) float32",
            id="looks-rows",
        ),
        pytest.param(_with("descriptors", np.eye(3)), r"descriptors: expected \(3, D\) float32", id="looks-dtype"),
        pytest.param(_with("descriptors", np.ones((3, 4), np.float32)), "unit length", id="looks-length"),
        pytest.param(_with("descriptors", np.full((3, 4), np.nan, np.float32)), "unit length", id="looks-nan"),
    ],
)
def test_wrong_field_is_a_value_error(fields, message):
    with pytest.raises(ValueError, match=message):
        Detections(**fields)


def test_rows_of_zeros_are_allowed_as_descriptors():
    fields = _fields()
    fields["descriptors"][1] = 0
    assert len(Detections(**fields)) == 3


@pytest.mark.parametrize(
    "rows",
    [np.array([True, False, True]), np.array([2, 0]), slice(1, None), np.zeros(3, bool), np.array([], np.int64)],
    ids=["mask", "indices", "slice", "none", "no-indices"],
)
def test_chosen_rows_stay_aligned(rows):
    fields = _fields()
    chosen = Detections(**fields)[rows]
    for name, values in fields.items():
        np.testing.assert_array_equal(getattr(chosen, name), values[rows])
    assert Detections(**{**fields, "descriptors": None})[rows].descriptors is None


def test_empty_has_no_rows():
    assert len(Detections.empty()) == 0
    assert Detections.empty().descriptors is None
    looks = Detections.empty(7).descriptors
    assert looks is not None
    assert looks.shape == (0, 7)


def test_fields_cannot_be_replaced():
    with pytest.raises(FrozenInstanceError):
        Detections(**_fields()).scores = np.zeros(3, np.float32)  # type: ignore[misc]


def test_tracks_give_the_rows_that_have_an_identity():
    fields = _fields()
    ids = np.array([4, NO_ID, 1])
    none = (np.zeros(0, np.int64), np.zeros((0, 4), np.float32))
    tracks = Tracks(ids, fields["xyxy"], fields["scores"], np.array([1, 0, 5]), *none, names=("car", "bus"))
    assert len(tracks) == 3
    rows = list(tracks)
    assert [(t.id, t.label, t.name) for t in rows] == [(4, 1, "bus"), (1, 5, "5")]
    assert [t.xyxy.tolist() for t in rows] == [fields["xyxy"][0].tolist(), fields["xyxy"][2].tolist()]
    assert [t.score for t in rows] == [0.0, pytest.approx(0.2)]


def test_identified_leaves_out_the_rows_without_identity() -> None:
    boxes = np.array([[0, 0, 5, 5], [1, 1, 6, 6], [2, 2, 7, 7]], np.float32)
    none = np.zeros(0, np.int64)
    labels, scores = np.array([2, 1, 0]), np.array([0.1, 0.2, 0.3], np.float32)
    tracks = Tracks(np.array([4, -1, 9]), boxes, scores, labels, none, boxes[:0], ("a", "b", "c"))
    assert [(t.id, t.name, t.xyxy.tolist()) for t in tracks.identified()] == [
        (4, "c", [0, 0, 5, 5]),
        (9, "a", [2, 2, 7, 7]),
    ]
    assert len(tracks.identified()) == 2
