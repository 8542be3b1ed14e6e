import json
from pathlib import Path

import numpy as np
import pytest

from lookonce.output import JsonLinesSink
from output.scenes import make_frame, make_tracks

NAMES = ("person", "Straßenbahn 🚋", "自転車")


def _refuse(word: str) -> None:
    raise AssertionError(f"{word} is not JSON")


def _parsed(path: Path) -> list[dict]:
    text = path.read_bytes().decode("utf-8")
    assert text.endswith("\n")
    return [json.loads(line, parse_constant=_refuse) for line in text.splitlines()]


def _frame_line(path: Path, tracks, frame=None) -> dict:
    with JsonLinesSink(path, {}, NAMES) as sink:
        sink.write(frame or make_frame(), tracks)
    return _parsed(path)[1]


def test_header_comes_back_as_given_beside_the_format(tmp_path):
    path = tmp_path / "t.jsonl"
    header = {"lookonce": "0.1.0", "model": {"sha256": "ab" * 32, "names": list(NAMES)}, "tracker": {"memory_s": 2.5}}
    JsonLinesSink(path, header, NAMES).close()
    first = _parsed(path)[0]
    assert {key: first[key] for key in header} == header
    assert first["format"] == "lookonce-tracks"
    assert first["format_version"] == 1
    assert "xyxy" in first["coordinates"]


def test_frame_line_says_all_of_a_frame(tmp_path):
    tracks = make_tracks([4, -1], [[1.006, 2, 30.1, 40.126], [0, 0, 5, 5]], [0.98766, 0.3], [2, 0])
    line = _frame_line(tmp_path / "t.jsonl", tracks, make_frame(12, 0.48000049, 60, 80))
    assert line == {
        "frame": 12,
        "time_s": 0.48,
        "size": [60, 80],
        "tracks": [
            {"id": 4, "label": 2, "name": "自転車", "xyxy": [1.01, 2.0, 30.1, 40.13], "score": 0.9877},
            {"id": None, "label": 0, "name": "person", "xyxy": [0.0, 0.0, 5.0, 5.0], "score": 0.3},
        ],
    }


def test_frame_without_objects_has_a_line(tmp_path):
    assert _frame_line(tmp_path / "t.jsonl", make_tracks()) == {
        "frame": 0,
        "time_s": 0.0,
        "size": [60, 80],
        "tracks": [],
    }


def test_unseen_objects_are_told_only_when_there_are_any(tmp_path):
    line = _frame_line(tmp_path / "t.jsonl", make_tracks(unseen=[(9, [1, 2, 3, 4.5])]))
    assert line["unseen"] == [{"id": 9, "xyxy": [1.0, 2.0, 3.0, 4.5]}]


def test_numbers_that_are_not_finite_become_null(tmp_path):
    tracks = make_tracks([1], [[np.nan, -np.inf, np.inf, 4]], [np.nan], unseen=[(2, [np.nan] * 4)])
    line = _frame_line(tmp_path / "t.jsonl", tracks, make_frame(time_s=float("nan")))
    assert line["time_s"] is None
    assert line["tracks"][0]["xyxy"] == [None, None, None, 4.0]
    assert line["tracks"][0]["score"] is None
    assert line["unseen"][0]["xyxy"] == [None] * 4


def test_small_negative_numbers_are_zero_without_a_sign(tmp_path):
    path = tmp_path / "t.jsonl"
    _frame_line(path, make_tracks([1], [[-0.001, -0.002, 1, 1]]))
    assert "-0.0" not in path.read_text()


@pytest.mark.parametrize("label", [pytest.param(3, id="beyond the names"), pytest.param(-1, id="negative")])
def test_class_without_a_name_is_called_by_its_number(tmp_path, label):
    line = _frame_line(tmp_path / "t.jsonl", make_tracks([1], [[0, 0, 1, 1]], labels=[label]))
    assert line["tracks"][0]["name"] == str(label)


def test_names_that_have_no_utf8_leave_the_line_valid(tmp_path):
    path = tmp_path / "t.jsonl"
    with JsonLinesSink(path, {}, ["broken \udc80\nname"]) as sink:
        sink.write(make_frame(), make_tracks([1], [[0, 0, 1, 1]]))
    assert _parsed(path)[1]["tracks"][0]["name"] == "broken ?\nname"


def test_file_is_valid_after_each_frame_without_closing(tmp_path):
    path = tmp_path / "t.jsonl"
    sink = JsonLinesSink(path, {"seed": 1}, NAMES)
    assert len(_parsed(path)) == 1
    for index in range(3):
        sink.write(make_frame(index), make_tracks([1], [[0, 0, 1, 1]]))
        assert [line["frame"] for line in _parsed(path)[1:]] == list(range(index + 1))
    sink.close()
    sink.close()


@pytest.mark.parametrize(
    ("header", "error"),
    [
        pytest.param({"format": "mine"}, ValueError, id="key of the format"),
        pytest.param({"threshold": float("nan")}, ValueError, id="NaN"),
        pytest.param({"folder": Path()}, TypeError, id="not JSON"),
    ],
)
def test_wrong_header_is_refused_before_a_file_exists(tmp_path, header, error):
    path = tmp_path / "t.jsonl"
    with pytest.raises(error):
        JsonLinesSink(path, header, NAMES)
    assert not path.exists()
