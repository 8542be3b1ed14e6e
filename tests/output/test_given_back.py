"""Rows of earlier frames, given back or filled in, in the files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from lookonce.datasets.jsonl_tracks import read_jsonl_results
from lookonce.output import JsonLinesSink, MotSink
from lookonce.structures import Filled, GivenBack
from output.scenes import make_frame, make_tracks


def given_back(*rows):
    """Frame, id, label, score and box of each row."""
    frames, ids, labels, scores, boxes = zip(*rows, strict=True)
    return GivenBack(
        np.array(frames),
        np.zeros(len(rows), np.int64),
        np.array(ids),
        np.array(boxes, np.float32),
        np.array(scores, np.float32),
        np.array(labels),
    )


BACK = given_back((0, 2, 1, 0.75, [1, 2, 4, 6]), (3, 2, 1, 0.5, [2, 2, 5, 6.5]))
CONFIRMED = replace(make_tracks([2], [[3, 2, 6, 6]], [0.9], [1]), given_back=BACK)


def test_text_has_a_line_for_each_after_those_of_the_frame(tmp_path):
    path = tmp_path / "r.txt"
    with MotSink(path) as sink:
        sink.write(make_frame(0), make_tracks([-1], [[1, 2, 4, 6]]))
        sink.write(make_frame(3), make_tracks([-1], [[2, 2, 5, 6.5]]))
        assert path.read_text() == ""
        sink.write(make_frame(6), CONFIRMED)
    assert path.read_text().splitlines() == [
        "7,2,3.00,2.00,3.00,4.00,0.9000,-1,-1,-1",
        "1,2,1.00,2.00,3.00,4.00,0.7500,-1,-1,-1",
        "4,2,2.00,2.00,3.00,4.50,0.5000,-1,-1,-1",
    ]


def test_text_of_a_frame_without_rows_may_give_back(tmp_path):
    with MotSink(tmp_path / "r.txt") as sink:
        sink.write(make_frame(6), replace(make_tracks(), given_back=BACK))
    assert len((tmp_path / "r.txt").read_text().splitlines()) == 2


def _lines(path):
    return [json.loads(line) for line in path.read_text().splitlines()][1:]


def test_json_line_tells_them_with_their_frames(tmp_path):
    path = tmp_path / "t.jsonl"
    with JsonLinesSink(path, {}, ["bus", "car"]) as sink:
        sink.write(make_frame(6), CONFIRMED)
    (line,) = _lines(path)
    assert line["given_back"] == [
        {"frame": 0, "id": 2, "label": 1, "name": "car", "xyxy": [1.0, 2.0, 4.0, 6.0], "score": 0.75},
        {"frame": 3, "id": 2, "label": 1, "name": "car", "xyxy": [2.0, 2.0, 5.0, 6.5], "score": 0.5},
    ]


def test_json_line_without_any_does_not_speak_of_them(tmp_path):
    path = tmp_path / "t.jsonl"
    with JsonLinesSink(path, {}, []) as sink:
        sink.write(make_frame(6), make_tracks([2], [[3, 2, 6, 6]]))
    assert "given_back" not in _lines(path)[0]


def test_class_without_a_name_is_called_by_its_number(tmp_path):
    path = tmp_path / "t.jsonl"
    with JsonLinesSink(path, {}, ["bus"]) as sink:
        sink.write(make_frame(1), replace(make_tracks(), given_back=given_back((0, 1, -4, 0.5, [0, 0, 1, 1]))))
    assert _lines(path)[0]["given_back"][0]["name"] == "-4"


def test_what_is_written_comes_back_with_all_rows(tmp_path):
    path = tmp_path / "t.jsonl"
    with JsonLinesSink(path, {}, ["bus", "car"]) as sink:
        sink.write(make_frame(0), make_tracks([-1, -1], [[1, 2, 4, 6], [9, 9, 12, 12]], labels=[1, 0]))
        sink.write(make_frame(3), make_tracks([-1], [[2, 2, 5, 6.5]], labels=[1]))
        sink.write(make_frame(6), CONFIRMED)
    found = read_jsonl_results(path)
    assert sorted(zip(found.rows.frames.tolist(), found.rows.ids.tolist(), strict=True)) == [(0, 2), (3, 2), (6, 2)]
    assert {found.names[label] for label in found.rows.labels} == {"car"}
    assert found.left_out == {"no identity (yet)": 1}


FILLED = Filled(
    np.array([4, 5]), np.array([2, 2]), np.array([[1, 2, 4, 6], [2, 2, 5, 6]], np.float32), np.array([1, 1])
)


def test_what_is_filled_in_has_score_0_in_the_text(tmp_path):
    with MotSink(tmp_path / "r.txt") as sink:
        sink.write(make_frame(6), replace(CONFIRMED, filled=FILLED))
    assert (tmp_path / "r.txt").read_text().splitlines()[3:] == [
        "5,2,1.00,2.00,3.00,4.00,0.0000,-1,-1,-1",
        "6,2,2.00,2.00,3.00,4.00,0.0000,-1,-1,-1",
    ]


def test_what_is_filled_in_is_read_as_a_result_but_not_as_a_detection(tmp_path):
    path = tmp_path / "t.jsonl"
    with JsonLinesSink(path, {}, ["bus", "car"]) as sink:
        sink.write(make_frame(6), replace(make_tracks([2], [[3, 2, 6, 6]], [0.9], [1]), filled=FILLED))
        sink.write(make_frame(7), make_tracks())
    first, second = _lines(path)
    row = {"id": 2, "label": 1, "name": "car", "score": 0.0}
    assert first["filled"] == [
        {"frame": 4, **row, "xyxy": [1.0, 2.0, 4.0, 6.0]},
        {"frame": 5, **row, "xyxy": [2.0, 2.0, 5.0, 6.0]},
    ]
    assert "filled" not in second
    assert read_jsonl_results(path).rows.frames.tolist() == [6, 4, 5]
    assert read_jsonl_results(path).left_out == {}
    assert read_jsonl_results(path, needs_identity=False).rows.frames.tolist() == [6]
