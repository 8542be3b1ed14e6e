"""`lookonce fit` as a person runs it: a model file comes out, and whatever is wrong is said in one line."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import onnx
import pytest
from PIL import Image

from cli.processes import INTERRUPTIBLE, PLAIN, assert_one_line
from lookonce.cli.stages import StageScreen
from lookonce.model import Model, describe_model
from lookonce.model.metadata import METADATA_KEY
from make.training.scenes import write_labelled, write_resting_clip, write_stills
from squares import picture

COMMAND = [sys.executable, "-c", "from lookonce.cli.app import main; main()"]
FAST = ("--steps", 6, "--check-every", 2, "--identities", 16, "--threads", 1)


@pytest.fixture
def sequence(tmp_path) -> Path:
    return write_labelled(tmp_path / "walk")


@pytest.fixture
def stills(tmp_path) -> Path:
    return write_stills(tmp_path / "stills", range(4))


def test_fit_writes_a_model_file_and_a_record(lookonce, square_model, sequence, stills, tmp_path):
    clip = write_resting_clip(tmp_path / "rest.mp4")
    output = tmp_path / "new" / "out.onnx"
    result = lookonce("fit", sequence, "--stills", stills, "--video", clip, "-m", square_model, "-o", output, *FAST)
    assert result.returncode == 0, result.stderr
    assert describe_model(output).descriptor.kind == "compact"
    assert Model(output, threads=1).detect(picture(0)).descriptors.shape == (3, 128)
    assert "equal error rate" in result.stdout
    assert str(output) in result.stdout
    folder = tmp_path / "new" / "out.fit"
    assert sorted(path.name for path in folder.iterdir()) == [
        "checkpoint.safetensors",
        "curves.png",
        "record.json",
        "run.json",
    ]
    record = json.loads((folder / "record.json").read_text())
    assert len(record["data"]) == 3
    assert record["settings"]["steps"] == 6
    assert record["settings"]["seed"] == 0
    assert record["model"] == {"file": "squares.onnx", "sha256": Model(square_model, threads=1).sha256}
    assert record["versions"]["torch"]
    assert record["validation"]["error_rate"] >= 0


def test_stages_end_with_one_line_each(lookonce, square_model, stills, tmp_path):
    clip = write_resting_clip(tmp_path / "rest.mp4")
    result = lookonce("fit", "--stills", stills, "--video", clip, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    linked, linked_finding, read, read_finding, trained = result.stderr.splitlines()
    assert linked.startswith("link rest.mp4: 24 of ")
    assert linked_finding.startswith("rest.mp4: 12 tracks")
    done, total = (int(word) for word in read.removeprefix("read features: ").split(" of "))
    assert done == total
    assert "readings of" in read_finding
    rate = json.loads((tmp_path / "o.fit" / "record.json").read_text())["validation"]["error_rate"]
    assert trained == f"train: 6 of 6, error rate {rate:.3f}"


def test_flags_go_before_the_file_and_the_file_before_defaults(lookonce, square_model, stills, tmp_path):
    (tmp_path / "fit.toml").write_text('kind = "paper"\nsteps = 3\nseed = 4\nidentities = 8\nlearning_rate = 1\n')
    flags = (
        "--seed",
        5,
        "--check-every",
        2,
        "--threads",
        1,
        "--learning-rate",
        "1e-3",
        "--config",
        tmp_path / "fit.toml",
    )
    result = lookonce("fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *flags)
    assert result.returncode == 0, result.stderr
    settings = json.loads((tmp_path / "o.fit" / "record.json").read_text())["settings"]
    assert (settings["kind"], settings["steps"], settings["seed"], settings["learning_rate"]) == ("paper", 3, 5, 1e-3)
    assert describe_model(tmp_path / "o.onnx").descriptor.kind == "paper"


def test_features_are_kept_on_request_and_used_again(lookonce, square_model, stills, tmp_path):
    arguments = ("fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert lookonce(*arguments).returncode == 0
    assert not (tmp_path / "o.fit" / "features").exists()
    assert lookonce(*arguments, "--overwrite", "--keep-features").returncode == 0
    first = (tmp_path / "o.onnx").read_bytes()
    chunks = {path: path.stat().st_mtime_ns for path in (tmp_path / "o.fit" / "features").iterdir()}
    assert chunks
    again = lookonce(*arguments, "--overwrite", "--keep-features", "--learning-rate", "0.01")
    assert again.returncode == 0, again.stderr
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "o.fit" / "features").iterdir()} == chunks
    assert (tmp_path / "o.onnx").read_bytes() != first
    assert lookonce(*arguments, "--overwrite").returncode == 0
    assert (tmp_path / "o.onnx").read_bytes() == first


def test_a_finished_run_is_in_the_way_until_told_otherwise(lookonce, square_model, stills, tmp_path):
    arguments = ("fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert lookonce(*arguments).returncode == 0
    first = (tmp_path / "o.onnx").read_bytes()
    assert_one_line(lookonce(*arguments), 1, "o.onnx exists", "--overwrite")
    (tmp_path / "o.onnx").unlink()
    assert_one_line(lookonce(*arguments), 1, "o.fit", "there is a run already", "--resume")
    assert lookonce(*arguments, "--resume").returncode == 0
    assert (tmp_path / "o.onnx").read_bytes() == first
    assert_one_line(lookonce(*arguments, "--resume", "--seed", 3), 1, "other data or settings")
    assert_one_line(lookonce("fit", sequence_of(tmp_path), *arguments[1:], "--resume"), 1, "other data or settings")


def sequence_of(folder: Path) -> Path:
    return write_labelled(folder / "another")


def test_resuming_nothing_is_one_line(lookonce, square_model, stills, tmp_path):
    result = lookonce("fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", "--resume")
    assert_one_line(result, 1, "o.fit", "nothing to go on with")
    assert not (tmp_path / "o.fit").exists()


def test_a_folder_of_pictures_is_a_video_too(lookonce, square_model, tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    for index in range(24):
        Image.fromarray(picture(3 * (index // 6))).save(folder / f"{index:06d}.png")
    result = lookonce("fit", "--video", folder, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert result.returncode == 0, result.stderr
    assert "frames: 12 tracks" in result.stderr


def test_pictures_of_a_sequence_may_be_elsewhere(lookonce, square_model, sequence, stills, tmp_path):
    (sequence / "img1").rename(tmp_path / "pictures")
    arguments = ("fit", sequence, "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert_one_line(lookonce(*arguments), 1, "walk")
    assert lookonce(*arguments, "--frames", tmp_path / "pictures").returncode == 0


def test_boxes_half_outside_are_cut_and_boxes_outside_are_left_out(lookonce, square_model, stills, tmp_path):
    extra = "1,7,60,60,20,20,1,-1,-1,-1\n2,7,-10,-10,20,20,1,-1,-1,-1\n1,8,100,100,5,5,1,-1,-1,-1\n"
    sequence = write_labelled(tmp_path / "walk", extra_rows=extra)
    result = lookonce("fit", sequence, "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert result.returncode == 0, result.stderr


def rewrite(path: Path, text: str) -> None:
    path.write_text(text)


BAD_SEQUENCES = {
    "missing pictures": (lambda f: (f / "img1").rename(f / "elsewhere"), ["walk"]),
    "one missing picture": (lambda f: (f / "img1" / "000012.png").unlink(), ["frame 12"]),
    "pictures of two sizes": (lambda f: Image.new("RGB", (9, 9)).save(f / "img1" / "000012.png"), ["9 x 9"]),
    "another stated size": (
        lambda f: rewrite(f / "seqinfo.ini", "[Sequence]\nimWidth=99\nimHeight=64\n"),
        ["99 x 64", "64 x 64"],
    ),
    "truth beyond the pictures": (lambda f: rewrite(f / "gt" / "gt.txt", "99,1,1,1,5,5,1,-1,-1,-1\n"), ["frame 99"]),
    "boxes outside": (lambda f: rewrite(f / "gt" / "gt.txt", "1,1,100,100,5,5,1,-1,-1,-1\n"), ["outside the picture"]),
    "an identity twice": (
        lambda f: rewrite(f / "gt" / "gt.txt", "1,1,1,1,5,5,1,-1,-1,-1\n1,1,9,9,5,5,1,-1,-1,-1\n"),
        ["gt.txt:2", "a second time"],
    ),
    "no truth": (lambda f: rewrite(f / "gt" / "gt.txt", ""), ["gt.txt"]),
    "three identities": (lambda f: None, ["walk", "3 identities", "expected at least 4"]),
    "an entity in XML": (
        lambda f: (
            (f / "gt" / "gt.txt").unlink(),
            rewrite(
                f / "MVI_1.xml",
                '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><sequence name="MVI_1">&b;</sequence>',
            ),
        ),
        ["MVI_1.xml"],
    ),
}


@pytest.mark.parametrize("name", BAD_SEQUENCES)
def test_bad_sequences_are_one_line(lookonce, square_model, sequence, tmp_path, name):
    change, parts = BAD_SEQUENCES[name]
    change(sequence)
    result = lookonce("fit", sequence, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert_one_line(result, 1, *parts)
    assert not (tmp_path / "o.onnx").exists()


BAD_STILLS = {
    "a single picture": (lambda f: [path.unlink() for path in sorted((f / "images").iterdir())[1:]], ["identities"]),
    "two objects": (
        lambda f: [
            rewrite(path, "0 0.5 0.5 0.1 0.1\n" if path.stem in "01" else "") for path in (f / "labels").iterdir()
        ],
        ["identities"],
    ),
    "boxes in px": (lambda f: rewrite(f / "labels" / "0.txt", "0 10 10 5 5\n"), ["0.txt:1", "px"]),
    "no pictures": (lambda f: [path.unlink() for path in (f / "images").iterdir()], ["stills", "no pictures"]),
    "a text for a picture": (lambda f: rewrite(f / "images" / "3.png", "text"), ["3.png"]),
    "a picture that is cut short": (
        lambda f: (f / "images" / "3.png").write_bytes((f / "images" / "3.png").read_bytes()[:90]),
        ["3.png", "remove it"],
    ),
}


@pytest.mark.parametrize("name", BAD_STILLS)
def test_bad_stills_are_one_line(lookonce, square_model, stills, tmp_path, name):
    change, parts = BAD_STILLS[name]
    change(stills)
    result = lookonce("fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert_one_line(result, 1, *parts)


def foreign_model(square_model: Path, path: Path) -> Path:
    """A file that says nothing of features, as somebody else could have made it."""
    model = onnx.load(square_model)
    for prop in model.metadata_props:
        if prop.key == METADATA_KEY:
            prop.value = json.dumps(json.loads(prop.value) | {"features": [], "descriptor": None})
    onnx.save(model, path)
    return path


def test_model_files_that_cannot_be_fitted_are_one_line(lookonce, square_model, stills, tmp_path):
    foreign = foreign_model(square_model, tmp_path / "foreign.onnx")
    (tmp_path / "text.onnx").write_text("hello")
    for path, part in (
        (tmp_path / "gone.onnx", "no such model file"),
        (foreign, "names no features"),
        (tmp_path / "text.onnx", "text.onnx"),
    ):
        result = lookonce("fit", "--stills", stills, "-m", path, "-o", tmp_path / "o.onnx", *FAST)
        assert_one_line(result, 1, path.name, part)
    assert lookonce("fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST).returncode == 0


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        pytest.param("learning_rat = 1", ["learning_rat", "did you mean learning_rate?"], id="misspelt"),
        pytest.param('steps = "many"', ["steps = many", "whole number"], id="wrong type"),
        pytest.param("steps = 0", ["steps=0", "expected 1"], id="out of range"),
        pytest.param("steps", ["not TOML"], id="broken"),
        pytest.param(None, ["check the path"], id="missing"),
    ],
)
def test_bad_settings_files_are_one_line(lookonce, square_model, stills, tmp_path, text, parts):
    path = tmp_path / "fit.toml"
    if text is not None:
        path.write_text(text)
    result = lookonce("fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", "--config", path)
    assert_one_line(result, 1, *parts)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        pytest.param([], ["nothing to learn from", "--stills"], id="no data"),
        pytest.param(["--video", "gone.mp4"], ["gone.mp4", "no such video"], id="no such video"),
        pytest.param(["gone"], ["gone", "no such folder"], id="no such data"),
        pytest.param(["--stills", "gone"], ["gone", "no such folder"], id="no such stills"),
        pytest.param(["--stills", "stills", "stills"], ["no truth", "needs --stills before it"], id="stills as DATA"),
        pytest.param(["--stills", "stills", "--frames", "stills"], ["--frames", "there are 0"], id="frames of nothing"),
        pytest.param(["walk", "walk", "--frames", "stills"], ["--frames", "there are 2"], id="frames of two"),
        pytest.param(["--stills", "stills", "--kind", "best"], ["'best'", "compact or paper"], id="kind"),
        pytest.param(["--stills", "stills", "--device", "cuda"], ["'cuda'", "--device cpu"], id="no cuda"),
        pytest.param(["--stills", "stills", "--device", "abacus"], ["'abacus'", "auto, cpu or cuda"], id="device"),
        pytest.param(["--stills", "stills", "--held-out", "0.9"], ["held_out=0.9"], id="held out"),
        pytest.param(["--stills", "stills", "--learning-rate", "nan"], ["learning_rate=nan"], id="not a number"),
        pytest.param(["--stills", "stills", "-o", "stills"], ["stills", "a folder"], id="output is a folder"),
        pytest.param(["--stills", "stills", "-o", "a.fit"], ["a.fit", "the run's own"], id="output named as the run"),
        pytest.param(["--stills", "stills", "-o", "walk/gt/gt.txt/o.onnx"], ["-o"], id="output below a file"),
    ],
)
def test_what_cannot_work_is_one_line(
    lookonce, square_model, sequence, stills, tmp_path, monkeypatch, arguments, parts
):
    import torch

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.chdir(tmp_path)
    output = [] if "-o" in arguments else ["-o", "o.onnx"]
    assert_one_line(lookonce("fit", *arguments, "-m", square_model, *output, *FAST), 1, *parts)
    assert not (tmp_path / "o.onnx").exists()


def test_a_run_that_failed_early_is_in_nobodys_way(lookonce, square_model, sequence, stills, tmp_path):
    arguments = ("-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert_one_line(lookonce("fit", sequence, *arguments), 1, "3 identities")
    assert lookonce("fit", sequence, "--stills", stills, *arguments).returncode == 0


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["-o", "o.onnx"], id="no model"),
        pytest.param(["-m", "m.onnx"], id="no output"),
        pytest.param(["-m", "m.onnx", "-o", "o.onnx", "--steps", "many"], id="not a number"),
        pytest.param(["-m", "m.onnx", "-o", "o.onnx", "--threads", "0"], id="no threads"),
        pytest.param(["-m", "m.onnx", "-o", "o.onnx", "--frobnicate"], id="unknown option"),
    ],
)
def test_wrong_usage_is_exit_code_2(lookonce, arguments):
    result = lookonce("fit", *arguments)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr


def test_a_video_without_tracks_is_told(lookonce, square_model, square_clip, tmp_path):
    result = lookonce("fit", "--video", square_clip, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    assert result.returncode == 1
    assert "0 tracks" in result.stderr
    assert result.stderr.splitlines()[-1].startswith("lookonce: nothing to learn from")


def test_help_shows_examples_and_every_setting(lookonce):
    from dataclasses import fields

    from lookonce.make.training.config import FitConfig

    text = lookonce("fit", "--help").stdout
    assert "Examples" in text
    assert "lookonce fit MOT17/train -m model.onnx -o model+id.onnx" in text
    for field in fields(FitConfig):
        flag = f"--{field.name.replace('_', '-')}"
        line = next((line for line in text.splitlines() if line.startswith(f"│ {flag} ")), "")
        assert line, flag
        assert field.name == "kind" or f"[{field.default:g}]" in line, f"{flag} has the default {field.default}"


def test_without_the_extra_packages_the_error_names_them(square_model, stills, tmp_path):
    code = "import sys; sys.modules['torch'] = None; from lookonce.cli.app import main; main()"
    command = [sys.executable, "-c", code, "fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx"]
    result = subprocess.run(command, capture_output=True, text=True, env=PLAIN, timeout=60)
    assert_one_line(result, 1, "pip install 'lookonce[train]'", "torch")


def interrupt(arguments: list[object], folder: Path, ready) -> tuple[int, str]:
    """Run the command until ``ready()``, then press Ctrl-C; the exit code and what it said."""
    command = [*INTERRUPTIBLE, *map(str, arguments)]
    with subprocess.Popen(command, env=PLAIN, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and process.poll() is None and not ready():
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=60)
    return process.returncode, stderr


@pytest.mark.parametrize(("stage", "done"), [("read features", 64), ("train", 3)])
def test_an_interrupted_run_goes_on_with_resume(lookonce, square_model, tmp_path, monkeypatch, stage, done):
    stills = write_stills(tmp_path / "stills", range(30))
    arguments = ("fit", "--stills", stills, "-m", square_model, *FAST, "--views", 3)
    assert lookonce(*arguments, "-o", tmp_path / "whole.onnx").returncode == 0
    show = StageScreen.stage

    def press_ctrl_c(self, name, now, total, note=""):
        show(self, name, now, total, note)
        if (name, now) == (stage, done):
            raise KeyboardInterrupt

    monkeypatch.setattr(StageScreen, "stage", press_ctrl_c)
    result = lookonce(*arguments, "-o", tmp_path / "cut.onnx")
    assert result.returncode == 130
    assert "Traceback" not in result.stderr
    assert f"{tmp_path / 'cut.fit'}: keeps what was made so far; go on with --resume" in result.stderr
    monkeypatch.setattr(StageScreen, "stage", show)
    assert lookonce(*arguments, "-o", tmp_path / "cut.onnx", "--resume").returncode == 0
    assert (tmp_path / "cut.onnx").read_bytes() == (tmp_path / "whole.onnx").read_bytes()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
@pytest.mark.parametrize("stage", ["features", "training"])
def test_ctrl_c_keeps_what_was_made_and_resume_goes_on(lookonce, square_model, tmp_path, stage):
    stills = write_stills(tmp_path / "stills", range(30))
    settings = ("--views", 20, "--steps", 3000, "--check-every", 100, "--patience", 1000, "--threads", 1)
    if stage == "features":
        settings = ("--views", 40, "--steps", 4, "--check-every", 2, "--threads", 1)
    folder = tmp_path / "o.fit"
    arguments = ["fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *settings]
    made = folder / ("checkpoint.safetensors" if stage == "training" else "features/chunk-000001.npz")
    code, stderr = interrupt(arguments, folder, made.exists)
    assert code == 130, stderr
    assert "Traceback" not in stderr
    assert f"{folder}: keeps what was made so far; go on with --resume" in stderr
    assert made.exists()
    assert not (tmp_path / "o.onnx").exists()
    before = made.stat().st_mtime_ns
    if stage == "training":
        return  # to the end it would take too long; that it ends with the same bytes is tested elsewhere
    result = lookonce(*arguments, "--resume", "--keep-features")
    assert result.returncode == 0, result.stderr
    assert made.stat().st_mtime_ns == before
    assert (tmp_path / "o.onnx").exists()


def test_file_size_limit_in_mid_features_is_one_line_and_resumable(lookonce, square_model, tmp_path):
    """A real refusal of the operating system, in place of a disk that is really full."""
    pytest.importorskip("resource")
    stills = write_stills(tmp_path / "stills", range(6))
    arguments = ["fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST]
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000)); "
    command = [sys.executable, "-c", limit + COMMAND[-1], *map(str, arguments)]
    limited = subprocess.run(command, capture_output=True, text=True, env=PLAIN, timeout=60)
    assert_one_line(limited, 1, "features", "too large", "--resume")
    assert list((tmp_path / "o.fit" / "features").iterdir()) == []
    assert lookonce(*arguments, "--resume").returncode == 0


class Clock:
    """A clock for the screen that goes when told."""

    def __init__(self, monkeypatch) -> None:
        self.now_s = 0.0
        monkeypatch.setattr("lookonce.cli.stages.time.monotonic", lambda: self.now_s)


def test_lines_come_every_thirty_seconds_and_at_the_end(capsys, monkeypatch):
    clock = Clock(monkeypatch)
    with StageScreen() as screen:
        for done in range(1, 101):
            clock.now_s += 1
            screen.stage("read", done, 100)
        for done in range(1, 4):
            screen.stage("train", done, 1000, "error rate 0.5")
        screen.say("a finding with [brackets]")
        screen.stage("train", 4, None)
    assert capsys.readouterr().err.splitlines() == [
        "read: 31 of 100",
        "read: 61 of 100",
        "read: 91 of 100",
        "read: 100 of 100",
        "train: 3 of 1000, error rate 0.5",
        "a finding with [brackets]",
        "train: 4",
    ]


def test_a_count_beyond_the_estimate_gives_one_closing_line(capsys):
    """The number of frames of a video is an estimate; at that number the stage seemed to end, and again later."""
    with StageScreen() as screen:
        for done in range(1, 9):
            screen.stage("link", done, 5)
    assert capsys.readouterr().err.splitlines() == ["link: 8 of 5"]


def test_an_error_has_the_last_word(capsys):
    def fail() -> None:
        with StageScreen() as screen:
            screen.stage("read", 1, 5)
            raise ValueError("wrong")

    with pytest.raises(ValueError, match="wrong"):
        fail()
    assert capsys.readouterr().err == ""


def test_numbers_of_a_run_agree_with_its_record(lookonce, square_model, stills, tmp_path):
    result = lookonce("fit", "--stills", stills, "-m", square_model, "-o", tmp_path / "o.onnx", *FAST)
    record = json.loads((tmp_path / "o.fit" / "record.json").read_text())
    assert f"{record['identities']} identities learnt" in result.stdout
    assert f"equal error rate {record['validation']['error_rate']:.3f}" in result.stdout
    threshold = describe_model(tmp_path / "o.onnx").descriptor.match_threshold
    assert threshold == pytest.approx(record["validation"]["threshold"], abs=1e-3)
    assert min(record["history"]["error_rate"]) == pytest.approx(record["validation"]["error_rate"])
    assert np.argmin(record["history"]["error_rate"]) < 3
