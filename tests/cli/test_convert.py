"""`lookonce convert`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cli.processes import assert_one_line, lookonce
from lookonce.datasets.detrac_tracks import read_detrac_results
from lookonce.datasets.mot_tracks import read_mot_results

ROWS = ["1,3,10.5,20,30,40.25,0.9,-1,-1,-1", "3,3,12,21,30,40,0.9,-1,-1,-1", "3,7,0,0,5,6,0.5,-1,-1,-1"]


@pytest.fixture
def mot(tmp_path: Path) -> Path:
    path = tmp_path / "MVI_1.txt"
    path.write_text("\n".join(ROWS) + "\n")
    return path


def test_tables_hold_the_same_boxes(mot: Path, tmp_path: Path) -> None:
    result = lookonce("convert", mot, "-o", tmp_path / "out", "--speed", "59.94", "--frames", "4")
    assert result.returncode == 0, result.stderr
    assert "MVI_1: 3 boxes" in result.stdout
    assert (tmp_path / "out" / "MVI_1_LX.txt").read_text() == "10.50,0\n0,0\n12,0\n0,0\n"
    assert (tmp_path / "out" / "MVI_1_H.txt").read_text() == "40.25,0\n0,0\n40,6\n0,0\n"
    assert (tmp_path / "out" / "MVI_1_speed.txt").read_text() == "59.94\n"
    ours, theirs = read_mot_results(mot), read_detrac_results(tmp_path / "out", "MVI_1")
    assert ours.frames.tolist() == theirs.frames.tolist()
    np.testing.assert_allclose(ours.xyxy, theirs.xyxy)
    assert theirs.ids.tolist() == [1, 1, 2]  # columns


def test_a_run_becomes_mot_text(square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    lookonce("track", square_clip, "-m", square_model, "--no-video", "-o", tmp_path / "run")
    result = lookonce("convert", f"squares={tmp_path / 'run' / 'tracks.jsonl'}", "-o", tmp_path / "out", "--to", "mot")
    assert result.returncode == 0, result.stderr
    ours, theirs = read_mot_results(tmp_path / "run" / "tracks.txt"), read_mot_results(tmp_path / "out" / "squares.txt")
    assert sorted(zip(ours.frames.tolist(), ours.ids.tolist(), ours.xyxy.tolist(), strict=True)) == sorted(
        zip(theirs.frames.tolist(), theirs.ids.tolist(), theirs.xyxy.tolist(), strict=True)
    )
    assert lookonce("convert", tmp_path / "run", "-o", tmp_path / "tables").returncode == 0
    assert (tmp_path / "tables" / "run_LX.txt").exists()


def test_results_without_boxes_are_empty_tables(tmp_path: Path) -> None:
    (tmp_path / "empty.txt").write_text("")
    assert lookonce("convert", tmp_path / "empty.txt", "-o", tmp_path / "out").returncode == 0
    assert len(read_detrac_results(tmp_path / "out", "empty")) == 0


def test_what_cannot_be_converted_is_one_line(mot: Path, tmp_path: Path) -> None:
    out = ("-o", tmp_path / "out")
    assert_one_line(lookonce("convert", tmp_path / "nothing", *out), 1, "nothing")
    assert_one_line(lookonce("convert", tmp_path, *out), 1, "tracks.txt")
    assert_one_line(lookonce("convert", mot, *out, "--frames", "2"), 1, "--frames 2")
    lookonce("convert", mot, *out)
    assert_one_line(lookonce("convert", mot, *out), 1, "--overwrite")
    assert lookonce("convert", mot, *out, "--overwrite").returncode == 0
    far = tmp_path / "far.txt"
    far.write_text("\n".join(f"{frame},{frame},1,1,5,5" for frame in (1, 10_000_000, 15_000_000)))
    assert_one_line(lookonce("convert", far, *out), 1, "too many")
