"""Rows that a tracks.jsonl gives back: those of earlier frames only, and each checked as any other row."""

from __future__ import annotations

import json

import pytest

from datasets.making import refusal, write
from lookonce.datasets.jsonl_tracks import read_jsonl_results
from lookonce.errors import FormatError

HEADER = '{"format": "lookonce-tracks", "format_version": 1}\n'
WAITING = '{"frame": 0, "tracks": [{"id": null, "name": "car", "xyxy": [1, 2, 3, 4]}]}\n'


def row(**changes: object) -> dict[str, object]:
    return {"frame": 0, "id": 1, "name": "car", "xyxy": [1, 2, 3, 4], "score": 0.5} | changes


def line(back: object, frame: int = 5, key: str = "given_back") -> str:
    return json.dumps({"frame": frame, "tracks": [], key: back}) + "\n"


def test_rows_given_back_are_rows_of_their_frames(tmp_path):
    text = HEADER + WAITING + line([row(), row(frame=5, id=2)])
    found = read_jsonl_results(write(tmp_path / "t.jsonl", text))
    assert (found.rows.frames.tolist(), found.rows.ids.tolist()) == ([0, 5], [1, 2])
    assert found.left_out == {}


def test_nothing_given_back_may_be_written_as_an_empty_list(tmp_path):
    found = read_jsonl_results(write(tmp_path / "t.jsonl", HEADER + WAITING + line([])))
    assert found.left_out == {"no identity (yet)": 1}


def _without(name):
    return {key: value for key, value in row().items() if key != name}


@pytest.mark.parametrize(
    ("back", "said"),
    [
        pytest.param({"frame": 0}, "given_back: a list of tracks", id="no-list"),
        pytest.param(None, "given_back: a list of tracks", id="null"),
        pytest.param([7], "given_back: tracks with a frame up to 5", id="number"),
        pytest.param([[row()]], "given_back: tracks with a frame up to 5", id="list-in-list"),
        pytest.param([_without("frame")], "given_back: tracks with a frame up to 5", id="no-frame"),
        pytest.param([row(frame=6)], "given_back: tracks with a frame up to 5", id="later-frame"),
        pytest.param([row(frame=-1)], "given_back: tracks with a frame up to 5", id="negative-frame"),
        pytest.param([row(frame=1.5)], "given_back: tracks with a frame up to 5", id="half-frame"),
        pytest.param([row(frame=True)], "given_back: tracks with a frame up to 5", id="true"),
        pytest.param([row(frame="0")], "given_back: tracks with a frame up to 5", id="text"),
        pytest.param([_without("id")], "a track with id, name and xyxy", id="no-id"),
        pytest.param([row(id=-1)], "id: a whole number", id="negative-id"),
        pytest.param([row(name=None)], "name: a text", id="no-name"),
        pytest.param([row(name="a\u0007")], "class name", id="unprintable"),
        pytest.param([row(xyxy=[1, 2, 3])], "xyxy: four numbers", id="three-numbers"),
        pytest.param([row(xyxy=[1, 2, 1e300, 4])], "xyxy: four numbers up to", id="far"),
        pytest.param([row(xyxy=[9, 2, 3, 4])], "left <= right", id="negative-width"),
        pytest.param([row(), row()], "id 1 a second time in frame 0", id="twice"),
    ],
)
def test_bad_rows_are_refused_with_file_and_line(back, said, tmp_path):
    path = write(tmp_path / "t.jsonl", HEADER + WAITING + line(back))
    message = refusal(FormatError, lambda: read_jsonl_results(path))
    assert said in message
    assert "t.jsonl:3:" in message


def test_row_that_its_frame_has_already_is_refused(tmp_path):
    seen = '{"frame": 0, "tracks": [{"id": 1, "name": "car", "xyxy": [1, 2, 3, 4]}]}\n'
    path = write(tmp_path / "t.jsonl", HEADER + seen + line([row()]))
    message = refusal(FormatError, lambda: read_jsonl_results(path))
    assert "t.jsonl:3:" in message
    assert "id 1 a second time in frame 0" in message


def test_row_given_back_without_id_is_no_box_and_hides_no_count(tmp_path):
    """It says nothing new: the row of which it speaks is still without identity."""
    found = read_jsonl_results(write(tmp_path / "t.jsonl", HEADER + WAITING + line([row(id=None)])))
    assert len(found.rows) == 0
    assert found.left_out == {"no identity (yet)": 1}


@pytest.mark.parametrize(
    ("filled", "said"),
    [
        pytest.param({"frame": 0}, "filled: a list of tracks", id="no-list"),
        pytest.param([row(frame=6)], "filled: tracks with a frame up to 5", id="later-frame"),
        pytest.param([row(id=-1)], "id: a whole number", id="negative-id"),
        pytest.param([row(), row()], "id 1 a second time in frame 0", id="twice"),
    ],
)
def test_bad_rows_that_are_filled_in_are_refused_as_well(filled, said, tmp_path):
    path = write(tmp_path / "t.jsonl", HEADER + WAITING + line(filled, key="filled"))
    message = refusal(FormatError, lambda: read_jsonl_results(path))
    assert said in message
    assert "t.jsonl:3:" in message
