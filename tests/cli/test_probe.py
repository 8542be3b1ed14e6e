"""`lookonce probe` as a person runs it; what only raises an error is run inside this process, which is faster."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cli.processes import PLAIN, lookonce
from lookonce.cli.app import app
from lookonce.errors import LookonceError
from make.probing.labelled_squares import truth_lines, write_squares, write_truth
from squares import write_darknet

GAPS = ("--min-gap", "1f", "--max-gap", "8f", "--rank-gap", "3f")


def refusal(*arguments: object) -> str:
    """The one line that a wrong input gets."""
    error = CliRunner().invoke(app, ["probe", *map(str, arguments)]).exception
    assert isinstance(error, LookonceError), error
    assert str(error).isprintable()
    return str(error)


@pytest.fixture
def squares(tmp_path: Path) -> Path:
    return write_squares(tmp_path / "squares")


def test_probe_prints_what_it_writes(squares: Path, square_model: Path, tmp_path: Path) -> None:
    result = lookonce("probe", square_model, squares, *GAPS, cwd=tmp_path, columns=80)
    assert result.returncode == 0, result.stderr
    assert result.stderr.splitlines() == ["squares: 12 of 12", "squares, pictures for the sheet: 8 of 8"]
    folder = tmp_path / "runs" / "probe-squares"
    assert sorted(path.name for path in folder.iterdir()) == ["distances.png", "neighbours.png", "probe.json"]
    content = json.loads((folder / "probe.json").read_text())
    assert content["match_threshold"] == {"value": 0.7, "source": "setting"}
    for text in (
        "squares.onnx on squares",
        "36 boxes of 3 identities",
        "180 of one object, 360 of two, 1 to 8 frames apart",
        "1.000 after 3 frames (chance 0.333; 27 queries)",
        "0.700 (preset paper; the model file is not calibrated)",
        "same grid and anchor",
        "Too few pairs to say",
        "probe.json",
    ):
        assert text in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80


def test_several_sequences_get_a_line_each(squares: Path, square_model: Path, tmp_path: Path) -> None:
    other = write_squares(tmp_path / "other", 8)
    result = lookonce("probe", square_model, squares, other, "--boxes", "detections", *GAPS, "-o", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    assert "100.0% of 60 truth boxes, at score 0.1" in result.stdout
    (line,) = (line for line in result.stdout.splitlines() if line.lstrip().startswith("other"))
    assert line.split()[:6] == ["other", "24", "3", "1.000", "1.000", "0.333"]


def test_defaults_fit_a_video_of_any_rate(square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    truth = write_truth(tmp_path / "clip", truth_lines())
    result = lookonce("probe", square_model, truth, "--frames", square_clip, "-o", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    assert "0.5 to 30 s apart" in result.stdout
    assert "- (no object is seen again after 2 s)" in result.stdout


def test_a_wrong_input_is_one_line(squares: Path, square_model: Path, tmp_path: Path) -> None:
    result = lookonce("probe", square_model, squares, "--min-gap", "5s", "-o", tmp_path / "out")
    assert result.returncode == 1
    assert "one and the same object" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_earlier_results_are_kept_unless_told_otherwise(squares: Path, square_model: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "probe.json").write_text("earlier")
    arguments = (square_model, squares, *GAPS, "-o", tmp_path / "out")
    message = refusal(*arguments)
    assert "probe.json exists" in message
    assert "--overwrite" in message
    assert (tmp_path / "out" / "probe.json").read_text() == "earlier"
    assert CliRunner().invoke(app, ["probe", *map(str, arguments), "--overwrite"]).exit_code == 0
    assert json.loads((tmp_path / "out" / "probe.json").read_text())["overall"]["objects"] == 36


def test_a_model_without_descriptors_is_refused_before_anything_is_written(squares: Path, tmp_path: Path) -> None:
    cfg, weights, _ = write_darknet(tmp_path)
    runner = CliRunner()
    runner.invoke(app, ["import", str(cfg), str(weights), "--no-descriptors", "-o", str(tmp_path / "plain.onnx")])
    message = refusal(tmp_path / "plain.onnx", squares, "-o", tmp_path / "out")
    assert "has no descriptors" in message
    assert "lookonce fit" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(["--min-gap", "soon"], "gap 'soon': expected frames such as 30f", id="gap"),
        pytest.param(["--min-gap", "30f"], "give both in frames", id="mixed-gaps"),
        pytest.param(["--boxes", "both"], "boxes 'both'", id="boxes"),
        pytest.param(["--classes", "unicorn"], "class 'unicorn' is not in the data; it has object", id="class"),
        pytest.param(["--provider", "abacus"], "'abacus'", id="provider"),
        pytest.param(["--frames", "nowhere.avi"], "nowhere.avi: no such pictures", id="pictures"),
    ],
)
def test_settings_that_cannot_work_are_one_line(options, message, squares, square_model, tmp_path) -> None:
    assert message in refusal(square_model, squares, "-o", tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options", [["--score", "2"], ["--every", "0"], ["--threads", "0"], ["--frobnicate"]])
def test_wrong_usage_is_exit_code_2(options: list[str], squares: Path, square_model: Path) -> None:
    assert CliRunner().invoke(app, ["probe", str(square_model), str(squares), *options]).exit_code == 2


def test_data_without_identities_is_refused(squares: Path, square_model: Path, tmp_path: Path) -> None:
    write_truth(squares, [",".join([line.split(",")[0], "-1", *line.split(",")[2:]]) for line in truth_lines()])
    assert "these are detections, not truth" in refusal(square_model, squares, "-o", tmp_path / "out")
    (tmp_path / "stills" / "labels").mkdir(parents=True)
    assert "no truth is recognised" in refusal(square_model, tmp_path / "stills", "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_sizes_that_differ_from_what_the_truth_says_are_refused(squares: Path, square_model: Path) -> None:
    (squares / "seqinfo.ini").write_text("[Sequence]\nframeRate=10\nimWidth=640\nimHeight=64\n")
    assert "says that the pictures have 640 x 64 px" in refusal(square_model, squares)


def test_pictures_of_one_sequence_do_not_fit_two(squares: Path, square_model: Path, square_clip: Path) -> None:
    message = refusal(square_model, squares, squares, "--frames", square_clip)
    assert "--frames fits one sequence only" in message
    assert "squares is given twice" in refusal(square_model, squares, squares)


def test_probe_without_the_extra_says_what_to_install(squares: Path, square_model: Path) -> None:
    command = "import sys; sys.modules['onnx_ir'] = None; from lookonce.cli.app import main; main()"
    arguments = [sys.executable, "-c", command, "probe", str(square_model), str(squares)]
    result = subprocess.run(arguments, capture_output=True, text=True, env=PLAIN, timeout=120)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert "probe needs the extra 'train' (onnx_ir is missing); pip install 'lookonce[train]'" in line


def test_probe_has_help_and_examples() -> None:
    result = lookonce("probe", "--help")
    assert result.returncode == 0
    assert "Examples" in result.stdout
    assert "lookonce probe model.onnx" in result.stdout
