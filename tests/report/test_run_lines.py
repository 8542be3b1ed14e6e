"""What tracks.jsonl says beside identities."""

from __future__ import annotations

from pathlib import Path

import pytest

from datasets.making import refusal, write
from lookonce.errors import FormatError
from lookonce.report.run_lines import read_mot_lines, read_run_lines
from report.scenes import TRACKS_HEADER, write_lines


def track(**fields: object) -> dict[str, object]:
    return {"id": 1, "label": 0, "name": "car", "xyxy": [0, 0, 4, 4], "score": 0.5, **fields}


def test_all_detections_are_read_with_identity_or_without(tmp_path: Path):
    header = TRACKS_HEADER | {
        "versions": {"lookonce": "1.2"},
        "model": {"file": "m.onnx", "sha256": "ab"},
        "detections": {"file": "det.txt"},
        "settings": {"source": "a.mp4", "tracker": "paper", "score": 0.25, "fps": None},
    }
    path = write_lines(
        tmp_path / "tracks.jsonl",
        header,
        {"frame": 3, "time_s": 0.5, "size": [48, 64], "tracks": [track(), track(id=None, name="bus", score=None)]},
        {
            "frame": 5,
            "time_s": None,
            "size": [48, 64],
            "tracks": [track(xyxy=[0, 0, 0, 4]), track(xyxy=[0, 0, None, 4])],
        },
        {"frame": 6, "tracks": [], "given_back": [{"frame": 3, **track(id=9)}]},
    )
    lines = read_run_lines(path)
    assert lines.row_frames.tolist() == [3, 3]
    assert lines.ids.tolist() == [1, -1]
    assert lines.scores.tolist() == [0.5, 1.0]
    assert [lines.names[label] for label in lines.labels] == ["car", "bus"]
    assert lines.frames.tolist() == [3, 5, 6]
    assert (lines.times_s, lines.size, lines.source, lines.given_back) == ({3: 0.5}, (48, 64), "a.mp4", 1)
    assert lines.facts == {
        "source": "a.mp4",
        "detections": "det.txt",
        "model": "m.onnx",
        "model SHA-256": "ab",
        "tracker": "paper",
        "lookonce": "1.2",
        "score": "0.25",
    }


@pytest.mark.parametrize(
    ("record", "said"),
    [
        pytest.param({"frame": 0, "tracks": [track(name=3)]}, "name", id="name"),
        pytest.param({"frame": 0, "tracks": [track(score="x")]}, "score", id="score"),
        pytest.param({"frame": 0, "size": [1], "tracks": []}, "size", id="size"),
        pytest.param({"frame": 0, "size": [True, 4], "tracks": []}, "size", id="bool-size"),
        pytest.param({"tracks": []}, "frame", id="frame"),
    ],
)
def test_faults_are_named_by_line(record, said, tmp_path: Path):
    path = write_lines(tmp_path / "tracks.jsonl", TRACKS_HEADER, record)
    message = refusal(FormatError, lambda: read_run_lines(path))
    assert message.startswith(f"{path}:2: ")
    assert said in message


def test_hostile_header_is_refused_or_shortened(tmp_path: Path):
    path = write_lines(tmp_path / "tracks.jsonl", TRACKS_HEADER | {"settings": {"source": "x" * 100_000}})
    assert len(read_run_lines(path).source) == 1000
    path = write_lines(tmp_path / "tracks.jsonl", TRACKS_HEADER | {"model": [1]})
    assert "model" in refusal(FormatError, lambda: read_run_lines(path))


def test_boxes_of_score_0_are_no_detections(tmp_path: Path):
    """They fill a gap in which nobody detected the object; the other file of the same run lists them apart."""
    path = write(
        tmp_path / "a.txt", "1,7,0,0,4,4,0.25,-1,-1,-1\n2,7,0,0,4,4,0.0000,-1,-1,-1\n3,7,0,0,4,4,0.5,-1,-1,-1\n"
    )
    assert read_mot_lines(path).row_frames.tolist() == [0, 2]


def test_mot_text_has_scores_and_no_classes(tmp_path: Path):
    path = write(tmp_path / "a.txt", "1,7,0,0,4,4,0.25,-1,-1,-1\n2,7,0,0,0,4,0.5,-1,-1,-1\n")
    lines = read_mot_lines(path)
    assert (lines.row_frames.tolist(), lines.scores.tolist(), lines.names) == ([0], [0.25], ())
    assert lines.frames.tolist() == [0, 1]
