"""`lookonce track --explain` and `lookonce explain`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cli.processes import lookonce
from cli.running import Command
from lookonce.stories import DECISIONS

EXPLAIN = Command("explain", columns=200)
done, refusal = EXPLAIN.done, EXPLAIN.refusal


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
    told = done(explained, "--id", min(ids)).stdout
    assert told.startswith(f"id {min(ids)}: ")
    assert "confirmed" in told
    assert "999" in refusal(explained, "--id", 999)


def test_the_story_has_all_rows_of_the_results(explained: Path) -> None:
    lines = [line.split(",") for line in (explained / "tracks.txt").read_text().splitlines()]
    identity = lines[0][1]
    frames = sorted(int(line[0]) - 1 for line in lines if line[1] == identity)
    told = done(explained, "--id", identity).stdout
    assert told.startswith(f"id {identity}: {len(frames)} detections from frame {frames[0]} ")
    assert f"the id goes back to frame {frames[0]}" in told


def test_gaps_and_better_rivals_are_told(tmp_path: Path) -> None:
    """A rival that fits better is no candidate that a rule refused, and is never said to be behind."""
    refused = {"id": 9, "cost": -7.0, "refused": "a score of 0.20 has to overlap by 0.3"}
    better = {"id": 4, "cost": -6.0, "refused": "taken by row 5"}
    row = {"id": 7, "decision": "refound", "reason": "id 7 again", "candidates": [{"id": 7, "cost": -3.5}]}
    beside = {**row, "decision": "kept", "candidates": [*row["candidates"], {"id": 3, "cost": -3.1}, refused]}
    row["candidates"] += [refused, better]
    records = [
        {"format": "lookonce-explain", "format_version": 1},
        {"frame": 9, "rows": [beside]},
        {
            "frame": 13,
            "rows": [row],
            "filled": [{"frame": 11, "id": 7}, {"frame": 10, "id": 7}, {"frame": 10, "id": 3}],
        },
    ]
    (tmp_path / "explain.jsonl").write_text("\n".join(map(json.dumps, records)))
    assert done(tmp_path, "--id", 7).stdout.splitlines() == [
        "id 7: 2 detections from frame 9 to frame 13, missed and filled in 2 frames between.",
        "  frame 9: in doubt, id 3 was only 0.4 behind; id 7 again.",
        "  frame 13: refound, id 7 again; in doubt, id 4 fitted better by 2.5, but was taken by row 5; "
        "boxes filled in for 2 frames from 10 to 11.",
    ]


def test_the_story_says_why_an_identity_began_and_who_else_came_near(tmp_path: Path) -> None:
    """Two detections beside each other, one of which is object 1 as before; the other one is a new object."""
    own = {"id": 1, "decision": "kept", "reason": "id 1 as before", "candidates": [{"id": 1, "cost": -4.8}]}
    refused = {"id": 1, "cost": -4.7, "refused": "taken by row 0"}
    new = {"id": None, "decision": "new", "reason": "no known object fits", "candidates": [refused]}
    confirmed = {"id": 2, "decision": "confirmed", "reason": "gets id 2", "candidates": [{"id": 2, "cost": -6}]}
    records = [
        {"format": "lookonce-explain", "format_version": 1},
        {"frame": 20, "rows": [own, new]},
        {"frame": 21, "rows": [confirmed], "given_back": [{"frame": 20, "row": 1, "id": 2}]},
    ]
    (tmp_path / "explain.jsonl").write_text("\n".join(map(json.dumps, records)))
    assert done(tmp_path, "--id", 2).stdout.splitlines() == [
        "id 2: 2 detections from frame 20 to frame 21.",
        "  frame 20: new, no known object fits; not id 1: taken by row 0.",
        "  frame 21: confirmed, gets id 2; the id goes back to frame 20.",
    ]
    assert (
        "  frame 20: in doubt, row 1 fitted only 0.1 worse; id 1 as before."
        in done(tmp_path, "--id", 1).stdout.splitlines()
    )
    assert "id 1: in doubt or refound in 1 frames" in done(tmp_path).stdout


def test_a_frame_has_its_decisions(explained: Path) -> None:
    told = done(explained, "--frame", 0).stdout.splitlines()
    assert told[0] == "frame 0 (0.00 s): 3 detections"
    assert all("new; no known object fits" in line for line in told[1:])
    assert "frames 0 to 11" in refusal(explained, "--frame", 99)


def test_without_a_question_the_doubts_are_listed(explained: Path) -> None:
    assert done(explained).stdout.startswith("12 frames, frames 0 to 11: ")


def test_what_cannot_be_explained_is_one_line(square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    assert "--explain" in refusal(tmp_path)
    (tmp_path / "explain.jsonl").write_text("hello")
    assert "explain.jsonl" in refusal(tmp_path)
    arguments = ("-m", square_model, "--tracker", "paper", "--explain", "-o", tmp_path / "out")
    assert "paper" in Command("track").refusal(square_clip, *arguments)
