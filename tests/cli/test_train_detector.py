"""`lookonce train-detector` as a person runs it: a model file comes out, and what is wrong is said in one line."""

from __future__ import annotations

import inspect
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from cli.processes import PLAIN, Result, assert_one_line
from darknet_files import TINY, write_network
from lookonce.cli.detecting import train_detector_command
from lookonce.cli.stages import StageScreen
from lookonce.errors import ConfigError
from lookonce.make.detector import learning, train
from lookonce.make.detector.settings import DetectorConfig
from lookonce.model import Model, describe_model
from lookonce.video import VideoWriter
from make.detector.rectangles import NAMES, one_grid, scene, write_rectangles
from make.training.scenes import write_labelled
from model_runs import run_file
from squares import picture

COMMAND = "from lookonce.cli.app import main; main()"
FAST = ("--epochs", 2, "--batch", 8, "--check-every", 1, "--precision", "32-true", "--threads", 1)


@pytest.fixture(autouse=True)
def _quick_looks(monkeypatch):
    """Looks in the middle of a training take a second each, and are tested elsewhere."""
    figures = SimpleNamespace(mean=SimpleNamespace(ap=0.25, ap50=0.5))
    monkeypatch.setattr(learning, "look", lambda *_, **__: figures)


@pytest.fixture
def stills(tmp_path) -> Path:
    return write_rectangles(tmp_path / "boxes", 16)


@pytest.fixture
def net(tmp_path) -> Path:
    (tmp_path / "net.cfg").write_text(one_grid(channels=4))
    return tmp_path / "net.cfg"


@pytest.fixture
def _no_training(monkeypatch):
    """What comes before it is done; then ``enough`` is said."""

    def enough(*_, **__):
        raise ConfigError("enough")

    monkeypatch.setattr(train, "learn", enough)


def assert_last_line(result: Result, *parts: str) -> None:
    """An error that comes after some progress."""
    assert result.returncode == 1, result.stderr
    assert "Traceback" not in result.stderr
    lines = result.stderr.strip().splitlines()
    assert lines[-1].startswith("lookonce: ")
    for part in parts:
        assert part in lines[-1]


def test_a_model_file_and_a_record_are_written_and_darknets_files_import_to_the_same(lookonce, stills, net, tmp_path):
    output = tmp_path / "new" / "boxes.onnx"
    result = lookonce("train-detector", stills, "--net", net, "-o", output, "--license", "CC0-1.0", *FAST)
    assert result.returncode == 0, result.stderr
    folder = tmp_path / "new" / "boxes.train"
    first, second = result.stdout.splitlines()
    assert first.startswith(f"{output}: learnt from 11 pictures in ")
    assert "on 10 held-out objects AP50 0." in first
    assert "(AP50: red 0." in first
    assert second == f"{folder}: record.json, curves.png, network.cfg, network.weights, network.names"
    assert sorted(path.name for path in folder.iterdir()) == [
        "checkpoint.safetensors",
        "curves.png",
        "network.cfg",
        "network.names",
        "network.weights",
        "record.json",
        "run.json",
    ]
    assert describe_model(output).license == "CC0-1.0"
    record = json.loads((folder / "record.json").read_text())
    assert record["classes"] == list(NAMES)
    assert record["settings"]["epochs"] == 2
    assert record["history"]["epoch"] == [1, 2]
    assert set(record["validation"]) == {*NAMES, "mean"}
    assert record["validation"]["red"]["boxes"] == 5
    assert record["network"]["weights"] == "random"
    assert record["data"]
    assert record["versions"]["torch"]
    Image.open(folder / "curves.png").verify()
    files = [folder / f"network.{suffix}" for suffix in ("cfg", "weights", "names")]
    again = tmp_path / "again.onnx"
    assert lookonce("import", *files[:2], "--names", files[2], "-o", again).returncode == 0
    assert Model(again, threads=1).names == NAMES
    pictures = scene(np.random.default_rng(3))[0][None]
    ours, theirs = (run_file(path, pictures, score_threshold=0.001) for path in (output, again))
    assert len(ours["scores"]) > 3
    assert all(ours[name].tobytes() == theirs[name].tobytes() for name in ours)


