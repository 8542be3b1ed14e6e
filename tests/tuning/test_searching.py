"""The search: what is tried, that it finds what is there to be found, and that it can be stopped anywhere."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from lookonce.config import setting_types
from lookonce.errors import ConfigError, OutputError
from lookonce.tracking import PRESETS, DefaultConfig, PaperConfig
from lookonce.tracking.settings import replace_settings
from lookonce.tuning.ranges import SearchRange, choose_ranges, lowest_score, setting_value, values_of
from lookonce.tuning.scoring import Scorer
from lookonce.tuning.trials import Trial, TrialFile
from tuning.blinking import DISTANCE, make_scene

pytest.importorskip("optuna", reason="the extra 'tune' is not installed")
from lookonce.tuning.proposing import importances, propose
from lookonce.tuning.searching import Search, best_settings

THRESHOLD = choose_ranges(PaperConfig(), True)


def search(folder, trials: int = 12, *, seed: int = 0, resumes: bool = False, seconds: float | None = None, start=0.31):
    file = TrialFile(folder / "trials.jsonl", {"seed": seed}, THRESHOLD, resumes=resumes)
    before = list(file.trials)
    asked = Search(PaperConfig(start), THRESHOLD, "hota", trials, seconds, seed)
    assert before + list(asked.run(Scorer([make_scene()], [1]), file)) == file.trials
    return file


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("end", ["low", "high"])
def test_every_range_holds_the_preset_and_nothing_that_settings_refuse(preset, end):
    config = PRESETS[preset]()
    ranges = choose_ranges(config, True)
    for one in ranges:
        assert one.low <= setting_value(config, one.name) <= one.high
        assert one.tidy(getattr(one, end)) == getattr(one, end)
        assert setting_types(type(config))[one.name] is (int if one.is_whole else float)
    extreme = {one.name: one.tidy(getattr(one, end)) for one in ranges}
    assert values_of(replace_settings(config, extreme), ranges) == extreme


def test_what_has_no_effect_is_not_searched():
    names = {one.name for one in choose_ranges(DefaultConfig(), True)}
    without = {one.name for one in choose_ranges(DefaultConfig(), False)}
    assert without == {one.name for one in choose_ranges(DefaultConfig(appearance=False), True)}
    assert names - without >= {"match_threshold", "appearance_weight", "views", "clean_overlap"}
    assert not names & {"appearance", "frame_rate", "given_back_rows"}


def test_only_some_settings_by_name_or_table():
    chosen = [one.name for one in choose_ranges(DefaultConfig(), True, ["evidence", "memory_s"])]
    assert chosen[0] == "memory_s"
    assert len(chosen) == 8
    with pytest.raises(ConfigError, match=r"'memry_s': .*did you mean memory_s"):
        choose_ranges(DefaultConfig(), True, ["memry_s"])


def test_detections_are_wanted_from_the_lowest_score_on():
    assert lowest_score(DefaultConfig()) == 0.05
    assert lowest_score(DefaultConfig(low_score=0.02)) == 0.02
    assert lowest_score(PaperConfig()) is None


def test_values_have_few_digits_and_stay_inside():
    one = SearchRange("a", 0.123456, 2.0)
    assert [one.tidy(value) for value in (0.5678, 0.123457, 1.99999)] == [0.568, 0.123456, 2.0]
    whole = SearchRange("b", 1, 5, is_whole=True)
    assert [whole.tidy(value) for value in (0.0, 2.4, 9.9)] == [1, 2, 5]
    assert isinstance(whole.tidy(2.4), int)


def test_the_threshold_that_the_scene_needs_is_found(tmp_path):
    file = search(tmp_path)
    best = best_settings(PaperConfig(0.31), file.trials)
    assert file.trials[0].values == {"match_threshold": 0.31}
    assert file.trials[0].score < 0.5
    assert max(trial.score for trial in file.trials) == pytest.approx(1.0)
    assert best.match_threshold > DISTANCE


def test_settings_that_nothing_beats_stay_as_they_are(tmp_path):
    start = PaperConfig(1.0003)  # with more digits than a trial has
    file = search(tmp_path, 4, start=start.match_threshold)
    assert best_settings(start, file.trials) is start


def test_same_seed_same_trials(tmp_path):
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
    trials = [search(tmp_path / name, 14, seed=seed).trials for name, seed in (("a", 3), ("b", 3), ("c", 4))]
    assert trials[0] == trials[1] != trials[2]


def test_a_stopped_search_goes_on_as_if_it_never_was(tmp_path):
    for name in ("whole", "parts"):
        (tmp_path / name).mkdir()
    search(tmp_path / "whole", 14)
    for count in (1, 3, 11, 14):
        search(tmp_path / "parts", count, resumes=True)
    whole, parts = ((tmp_path / name / "trials.jsonl").read_bytes() for name in ("whole", "parts"))
    assert whole == parts


def test_no_time_is_one_trial(tmp_path):
    assert len(search(tmp_path, seconds=0.0).trials) == 1


def test_trials_of_a_tracker_that_has_changed_are_refused(tmp_path):
    path = search(tmp_path, 2).path
    lines = path.read_text().splitlines()
    score = lines[1].partition('"score": ')[2].partition(",")[0]
    path.write_text("\n".join(lines).replace(score, "0.123456", 1) + "\n")
    with pytest.raises(
        OutputError, match=r"trials.jsonl: its first trial has 0.123456, which is 0\.\d+ now: .*--overwrite"
    ):
        search(tmp_path, 3, resumes=True)


def test_proposals_do_not_depend_on_the_order_of_hashes():
    code = """
from lookonce.tracking import DefaultConfig
from lookonce.tuning.proposing import importances, propose
from lookonce.tuning.ranges import choose_ranges
from lookonce.tuning.trials import Trial
ranges, trials = choose_ranges(DefaultConfig(), True), []
for number in range(22):
    values = propose(trials, ranges, 1)
    trials.append(Trial(values, -abs(values["memory_s"] - 4)))
print(propose(trials, ranges, 1), importances(trials, ranges))
"""
    told = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        for seed in ("1", "2")
    ]
    assert told[0].stdout == told[1].stdout != ""
    assert told[0].stderr == ""


def test_importances_name_the_setting_that_decides():
    ranges = choose_ranges(DefaultConfig(), True, ["memory_s", "views", "birth_score"])
    trials: list[Trial] = []
    for _ in range(40):
        values = propose(trials, ranges, 0)
        trials.append(Trial(values, -abs(values["birth_score"] - 0.5)))
    shares = importances(trials, ranges)
    assert next(iter(shares)) == "birth_score"
    assert sum(shares.values()) == pytest.approx(1)
    assert importances(trials[:5], ranges) == {}
    assert importances([Trial(trial.values, 0.5) for trial in trials], ranges) == {}
