"""`lookonce track --explain` and `lookonce explain`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cli.processes import assert_one_line, lookonce
from lookonce.stories import DECISIONS


@pytest.fixture(scope="module")
def explained(square_clip: Path, square_model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with its reasons."""
    out = tmp_path_factory.mktemp("explained") / "out"
    result = lookonce("track", square_clip, "-m", square_model, "--no-video", "--explain", "-o", out)
    assert result.returncode == 0, result.stderr
    return out


def test_every_detection_of_every_frame_is_explained(explained: Path) -> None:
    header, *frames = map(json.loads, (explained / "explain.jsonl").read_text().splitlines())
    tracks = [json.loads(line) for line in (explained / "tracks.jsonl").read_text().splitlines()][1:]
    assert header["format"] == "lookonce-explain"
    assert len(frames) == 12
    for told, frame in zip(frames, tracks, strict=True):
        assert [row["id"] for row in told["rows"]] == [track["id"] for track in frame["tracks"]]
        assert [row["xyxy"] for row in told["rows"]] == [track["xyxy"] for track in frame["tracks"]]
        assert all(row["decision"] in DECISIONS and row["reason"] for row in told["rows"])
        for row in told["rows"]:
            if row["decision"] in ("kept", "refound"):
                assert row["candidates"][0]["id"] == row["id"]
                assert row["candidates"][0]["refused"] is None
    assert {row["decision"] for row in frames[0]["rows"]} == {"new"}


def test_explaining_changes_no_result(explained: Path, square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    lookonce("track", square_clip, "-m", square_model, "--no-video", "-o", tmp_path)
    for name in ("tracks.txt", "tracks.jsonl"):
        assert (tmp_path / name).read_bytes() == (explained / name).read_bytes()


def test_an_identity_has_a_story(explained: Path) -> None:
    ids = {int(line.split(",")[1]) for line in (explained / "tracks.txt").read_text().splitlines()}
    told = lookonce("explain", explained, "--id", min(ids)).stdout
    assert told.startswith(f"id {min(ids)}: ")
    assert "confirmed" in told
    assert_one_line(lookonce("explain", explained, "--id", 999), 1, "999")


def test_a_frame_has_its_decisions(explained: Path) -> None:
    told = lookonce("explain", explained, "--frame", 0).stdout.splitlines()
    assert told[0] == "frame 0 (0.00 s): 3 detections"
    assert all("new; no known object fits" in line for line in told[1:])
    assert_one_line(lookonce("explain", explained, "--frame", 99), 1, "frames 0 to 11")


def test_without_a_question_the_doubts_are_listed(explained: Path) -> None:
    assert lookonce("explain", explained).stdout.startswith("12 frames, frames 0 to 11: ")


def test_what_cannot_be_explained_is_one_line(square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    assert_one_line(lookonce("explain", tmp_path), 1, "--explain")
    (tmp_path / "explain.jsonl").write_text("hello")
    assert_one_line(lookonce("explain", tmp_path), 1, "explain.jsonl")
    arguments = ("-m", square_model, "--tracker", "paper", "--explain", "-o", tmp_path / "out")
    assert_one_line(lookonce("track", square_clip, *arguments), 1, "paper")