def test_progress_is_told(lookonce, stills, net, tmp_path):
    result = lookonce("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *FAST)
    lines = result.stderr.splitlines()
    assert lines[:2] == ["boxes: 16 pictures, 16 red, 16 blue", "11 pictures to learn from, 5 to validate on"]
    assert lines[2].startswith("anchors fitted: ")
    assert lines[3:] == ["train: 2 of 2, looking at the validation pictures", "measuring the model file"]


def test_help_shows_examples_and_every_setting_with_its_default(lookonce):
    text = lookonce("train-detector", "--help").stdout
    assert "Examples" in text
    assert "lookonce train-detector pictures/ --net yolov3-tiny.cfg --change-classes -o detector.onnx" in text
    flags = inspect.signature(train_detector_command).parameters
    settings = [field for field in fields(DetectorConfig) if field.name in flags]
    assert len(settings) > 10  # the others are in TOML files only
    for field in settings:
        flag = f"--{field.name.replace('_', '-')}"
        line = next((line for line in text.splitlines() if line.startswith(f"│ {flag} ")), "")
        assert line, flag
        if isinstance(field.default, bool):
            assert "[yes]" in line
        elif not isinstance(field.default, str):
            assert f"[{field.default:g}]" in line, f"{flag} has the default {field.default}"


def test_flags_go_before_the_file_and_the_file_before_defaults(lookonce, stills, net, tmp_path):
    lines = ("epochs = 2", "batch = 3", "seed = 4", 'box_loss = "giou"', "fit_anchors = true", 'precision = "32-true"')
    (tmp_path / "a.toml").write_text("\n".join(lines))
    flags = ("--config", tmp_path / "a.toml", "--batch", 8, "--no-fit-anchors", "--check-every", 2, "--threads", 1)
    result = lookonce("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *flags)
    assert result.returncode == 0, result.stderr
    settings = json.loads((tmp_path / "o.train" / "record.json").read_text())["settings"]
    expected = {"epochs": 2, "batch": 8, "seed": 4, "box_loss": "giou", "fit_anchors": False, "mosaic": 0.7}
    assert {name: settings[name] for name in expected} == expected


def test_a_finished_run_is_in_the_way_until_told_otherwise(lookonce, stills, net, tmp_path):
    arguments = ("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *FAST)
    assert lookonce(*arguments).returncode == 0
    first = (tmp_path / "o.onnx").read_bytes()
    assert_one_line(lookonce(*arguments), 1, "o.onnx exists", "--overwrite")
    (tmp_path / "o.onnx").unlink()
    assert_one_line(lookonce(*arguments), 1, "o.train", "there is a run already", "--resume")
    assert lookonce(*arguments, "--resume").returncode == 0
    assert (tmp_path / "o.onnx").read_bytes() == first
    for other in (("--seed", 3), ("--size", 96), ("--labelled", "boxes=red,blue")):
        assert_one_line(lookonce(*arguments, "--resume", *other), 1, "other data or settings")
    result = lookonce(*arguments, "--overwrite", "--size", "96x64")
    assert result.returncode == 0, result.stderr
    assert describe_model(tmp_path / "o.onnx").size == (96, 64)


def test_resuming_nothing_is_one_line(lookonce, stills, net, tmp_path):
    result = lookonce("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", "--resume", *FAST)
    assert_one_line(result, 1, "o.train", "nothing to go on with")


@pytest.mark.usefixtures("_no_training")
def test_a_run_that_failed_early_is_in_nobodys_way(lookonce, net, tmp_path):
    few = write_rectangles(tmp_path / "few", 1)
    arguments = ("--net", net, "-o", tmp_path / "o.onnx", *FAST)
    result = lookonce("train-detector", few, *arguments)
    assert_last_line(result, "no labelled object to validate on")
    assert_last_line(lookonce("train-detector", write_rectangles(tmp_path / "more", 16), *arguments), "enough")


# --- what is learnt from ---


@pytest.mark.usefixtures("_no_training")
def test_sequences_video_and_a_teacher_beside_stills(lookonce, square_model, net, tmp_path):
    stills = write_rectangles(tmp_path / "boxes", 16, names=("red", "object"), labels=(0,))
    walk = write_labelled(tmp_path / "walk")
    with VideoWriter(tmp_path / "clip.mp4", 10.0) as writer:
        for index in range(4):
            writer.write(picture(index), index / 10)
    names = tmp_path / "learn.names"
    names.write_text("red\nother\n")
    arguments = ("--video", tmp_path / "clip.mp4", "--teacher", square_model, "--names", names, "--video-frames", 3)
    result = lookonce("train-detector", stills, walk, *arguments, "--net", net, "-o", tmp_path / "o.onnx", *FAST)
    assert_last_line(result, "enough")
    lines = result.stderr.splitlines()
    assert lines[0] == "teacher on boxes: 16 of 16"
    assert "frames of walk: 3 of 3" in lines
    assert any(line.startswith("clip: 3 pictures, 3 red, ") for line in lines)
    run = json.loads((tmp_path / "o.train" / "run.json").read_text())
    assert len(run["data"]) == 3
    assert run["teacher"] == Model(square_model, threads=1).sha256
    assert run["classes"] == ["red", "other"]


@pytest.mark.usefixtures("_no_training")
def test_classes_of_several_sets_are_put_together_by_their_usual_names(lookonce, tmp_path):
    """A class that two sets spell in two ways was learnt as two."""
    one = write_rectangles(tmp_path / "one", 16, names=("Motorbike", "car"))
    two = write_rectangles(tmp_path / "two", 16, seed=1, names=("bus", "motorcycle"))
    (tmp_path / "net.cfg").write_text(one_grid(channels=4, classes=8))
    arguments = (one, two, "--net", tmp_path / "net.cfg", "--change-classes", "-o", tmp_path / "o.onnx", *FAST)
    result = lookonce("train-detector", *arguments)
    assert_last_line(result, "enough")
    assert json.loads((tmp_path / "o.train" / "run.json").read_text())["classes"] == ["Motorbike", "car", "bus"]
    assert "classes=3" in (tmp_path / "o.train" / "network.cfg").read_text().split()
    assert "two: 16 pictures, 16 Motorbike, 16 bus; says nothing of car" in result.stderr.splitlines()


@pytest.mark.usefixtures("_no_training")
def test_pictures_of_a_list_are_left_out(lookonce, stills, net, tmp_path):
    (tmp_path / "not.txt").write_text("# of the test\nboxes/images/000.png\n\n001.png\n")
    arguments = (stills, "--net", net, "-o", tmp_path / "o.onnx", "--leave-out", tmp_path / "not.txt", *FAST)
    result = lookonce("train-detector", *arguments)
    assert_last_line(result, "enough")
    assert result.stderr.startswith("boxes: 14 pictures")


@pytest.mark.usefixtures("_no_training")
def test_empty_label_files_are_pictures_without_objects(lookonce, stills, net, tmp_path):
    for number in (0, 9):
        (stills / "labels" / f"{number:03d}.txt").write_text("")
    result = lookonce("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *FAST)
    assert_last_line(result, "enough")
    assert result.stderr.startswith("boxes: 16 pictures, 14 red, 14 blue\n")


@pytest.mark.usefixtures("_no_training")
def test_boxes_half_outside_are_cut_and_boxes_outside_are_left_out(lookonce, stills, net, tmp_path):
    with open(stills / "labels" / "000.txt", "a") as file:
        file.write("0 0.99 0.5 0.2 0.2\n1 1.5 1.5 0.1 0.1\n")
    result = lookonce("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *FAST)
    assert_last_line(result, "enough")
    assert result.stderr.startswith("boxes: 16 pictures, 17 red, 16 blue\n")


def test_weights_to_start_from_are_named_in_the_model_file(lookonce, stills, tmp_path):
    cfg, weights = write_network(tmp_path, one_grid(channels=4, classes=3))
    (tmp_path / "three.names").write_text("blue\ndog\nred\n")
    start = ("--weights", weights, "--weights-names", tmp_path / "three.names", "--change-classes")
    result = lookonce("train-detector", stills, "--net", cfg, *start, "-o", tmp_path / "o.onnx", *FAST)
    assert result.returncode == 0, result.stderr
    assert describe_model(tmp_path / "o.onnx").source["started_from"] == "tiny.weights"
    other = lookonce("train-detector", stills, "--net", cfg, *start[:2], "--change-classes", "-o", tmp_path / "o.onnx",
                     "--resume", *FAST)  # fmt: skip
    assert_one_line(other, 1, "other data or settings")


# --- what cannot work ---


def rewrite(path: Path, text: str) -> None:
    path.write_text(text)


BAD_STILLS = {
    "a class without a name": (
        lambda f: rewrite(f / "labels" / "003.txt", "2 .5 .5 .2 .2\n"),
        ["003.txt:1", "class 2"],
    ),
    "a class that is no number": (lambda f: rewrite(f / "labels" / "003.txt", "red .5 .5 .2 .2\n"), ["003.txt:1"]),
    "boxes in px": (lambda f: rewrite(f / "labels" / "003.txt", "0 10 10 5 5\n"), ["003.txt:1", "px"]),
    "too few columns": (lambda f: rewrite(f / "labels" / "003.txt", "0 .5 .5\n"), ["003.txt:1", "3 columns"]),
    "a text for a picture": (lambda f: rewrite(f / "images" / "003.png", "text"), ["003.png", "not a picture"]),
    "no pictures": (lambda f: [path.unlink() for path in (f / "images").iterdir()], ["boxes", "no pictures"]),
    "a name twice": (lambda f: rewrite(f / "classes.txt", "red\nred\n"), ["classes.txt:2", "a second time"]),
}


@pytest.mark.parametrize("name", BAD_STILLS)
def test_bad_stills_are_one_line(lookonce, stills, net, tmp_path, name):
    change, parts = BAD_STILLS[name]
    change(stills)
    result = lookonce("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *FAST)
    assert_one_line(result, 1, *parts)
    assert not (tmp_path / "o.onnx").exists()


def test_a_picture_that_does_not_decode_is_named(lookonce, stills, net, tmp_path):
    """Its header is whole, so that it is found out in mid training, in a worker process: that was a traceback."""
    for path in (stills / "images").iterdir():
        path.write_bytes(path.read_bytes()[:100])
    result = lookonce("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *FAST)
    assert_last_line(result, str(stills / "images"), "not a picture, or damaged", "remove it")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        pytest.param("learning_rat = 1", ["learning_rat", "did you mean learning_rate?"], id="misspelt"),
        pytest.param('epochs = "many"', ["epochs = many", "whole number"], id="wrong type"),
        pytest.param("epochs = 0", ["epochs 0: expected 1"], id="out of range"),
        pytest.param('positives = "all"', ["positives 'all'", "several, best"], id="no such choice"),
        pytest.param("teacher_doubt = 0.9", ["teacher_doubt 0.9", "at most teacher_score"], id="doubt above score"),
        pytest.param("epochs", ["not TOML"], id="broken"),
        pytest.param(None, ["check the path"], id="missing"),
    ],
)
def test_bad_settings_files_are_one_line(lookonce, stills, net, tmp_path, text, parts):
    path = tmp_path / "a.toml"
    if text is not None:
        path.write_text(text)
    result = lookonce("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", "--config", path)
    assert_one_line(result, 1, *parts)


BOXES = ["boxes"]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        pytest.param([], ["nothing to learn from"], id="no data"),
        pytest.param(["gone"], ["gone", "no such folder"], id="no such data"),
        pytest.param([*BOXES, "--video", "gone.mp4"], ["gone.mp4", "no such video"], id="no such video"),
        pytest.param(["--video", "net.cfg"], ["which classes", "--names"], id="video without names"),
        pytest.param([*BOXES, "--labelled", "boxes"], ["--labelled boxes", "SET=CLASS"], id="labelled without classes"),
        pytest.param([*BOXES, "--labelled", "box=red"], ["'box'", "expected one of boxes"], id="labelled unknown set"),
        pytest.param([*BOXES, "--labelled", "boxes=dog"], ["'dog' is no class here"], id="labelled unknown class"),
        pytest.param([*BOXES, "--net", "gone.cfg"], ["gone.cfg", "check the path"], id="no such cfg"),
        pytest.param([*BOXES, "--net", "boxes"], ["boxes", "cannot be read"], id="cfg is a folder"),
        pytest.param([*BOXES, "--net", "boxes/classes.txt"], ["classes.txt"], id="cfg is another text"),
        pytest.param([*BOXES, "--net", "region.cfg"], ["region.cfg:", "only [yolo]"], id="region"),
        pytest.param([*BOXES, "--net", "new.cfg"], ["new.cfg:", "without new_coords"], id="new_coords"),
        pytest.param([*BOXES, "--net", "many.cfg"], ["many.cfg", "5 classes", "--change-classes"], id="other classes"),
        pytest.param([*BOXES, "--weights", "gone.weights"], ["gone.weights", "check the path"], id="no such weights"),
        pytest.param([*BOXES, "--weights", "net.cfg"], ["net.cfg"], id="weights of nothing"),
        pytest.param([*BOXES, "--weights-names", "boxes/classes.txt"], ["--weights-names"], id="names of no weights"),
        pytest.param([*BOXES, "--names", "gone.names"], ["gone.names"], id="no such names"),
        pytest.param([*BOXES, "--names", "two.names"], ["'motorbike' and 'motorcycle' are one"], id="a class twice"),
        pytest.param([*BOXES, "--names", "dog.names", "--change-classes"], ["no labelled object"], id="nothing of it"),
        pytest.param([*BOXES, "--leave-out", "gone.txt"], ["gone.txt", "check the path"], id="no such list"),
        pytest.param([*BOXES, "--teacher", "gone.onnx"], ["gone.onnx", "no such model file"], id="no such teacher"),
        pytest.param([*BOXES, "--size", "70"], ["70x70", "multiple of 16"], id="size"),
        pytest.param([*BOXES, "--size", "big"], ["--size big"], id="size in words"),
        pytest.param([*BOXES, "--device", "abacus"], ["'abacus'", "auto, cpu or cuda"], id="device"),
        pytest.param([*BOXES, "--device", "cuda"], ["'cuda'", "--device cpu"], id="no cuda"),
        pytest.param([*BOXES, "--devices", "3"], ["batch 8", "multiple of the 3 devices"], id="devices"),
        pytest.param([*BOXES, "--learning-rate", "nan"], ["learning_rate nan"], id="not a number"),
        pytest.param([*BOXES, "-o", "boxes"], ["boxes", "a folder"], id="output is a folder"),
        pytest.param([*BOXES, "-o", "a.train"], ["a.train", "the run's own"], id="output named as the run"),
        pytest.param([*BOXES, "-o", "net.cfg/a.onnx"], ["-o"], id="output below a file"),
    ],
)
def test_what_cannot_work_is_one_line(lookonce, stills, net, tmp_path, monkeypatch, arguments, parts):
    import torch

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.chdir(tmp_path)
    Path("region.cfg").write_text(TINY["region-reorg"])
    Path("new.cfg").write_text(TINY["new-coords"])
    Path("many.cfg").write_text(one_grid(classes=5))
    Path("two.names").write_text("motorbike\nmotorcycle\n")
    Path("dog.names").write_text("dog\n")
    network = [] if "--net" in arguments else ["--net", net]
    output = [] if "-o" in arguments else ["-o", "o.onnx"]
    result = lookonce("train-detector", *arguments, *network, *output, *FAST)
    assert_last_line(result, *parts)
    if "no labelled object" not in parts[0] and "--weights" not in arguments:
        assert_one_line(result, 1)
    assert not (tmp_path / "o.onnx").exists()


def test_a_damaged_checkpoint_is_one_line(lookonce, stills, net, tmp_path, monkeypatch):
    arguments = ("train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *FAST)
    with monkeypatch.context() as patch:
        patch.setattr(StageScreen, "stage", press_ctrl_c_at(("train", 1)))
        assert lookonce(*arguments).returncode == 130
    (tmp_path / "o.train" / "checkpoint.safetensors").write_bytes(b"nothing")
    assert_last_line(lookonce(*arguments, "--resume"), "checkpoint.safetensors", "damaged", "--overwrite")


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["-o", "o.onnx"], id="no network"),
        pytest.param(["--net", "net.cfg"], id="no output"),
        pytest.param(["--net", "net.cfg", "-o", "o.onnx", "--epochs", "many"], id="not a number"),
        pytest.param(["--net", "net.cfg", "-o", "o.onnx", "--threads", "0"], id="no threads"),
        pytest.param(["--net", "net.cfg", "-o", "o.onnx", "--frobnicate"], id="unknown option"),
    ],
)
def test_wrong_usage_is_exit_code_2(lookonce, arguments):
    result = lookonce("train-detector", "data", *arguments)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr


def test_without_the_extra_packages_the_error_names_them(stills, net, tmp_path):
    code = f"import sys; sys.modules['torch'] = None; {COMMAND}"
    arguments = ["train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx"]
    command = [sys.executable, "-c", code, *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, env=PLAIN, timeout=60)
    assert_one_line(
        Result(result.returncode, result.stdout, result.stderr), 1, "pip install 'lookonce[train]'", "torch"
    )


# --- Ctrl-C ---


def press_ctrl_c_at(place: tuple[str, int]):
    """A screen on which the work is interrupted when so much of a stage is done."""
    show = StageScreen.stage

    def stage(self, name, done, total, note=""):
        show(self, name, done, total, note)
        if (name, done) == place:
            raise KeyboardInterrupt

    return stage


def test_an_interrupted_run_goes_on_with_resume(lookonce, stills, net, tmp_path, monkeypatch):
    walk = write_labelled(tmp_path / "walk")
    arguments = ("train-detector", stills, walk, "--net", net, "--change-classes", *FAST)
    assert lookonce(*arguments, "-o", tmp_path / "whole.onnx").returncode == 0
    resume = ()
    for place in (("frames of walk", 5), ("train", 1), ("train", 3), ("train", 4)):
        with monkeypatch.context() as patch:
            patch.setattr(StageScreen, "stage", press_ctrl_c_at(place))
            result = lookonce(*arguments, "-o", tmp_path / "cut.onnx", *resume)
        assert result.returncode == 130, result.stderr
        assert "Traceback" not in result.stderr
        assert f"{tmp_path / 'cut.train'}: keeps what was made so far; go on with --resume" in result.stderr
        assert not (tmp_path / "cut.onnx").exists()
        resume = ("--resume",)
    assert lookonce(*arguments, "-o", tmp_path / "cut.onnx", "--resume").returncode == 0
    assert (tmp_path / "cut.onnx").read_bytes() == (tmp_path / "whole.onnx").read_bytes()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_ctrl_c_ends_all_processes_quietly(stills, net, tmp_path):
    """Pressed on a terminal, it reaches the processes that make views too."""
    # Where the tests themselves run in the background, SIGINT is ignored, and children inherit that.
    code = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler); {COMMAND}"
    settings = ("--epochs", 1000, "--batch", 8, "--check-every", 10, "--patience", 1000, "--threads", 2)
    arguments = ["train-detector", stills, "--net", net, "-o", tmp_path / "o.onnx", *settings]
    made = tmp_path / "o.train" / "checkpoint.safetensors"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    with subprocess.Popen(
        command, env=PLAIN, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and process.poll() is None and not made.exists():
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)
        _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert f"{tmp_path / 'o.train'}: keeps what was made so far; go on with --resume" in stderr
    assert made.exists()
    assert not (tmp_path / "o.onnx").exists()
