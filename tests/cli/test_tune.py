"""`lookonce tune` as a person runs it: a real detector on moving squares."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cli.evaluated import table_row
from cli.processes import INTERRUPTIBLE
from cli.running import Command
from lookonce.cli.app import app
from lookonce.datasets import open_sequences, read_mot_results
from lookonce.evaluation import TrackingResult, TrackingTruth, evaluate_tracking
from lookonce.tracking import DefaultConfig, PaperConfig
from lookonce.tracking.settings import read_tracker_settings
from make.probing.labelled_squares import truth_lines, write_squares

FRAMES = 16

needs_optuna = pytest.mark.usefixtures("optuna")
COMMAND = Command("tune", columns=100)
run, done, refusal = COMMAND.run, COMMAND.done, COMMAND.refusal


@pytest.fixture(scope="session")
def optuna():
    pytest.importorskip("optuna", reason="the extra 'tune' is not installed")


@pytest.fixture(scope="module")
def squares(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_squares(tmp_path_factory.mktemp("data") / "squares", FRAMES)


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("two")
    write_squares(folder / "a", FRAMES)
    write_squares(folder / "b", FRAMES // 2)
    return folder


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Settings under which nothing is ever a new object."""
    path = tmp_path_factory.mktemp("settings") / "blind.toml"
    path.write_text('preset = "default"\nbirth_score = 1.0\n')
    return path


@needs_optuna
def test_what_is_found_is_written_shown_and_taken_by_track(squares, square_model, blind, tmp_path):
    out = tmp_path / "out"
    options = ("--preset", blind, "--only", "birth_score,memory_s,evidence", "--every", "1,2", "--trials", 22)
    result = done(squares, "-m", square_model, "-o", out, *options)
    settings = read_tracker_settings(out / "tuned.toml")
    header, *trials = map(json.loads, (out / "trials.jsonl").read_text().splitlines())
    assert (header["objective"], header["frame_rates"], len(trials)) == ("hota", [1, 2], 22)
    best = max(trials, key=lambda trial: trial["score"])
    assert best["values"]["memory_s"] == settings.memory_s
    assert best["values"]["evidence.hits"] == settings.evidence.hits
    shown = table_row(result.stdout, "memory_s")
    assert shown[:2] == ["8", f"{settings.memory_s:g}"]
    assert shown[2].isdecimal()  # per cent of what mattered
    words = "searched, every 1, before", "held out, every 2, after", "HOTA", "22 trials", "second half is held out"
    for part in words:
        assert part in result.stdout
    assert "search: 22 of 22" in result.stderr
    track = ["track", squares, "-m", square_model, "--tracker", out / "tuned.toml", "--no-video", "-o", tmp_path / "t"]
    assert CliRunner().invoke(app, [*map(str, track)]).exit_code == 0


@needs_optuna
def test_a_trial_scores_what_track_and_eval_say(two, square_model, tmp_path):
    done(two, "-m", square_model, "--trials", 1, "-o", tmp_path, "--holdout", "b", "--objective", "IDF1")
    score = json.loads((tmp_path / "trials.jsonl").read_text().splitlines()[1])["score"]
    track = ["track", two / "a", "-m", square_model, "--no-video", "-o", tmp_path / "t"]
    assert CliRunner().invoke(app, [*map(str, track)]).exit_code == 0
    (sequence,) = open_sequences(two / "a")
    result = TrackingResult.of_rows(read_mot_results(tmp_path / "t" / "tracks.txt"))
    expected = evaluate_tracking(TrackingTruth.of_sequence(sequence, FRAMES), result)
    assert 0 < score == expected.identity.idf1


@pytest.fixture
def det_file(tmp_path: Path) -> Path:
    """The squares of both sequences as others' detections: as many frames as the longer one has, one box missed."""
    rows = [line.split(",") for line in truth_lines(FRAMES)]
    del rows[10]
    path = tmp_path / "det.txt"
    path.write_text("".join(",".join([frame, "-1", *box, "0.9"]) + "\n" for frame, _, *box, _, _, _, _ in rows))
    return path


