"""Rows that are given back name frames of the source, also where only some of them are looked at."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

import lookonce
from lookonce.datasets.jsonl_tracks import read_jsonl_results
from lookonce.output import JsonLinesSink, MotSink
from lookonce.pipeline import track_video, tracker_for
from lookonce.video import open_video
from squares import picture


@pytest.fixture
def standing(tmp_path: Path) -> Path:
    """Three squares that stand still for ten pictures."""
    folder = tmp_path / "standing"
    folder.mkdir()
    for number in range(10):
        Image.fromarray(picture(1)).save(folder / f"{number:02d}.png")
    return folder


@pytest.mark.parametrize(("every", "frames"), [(1, list(range(10))), (3, [0, 3, 6, 9])])
def test_frames_given_back_are_those_of_the_source(
    standing: Path, square_model: Path, every: int, frames: list[int]
) -> None:
    answers = list(lookonce.track(standing, square_model, every=every, fps=25))
    assert [frame.index for frame in answers] == frames
    assert answers[0].tracks.ids.tolist() == [-1, -1, -1]
    assert all(frame.tracks.ids.tolist() == [1, 2, 3] for frame in answers[1:])
    back = answers[1].tracks.given_back
    assert (back.frames.tolist(), back.rows.tolist(), back.ids.tolist()) == ([0, 0, 0], [0, 1, 2], [1, 2, 3])
    assert back.xyxy.tolist() == answers[0].tracks.xyxy.tolist()
    assert sum(len(frame.tracks.given_back) for frame in answers) == 3


def test_start_is_no_frame_0(standing: Path, square_model: Path) -> None:
    answers = list(lookonce.track(standing, square_model, every=3, fps=25, start_s=0.15))
    first = answers[0].index
    assert first > 0
    assert answers[1].tracks.given_back.frames.tolist() == [first] * 3


def test_files_have_every_row_of_every_frame(standing: Path, square_model: Path, tmp_path: Path) -> None:
    model = lookonce.Model(square_model)
    text, lines = tmp_path / "tracks.txt", tmp_path / "tracks.jsonl"
    with (
        open_video(standing, every=3, fps=25) as video,
        MotSink(text) as mot,
        JsonLinesSink(lines, {}, model.names) as js,
    ):
        for _ in track_video(video, model, tracker_for(model), sinks=[mot, js]):
            pass
    every_row = [(frame, identity) for frame in (0, 3, 6, 9) for identity in (1, 2, 3)]
    rows = [line.split(",") for line in text.read_text().splitlines()]
    assert sorted((int(row[0]) - 1, int(row[1])) for row in rows) == every_row
    found = read_jsonl_results(lines)
    assert sorted(zip(found.rows.frames.tolist(), found.rows.ids.tolist(), strict=True)) == every_row
    assert found.left_out == {}
