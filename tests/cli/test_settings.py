"""Settings of the tracker at the keyboard: written by `settings`, taken by `track` and `eval --sweep`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from cli.running import Command
from lookonce.model import Model
from lookonce.tracking import DefaultConfig, MotionConfig
from lookonce.tracking.settings import read_tracker_settings
from make.probing.labelled_squares import write_squares

COMMAND = Command()
run, done, refusal = COMMAND.run, COMMAND.done, COMMAND.refusal


def header(*arguments: object, folder: Path) -> dict:
    """The settings that `lookonce track` says it ran with."""
    done("track", *arguments, "--no-video", "--max-frames", 2, "-o", folder, "--overwrite")
    return json.loads((folder / "tracks.jsonl").read_text().splitlines()[0])["settings"]


@pytest.fixture(scope="module")
def calibrated(square_model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The squares' model with a match threshold of its own."""
    import onnx

    network = onnx.load(square_model)
    (entry,) = (entry for entry in network.metadata_props if entry.key == "lookonce")
    about = json.loads(entry.value)
    about["descriptor"]["match_threshold"] = 0.55
    entry.value = json.dumps(about)
    path = tmp_path_factory.mktemp("calibrated") / "model.onnx"
    onnx.save(network, path)
    assert Model(path).metadata.descriptor.match_threshold == 0.55
    return path


def test_settings_are_written_to_the_screen_and_to_a_file(tmp_path):
    path = tmp_path / "mine.toml"
    assert "written" in done("settings", "-o", path).stdout
    assert path.read_text() == done("settings").stdout == done("settings", "default").stdout
    assert read_tracker_settings(path) == DefaultConfig()
    assert "--overwrite" in refusal("settings", "-o", path)
    done("settings", path, "--set", "motion.place_noise=0.5", "--set", "memory_s=4", "-o", path, "--overwrite")
    assert read_tracker_settings(path) == DefaultConfig(memory_s=4.0, motion=MotionConfig(place_noise=0.5))


def test_track_takes_a_file_and_changes(square_clip, square_model, tmp_path):
    path = tmp_path / "mine.toml"
    done("settings", "iou", "--set", "memory_s=4", "-o", path)
    found = header(
        square_clip, "-m", square_model, "--tracker", path, "--set", "evidence.hits=3", folder=tmp_path / "o"
    )
    expected = DefaultConfig(appearance=False, memory_s=4.0)
    assert {name: found[name] for name in ("appearance", "memory_s")} == {"appearance": False, "memory_s": 4.0}
    assert found["evidence"] == asdict(expected.evidence) | {"hits": 3}
    assert found["tracker"] == str(path)


def test_track_looks_for_detections_from_the_files_lowest_score_on(square_clip, square_model, tmp_path):
    options = (square_clip, "-m", square_model)
    assert header(*options, "--set", "low_score=0.35", folder=tmp_path)["score"] == 0.35
    assert header(*options, "--set", "low_score=0.35", "--score", 0.2, folder=tmp_path)["score"] == 0.2


def test_the_models_threshold_holds_unless_somebody_names_one(square_clip, calibrated, tmp_path):
    plain, named = tmp_path / "plain.toml", tmp_path / "named.toml"
    done("settings", "-o", plain)
    done("settings", "--set", "match_threshold=0.8", "-o", named)
    for options, expected in (
        ((), 0.55),
        (("--tracker", plain), 0.55),
        (("--tracker", named), 0.8),
        (("--tracker", named, "--set", "match_threshold=0.9"), 0.9),
        (("--set", "match_threshold=0.9"), 0.9),
        (("--tracker", named, "--set", "match_threshold=0.9", "--match-threshold", 1.1), 1.1),
    ):
        found = header(square_clip, "-m", calibrated, *options, folder=tmp_path / "o")
        assert found["match_threshold"] == expected, options


def test_sweep_takes_a_file_and_changes(calibrated, tmp_path):
    truth = write_squares(tmp_path / "squares")
    done("settings", "paper", "--set", "match_threshold=0.8", "-o", tmp_path / "mine.toml")
    for number, (options, expected) in enumerate(
        (
            (("--tracker", "paper"), 0.55),
            (("--tracker", tmp_path / "mine.toml"), 0.8),
            (("--tracker", "paper", "--set", "match_threshold=0.9"), 0.9),
        )
    ):
        file = tmp_path / f"{number}.json"
        done("eval", "--truth", truth, "--sweep", "every=2", "-m", calibrated, *options, "--json", file)
        sweep = json.loads(file.read_text())["sweep"]
        assert sweep["settings"] == {"match_threshold": expected}
        assert sweep["tracker"] == str(options[1])


@pytest.mark.parametrize("command", [("track", "nothing.mp4"), ("settings",), ("eval", "--sweep", "every=1")])
def test_wrong_settings_are_one_line_before_any_work(command, tmp_path):
    (tmp_path / "bad.toml").write_text('preset = "default"\nmemry_s = 4\n')
    last = ("--truth", tmp_path) if command[0] == "eval" else ()
    tracker = () if command[0] == "settings" else ("--tracker",)
    assert "did you mean memory_s?" in refusal(*command, *last, *tracker, tmp_path / "bad.toml")
    assert "did you mean motion.place_noise?" in refusal(*command, *last, "--set", "motion.plac_noise=1")
    assert "'defualt'" in refusal(*command, *last, *tracker, "defualt")
