"""tracks.jsonl, as written by the package and as anybody may hand it over."""

from __future__ import annotations

import json

import numpy as np
import pytest

from datasets.making import refusal, write
from lookonce.datasets.jsonl_tracks import read_jsonl_results
from lookonce.errors import FormatError
from lookonce.output import JsonLinesSink
from lookonce.structures import Tracks
from lookonce.video import Frame

HEADER = '{"format": "lookonce-tracks", "format_version": 1}\n'


def track(**changes: object) -> str:
    return json.dumps({"id": 1, "name": "car", "xyxy": [1, 2, 3, 4], "score": 0.5} | changes)


def line(*tracks: str, frame: object = 0) -> str:
    return f'{{"frame": {frame}, "tracks": [{", ".join(tracks)}]}}\n'


def test_what_the_sink_writes_comes_back(tmp_path):
    boxes = np.array([[1, 2, 3, 4], [5, 6, 7.25, 8], [0, 0, 9, 9]], np.float32)
    scores, labels = np.array([0.5, 0.25, 1], np.float32), np.array([1, 0, 1])
    tracks = Tracks(np.array([7, 3, -1]), boxes, scores, labels, np.array([9]), boxes[:1])
    with JsonLinesSink(tmp_path / "tracks.jsonl", {}, ["bus", "car"]) as sink:
        sink.write(Frame(4, 0.1, np.zeros((10, 10, 3), np.uint8)), tracks)
    found = read_jsonl_results(tmp_path / "tracks.jsonl")
    assert found.rows.frames.tolist() == [4, 4]
    assert found.rows.ids.tolist() == [7, 3]
    assert [found.names[label] for label in found.rows.labels] == ["car", "bus"]
    assert found.rows.xyxy.tolist() == boxes[:2].tolist()
    assert found.rows.flags.tolist() == [0.5, 0.25]
    assert found.left_out == {"no identity (yet)": 1}


def test_a_header_alone_is_a_result_without_boxes(tmp_path):
    found = read_jsonl_results(write(tmp_path / "t.jsonl", HEADER))
    assert len(found.rows) == 0
    assert found.rows.xyxy.shape == (0, 4)


def test_a_box_with_a_number_that_was_not_finite_is_counted(tmp_path):
    found = read_jsonl_results(write(tmp_path / "t.jsonl", HEADER + line(track(xyxy=[None, 0, 1, 1]))))
    assert found.left_out == {"a number that is not finite": 1}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        pytest.param("", "expected a header", id="empty"),
        pytest.param("1,2,3\n", "no JSON", id="mot"),
        pytest.param(HEADER.replace("1}", "2}"), "format_version: expected 1", id="version"),
        pytest.param(HEADER + line(track())[:-9], ":2: no JSON, or cut short", id="cut"),
        pytest.param(HEADER + "[" * 9000 + "\n", "no JSON", id="deep"),
        pytest.param(HEADER + "[]\n", "expected a JSON object", id="list"),
        pytest.param(HEADER + line(track(), frame=-1), "expected frame", id="frame"),
        pytest.param(HEADER + line(track(), frame=10**30), "expected frame", id="late"),
        pytest.param(HEADER + line(track(), frame="1" * 5000), "no JSON", id="digits"),
        pytest.param(HEADER + line(track(), track()), "id 1 a second time in frame 0", id="twice"),
        pytest.param(HEADER + line(track(xyxy=[0, 0, 1])), "xyxy: four numbers", id="short"),
        pytest.param(HEADER + line(track(xyxy=[5, 0, 1, 1])), "left <= right", id="negative"),
        pytest.param(HEADER + line(track(xyxy=[0, 0, 1e300, 1])), "xyxy: four numbers up to", id="far"),
        pytest.param(HEADER + line(track()).replace("0.5", "NaN"), "no JSON", id="nan"),
        pytest.param(HEADER + line(track(name=3)), "name: a text", id="name"),
        pytest.param(HEADER + line(track(name="a\u0007")), "class name", id="unprintable"),
        pytest.param(HEADER + line(track(id=True)), "id: a whole number", id="id"),
        pytest.param(HEADER + line("7"), "a track with id, name and xyxy", id="number"),
    ],
)
def test_faults_name_file_and_line(text, said, tmp_path):
    path = write(tmp_path / "t.jsonl", text)
    message = refusal(FormatError, lambda: read_jsonl_results(path))
    assert said in message
    assert "t.jsonl" in message
