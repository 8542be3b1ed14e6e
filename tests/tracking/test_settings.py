"""Settings of trackers as text: what is written reads back the same, and every fault names file, setting and remedy."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import pytest

from datasets.making import refusal
from lookonce.config import setting_types
from lookonce.errors import ConfigError, FormatError
from lookonce.tracking import PRESETS, DefaultConfig, EvidenceConfig, MotionConfig, PaperConfig
from lookonce.tracking.settings import (
    change_tracker_settings,
    choose_tracker,
    read_tracker_settings,
    replace_settings,
    tracker_settings_toml,
)

CHANGED = DefaultConfig(
    appearance=False,
    memory_s=1 / 3,
    crowd_box=1e-3,
    given_back_rows=999_999,
    motion=MotionConfig(place_noise=0.1 + 0.2, jump_speed=123456.789),
    evidence=EvidenceConfig(hits=7, score=5e-324),
)


def write(folder, text: str):
    path = folder / "tracker.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "config",
    [
        *(pytest.param(make(), id=name) for name, make in PRESETS.items()),
        pytest.param(CHANGED, id="changed"),
        pytest.param(PaperConfig(0.1 + 0.2), id="changed paper"),
        pytest.param(DefaultConfig(memory_s=4, motion=MotionConfig(jump_speed=20)), id="whole numbers"),
    ],
)
def test_what_is_written_reads_back_the_same(config, tmp_path):
    assert read_tracker_settings(write(tmp_path, tracker_settings_toml(config))) == config


def test_every_setting_is_written_with_its_meaning():
    lines = tracker_settings_toml(DefaultConfig()).splitlines()
    plain = [name.rpartition(".")[2] for name in setting_types(DefaultConfig)]
    for name in plain:
        (place,) = (number for number, line in enumerate(lines) if line.startswith(f"{name} = "))
        assert lines[place - 1].startswith("# "), name
    for table in ("motion", "evidence"):
        assert lines[lines.index(f"[{table}]") - 1].startswith("# ")
    assert "# standard deviation of a detection's centre, boxes." in lines
    assert max(map(len, lines)) <= 110


def test_python_without_documentation_only_lacks_the_meanings(tmp_path):
    code = "from lookonce.tracking import *; from lookonce.tracking.settings import *; "
    code += "print(tracker_settings_toml(DefaultConfig(memory_s=4.5)))"
    text = subprocess.run([sys.executable, "-OO", "-c", code], capture_output=True, text=True, check=True).stdout
    assert "# standard deviation" not in text
    assert read_tracker_settings(write(tmp_path, text)) == DefaultConfig(memory_s=4.5)


def test_first_lines_cannot_break_out_of_their_comment(tmp_path):
    text = tracker_settings_toml(DefaultConfig(), about=["evil\nmemory_s = 1\r\u2028[motion]", "x" * 500])
    assert read_tracker_settings(write(tmp_path, text)) == DefaultConfig()


def test_a_file_names_a_preset_and_what_differs(tmp_path):
    path = write(tmp_path, 'preset = "iou"\nmemory_s = 4\n[motion]\nplace_noise = 0.5\n')
    iou = PRESETS["iou"]()
    expected = replace(iou, memory_s=4.0, motion=replace(iou.motion, place_noise=0.5))
    assert read_tracker_settings(path) == expected
    assert read_tracker_settings(write(tmp_path, 'preset = "paper"')) == PaperConfig()


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        pytest.param("memory_s = 4", ["preset is missing", '"default", "iou", "paper"'], id="no preset"),
        pytest.param('preset = "papper"', ["preset = papper", "did you mean paper?"], id="misspelt preset"),
        pytest.param("preset = 3", ["preset = 3", '"default", "iou", "paper"'], id="number for a preset"),
        pytest.param('preset = "default"\nmemry_s = 4', ["'memry_s'", "did you mean memory_s?"], id="misspelt"),
        pytest.param(
            'preset = "default"\n[motion]\nplace_nose = 4', ["did you mean motion.place_noise?"], id="misspelt inside"
        ),
        pytest.param('preset = "default"\nplace_noise = 4', ["did you mean motion.place_noise?"], id="no table"),
        pytest.param('preset = "paper"\nmemory_s = 4', ["'memory_s'", "match_threshold"], id="not of this preset"),
        pytest.param('preset = "default"\nviews = 2.5', ["views = 2.5", "a whole number"], id="type"),
        pytest.param('preset = "default"\nmemory_s = -1', ["memory_s=-1.0", "above 0"], id="range"),
        pytest.param('preset = "default"\nmemory_s = nan', ["memory_s=nan", "above 0"], id="nan"),
        pytest.param('preset = "default"\nmatch_threshold = 3', ["match_threshold=3.0", "at most 2"], id="threshold"),
        pytest.param(
            'preset = "default"\n[evidence]\nhits = 0', ["evidence.hits=0", "expected above 0"], id="range inside"
        ),
    ],
)
def test_faults_of_a_file_are_one_line(tmp_path, content, parts):
    path = write(tmp_path, content)
    message = refusal(ConfigError, lambda: read_tracker_settings(path))
    assert message.startswith(f"{path}: ")
    for part in parts:
        assert part in message


def test_no_file_and_no_toml_are_one_line(tmp_path):
    assert "none.toml" in refusal(ConfigError, lambda: choose_tracker(str(tmp_path / "none.toml")))
    assert "not TOML" in refusal(FormatError, lambda: choose_tracker(str(write(tmp_path, "preset: default"))))
    assert "cannot read" in refusal(ConfigError, lambda: choose_tracker("a\0b.toml"))


def test_a_tracker_is_a_preset_or_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, 'preset = "default"\nmemory_s = 4\n')
    for given in ("tracker.toml", str(tmp_path / "tracker.toml"), f".{os.sep}tracker.toml"):
        assert choose_tracker(given).config == DefaultConfig(memory_s=4.0)
    assert choose_tracker("iou").config == PRESETS["iou"]()
    message = refusal(ConfigError, lambda: choose_tracker("defualt"))
    assert message == "tracker 'defualt': expected one of default, iou, paper, or a file such as tracker.toml"


def test_changes_go_before_the_file(tmp_path):
    path = write(tmp_path, 'preset = "default"\nmemory_s = 4\nviews = 2\n')
    changes = ["memory_s=5", "motion.place_noise = 1e-1", "evidence.hits=3", "appearance=false", "memory_s=6"]
    expected = DefaultConfig(
        appearance=False,
        memory_s=6.0,
        views=2,
        motion=MotionConfig(place_noise=0.1),
        evidence=EvidenceConfig(hits=3),
    )
    assert choose_tracker(str(path), changes).config == expected


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        pytest.param("memory_s", ["NAME=VALUE"], id="no value"),
        pytest.param("=4", ["NAME=VALUE"], id="no name"),
        pytest.param("memory_s=", ["NAME=VALUE"], id="empty value"),
        pytest.param("memry_s=4", ["did you mean memory_s?"], id="misspelt"),
        pytest.param("motion.place_nose=4", ["did you mean motion.place_noise?"], id="misspelt inside"),
        pytest.param("motion=4", ["a table [motion]"], id="table"),
        pytest.param("motion.a.b=4", ["'motion.a.b'"], id="too deep"),
        pytest.param("memory_s=four", ["memory_s = four", "a number"], id="text"),
        pytest.param("views=2.5", ["a whole number"], id="fraction"),
        pytest.param("appearance=1", ["true or false"], id="number for bool"),
        pytest.param("memory_s=inf", ["memory_s=inf", "above 0"], id="infinite"),
        pytest.param("memory_s=1" + "0" * 5000, ["memory_s=inf"], id="many digits"),
        pytest.param("memory_s=4\nviews=2", ["a number"], id="two lines"),
        pytest.param("preset=iou", ["'preset'"], id="preset"),
    ],
)
def test_faults_of_changes_are_one_line(change, parts):
    message = refusal(ConfigError, lambda: change_tracker_settings(DefaultConfig(), [change]))
    for part in ("setting '", *parts):
        assert part in message


def test_settings_are_replaced_by_full_name():
    changed = replace_settings(DefaultConfig(), {"motion.place_noise": 0.5, "motion.size_noise": 0.25, "views": 1})
    assert changed == DefaultConfig(views=1, motion=MotionConfig(place_noise=0.5, size_noise=0.25))


@pytest.mark.parametrize(
    ("content", "changes", "flag", "expected"),
    [
        pytest.param("memory_s = 4", [], None, None, id="nobody"),
        pytest.param("match_threshold = 0.7", [], None, 0.7, id="file"),
        pytest.param("memory_s = 4", ["match_threshold=0.9"], None, 0.9, id="change"),
        pytest.param("match_threshold = 0.7", ["match_threshold=0.9"], 1.1, 1.1, id="flag"),
        pytest.param("memory_s = 4", [], 1.1, 1.1, id="flag alone"),
    ],
)
def test_a_match_threshold_that_somebody_named_is_told(tmp_path, content, changes, flag, expected):
    chosen = choose_tracker(str(write(tmp_path, f'preset = "default"\n{content}\n')), changes)
    assert chosen.threshold(flag) == expected


def test_the_file_of_a_preset_leaves_the_threshold_to_the_model(tmp_path):
    text = tracker_settings_toml(replace(DefaultConfig(), memory_s=3.0), leaves_threshold=True)
    assert "# match_threshold = 0.7" in text.splitlines()
    chosen = choose_tracker(str(write(tmp_path, text)))
    assert chosen.config == DefaultConfig(memory_s=3.0)
    assert chosen.threshold() is None