@needs_optuna
@pytest.mark.parametrize("described", [False, True], ids=["boxes only", "described"])
def test_detections_of_others_score_what_track_and_eval_say(squares, det_file, square_model, tmp_path, described):
    given = ["--detections", det_file, *(["-m", square_model] if described else [])]
    done(squares, *given, "--trials", 1, "-o", tmp_path / "out")
    header, trial = map(json.loads, (tmp_path / "out" / "trials.jsonl").read_text().splitlines())
    assert (header["model"] is None) != described
    assert ("appearance_weight" in trial["values"]) == described
    track = ["track", squares, *given, "--no-video", "--max-frames", FRAMES // 2, "-o", tmp_path / "t"]
    assert CliRunner().invoke(app, [*map(str, track)]).exit_code == 0
    (sequence,) = open_sequences(squares)
    result = TrackingResult.of_rows(read_mot_results(tmp_path / "t" / "tracks.txt"))
    truth = TrackingTruth.of_sequence(sequence, FRAMES)
    searched = truth.in_frames(truth.frames < FRAMES // 2)
    assert 0 < trial["score"] == evaluate_tracking(searched, result).hota.hota
    found = (tmp_path / "out" / "tuned.toml").read_text()
    with_them = ["track", "--source", squares, *given, "--tracker", tmp_path / "out" / "tuned.toml", "--no-video"]
    assert CliRunner().invoke(app, [*map(str, with_them), "-o", str(tmp_path / "u")]).exit_code == 0
    assert "with det.txt" in found
    assert ("match_threshold fits" in found) == described


@needs_optuna
def test_better_settings_are_found_and_hold_on_what_was_held_out(squares, square_model, blind, tmp_path):
    result = done(
        squares, "-m", square_model, "--preset", blind, "--only", "birth_score", "--trials", 3, "-o", tmp_path
    )
    found = read_tracker_settings(tmp_path / "tuned.toml")
    assert isinstance(found, DefaultConfig)
    assert found == replace(read_tracker_settings(blind), birth_score=found.birth_score)
    assert 0.1 <= found.birth_score <= 0.6
    assert "held out: HOTA 0.0 -> " in result.stdout
    assert "a gain beyond noise" in result.stdout
    assert table_row(result.stdout, "birth_score") == ["1", f"{found.birth_score:g}"]


@needs_optuna
def test_settings_that_are_good_already_stay(squares, square_model, tmp_path):
    """Nothing can beat squares that are followed without fault."""
    result = done(squares, "-m", square_model, "--preset", "paper", "--trials", 4, "-o", tmp_path)
    assert "nothing better was found: the settings to begin with are good" in result.stdout
    assert "before" in result.stdout
    assert "after" not in result.stdout
    assert read_tracker_settings(tmp_path / "tuned.toml") == PaperConfig()


@needs_optuna
def test_a_search_goes_on_and_gives_the_same_bytes(squares, square_model, blind, tmp_path):
    options = (squares, "-m", square_model, "--preset", blind, "--seed", 5)
    done(*options, "--trials", 9, "-o", tmp_path / "whole")
    done(*options, "--trials", 3, "-o", tmp_path / "parts")
    done(*options, "--trials", 9, "-o", tmp_path / "parts", "--resume")
    for name in ("trials.jsonl", "tuned.toml"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "parts" / name).read_bytes()


@needs_optuna
def test_earlier_searches_are_neither_mixed_nor_lost(squares, two, square_model, tmp_path):
    options = ("-m", square_model, "--preset", "paper", "--trials", 2, "-o", tmp_path)
    done(squares, *options)
    before = {name: (tmp_path / name).read_bytes() for name in ("trials.jsonl", "tuned.toml")}
    assert "--overwrite" in refusal(squares, *options)
    assert "objective (hota there, idf1 here)" in refusal(squares, *options, "--resume", "--objective", "idf1")
    assert "data" in refusal(two, *options, "--resume")
    assert before == {name: (tmp_path / name).read_bytes() for name in before}
    done(squares, *options, "--overwrite", "--objective", "idf1")
    assert before["trials.jsonl"] != (tmp_path / "trials.jsonl").read_bytes()


@needs_optuna
def test_ctrl_c_keeps_what_is_found(squares, square_model, tmp_path):
    command = [*INTERRUPTIBLE, "tune", squares, "-m", square_model, "-o", tmp_path]
    command += ["--trials", "100000", "--preset", "iou"]
    process = subprocess.Popen(
        [*map(str, command)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TERM": "dumb"},
    )
    trials, limit_s = tmp_path / "trials.jsonl", time.monotonic() + 100
    while not (trials.exists() and trials.read_bytes().count(b"\n") >= 4):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < limit_s
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=100)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert "--resume goes on" in stderr
    lines = trials.read_text().splitlines()
    assert f"{len(lines) - 1} trials" in stdout
    assert all(json.loads(line) for line in lines)
    assert isinstance(read_tracker_settings(tmp_path / "tuned.toml"), DefaultConfig)


@needs_optuna
@pytest.mark.parametrize(
    ("options", "parts"),
    [
        pytest.param(["--objective", "hoto"], ["--objective 'hoto'", "hota, idf1, mota"], id="objective"),
        pytest.param(["--every", "1,1"], ["--every '1,1'", "1,2,4"], id="every"),
        pytest.param(["--every", "0"], ["--every '0'"], id="every none"),
        pytest.param(["--preset", "defualt"], ["'defualt'"], id="preset"),
        pytest.param(["--only", "memry_s"], ["--only 'memry_s'", "did you mean memory_s?"], id="only"),
        pytest.param(["--preset", "paper", "--only", "memory_s"], ["--only", "match_threshold"], id="only of another"),
        pytest.param(["--holdout", "c"], ["--holdout 'c'", "a, b"], id="holdout"),
        pytest.param(["--holdout", "a", "--holdout", "b"], ["nothing is left"], id="all held out"),
        pytest.param(["--classes", "bird"], ["finds none of the classes bird"], id="classes"),
        pytest.param(["--every", "9"], ["no object that counts"], id="too thin"),
        pytest.param(["--frames", "x"], ["fit one only"], id="frames"),
        pytest.param(["--detections", "nowhere.txt"], ["nowhere.txt: no such file"], id="detections"),
    ],
)
def test_wrong_wishes_are_one_line(two, square_model, tmp_path, options, parts):
    message = refusal(two, "-m", square_model, "-o", tmp_path / "out", *options)
    for part in parts:
        assert part in message


@needs_optuna
def test_what_needs_descriptors_is_not_searched_without(squares, det_file, tmp_path):
    given = (squares, "--detections", det_file, "-o", tmp_path / "out")
    assert "has no descriptors" in refusal(*given, "--preset", "paper")
    assert "--only 'appearance_weight'" in refusal(*given, "--only", "appearance_weight")


@needs_optuna
def test_no_truth_and_no_pictures_are_one_line(two, square_model, tmp_path):
    assert "no such folder" in refusal(tmp_path / "none", "-m", square_model, "-o", tmp_path / "out")
    assert "two sequences are called a" in refusal(two, two / "a", "-m", square_model, "-o", tmp_path / "out")


def test_without_optuna_one_line_names_the_remedy(two, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "optuna", None)
    for room in ("proposing", "searching"):
        monkeypatch.delitem(sys.modules, f"lookonce.tuning.{room}", raising=False)
    message = refusal(two, "-o", tmp_path / "out")
    assert message == "tune needs the extra 'tune' (optuna is missing); pip install 'lookonce[tune]'"
    assert not (tmp_path / "out").exists()


def test_the_command_line_starts_without_optuna():
    code = "import sys, lookonce.cli.app; sys.exit('optuna' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
