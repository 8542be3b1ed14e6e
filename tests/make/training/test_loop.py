"""The training loop: it learns, it can be interrupted at any look, and what it gives is what did best."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import nn

from datasets.making import refusal
from lookonce.errors import ConfigError, OutputError
from lookonce.make.descriptors.compact import CompactKind
from lookonce.make.training import loop
from lookonce.make.training.config import FitConfig
from lookonce.make.training.loop import History, train
from lookonce.make.training.trainables import trainable_for
from lookonce.model.metadata import Feature
from make.training.scenes import make_readings

KIND = CompactKind((Feature("a", 3, 4), Feature("b", 2, 8)), (64, 64), (0,))
CONFIG = FitConfig(steps=12, check_every=4, identities=8, rows=4, learning_rate=3e-3)
CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def _one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def readings():
    return make_readings(12, points=32)


def start(readings, config, folder, report=lambda step, history: None):
    """Train a fresh head; its module, the history and the validation."""
    folder.mkdir(exist_ok=True)
    torch.manual_seed(config.seed)
    head = trainable_for(KIND, readings, config)
    history, validation = train(head, readings, config, folder, device=CPU, report=report)
    return head.module, history, validation


def weights(module: nn.Module) -> dict[str, bytes]:
    return {name: value.detach().numpy().tobytes() for name, value in module.state_dict().items()}


def stop_at(step: int):
    def report(now: int, history: History) -> None:
        if now == step:
            raise KeyboardInterrupt

    return report


def test_loss_falls_on_eight_identities_in_thirty_steps(tmp_path):
    readings = make_readings(12, held_out=4, points=32, noise=1.0)
    config = replace(CONFIG, steps=30, check_every=5, patience=100, learning_rate=1e-2)
    _, history, _ = start(readings, config, tmp_path)
    assert history.step == [5, 10, 15, 20, 25, 30]
    least = math.log(CONFIG.rows - 1)  # of a perfect head: each row has so many partners to choose from
    assert history.loss[-1] - least < 0.5 * (history.loss[0] - least)
    assert len(history.error_rate) == len(history.learning_rate) == 6


def test_the_learning_rate_rises_and_falls(tmp_path, readings):
    _, history, _ = start(readings, replace(CONFIG, steps=40, check_every=1, patience=1000), tmp_path)
    rates = history.learning_rate
    assert max(rates) == pytest.approx(3e-3)
    assert rates[0] < rates[1] < rates[2] < rates[3]
    assert rates[4:] == sorted(rates[4:], reverse=True)
    assert 0 < rates[-1] < 1e-4


@pytest.mark.parametrize("step", [4, 6, 8, 11])
def test_a_resumed_run_ends_with_the_same_bytes(tmp_path, readings, step):
    whole, history, validation = start(readings, CONFIG, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        start(readings, CONFIG, tmp_path / "cut", stop_at(step))
    assert (tmp_path / "cut" / "checkpoint.safetensors").exists() == (step > 4)
    steps = []
    resumed, again, validated = start(readings, CONFIG, tmp_path / "cut", lambda now, history: steps.append(now))
    assert steps[0] == (step - 1) // 4 * 4 + 1
    assert weights(resumed) == weights(whole)
    assert again == history
    assert validated == validation


def test_a_finished_run_is_not_trained_again(tmp_path, readings):
    first, history, _ = start(readings, CONFIG, tmp_path)
    again, same, _ = start(readings, CONFIG, tmp_path, lambda now, history: pytest.fail("trained"))
    assert weights(again) == weights(first)
    assert same == history


def fake_rates(monkeypatch, rates: list[float]) -> None:
    """Makes validation say these error rates, one for each look; the looks before and after the training are real."""
    remaining, true = list(rates), loop.validate

    def validate(objects, lifetimes, scenes):
        found = true(objects, lifetimes, scenes)
        if validate.looks and remaining:
            found = replace(found, error_rate=remaining.pop(0))
        validate.looks += 1
        return found

    validate.looks = 0
    monkeypatch.setattr(loop, "validate", validate)


def test_the_best_weights_are_returned(tmp_path, readings, monkeypatch):
    seen = {}
    fake_rates(monkeypatch, [0.4, 0.1, 0.3])
    keep = loop._keep
    monkeypatch.setattr(loop, "_keep", lambda module, *a: (seen.update({a[1].step: weights(module)}), keep(module, *a)))
    module, history, _ = start(readings, CONFIG, tmp_path)
    assert history.error_rate == [0.4, 0.1, 0.3]
    assert history.best == 1
    assert weights(module) == seen[8] != seen[12]


def test_training_stops_when_it_gets_no_better(tmp_path, readings, monkeypatch):
    fake_rates(monkeypatch, [0.3, 0.2, 0.2, 0.25, 0.2])
    module, history, _ = start(readings, replace(CONFIG, steps=1000, check_every=2, patience=3), tmp_path)
    assert history.step == [2, 4, 6, 8, 10]
    again, same, _ = start(
        readings,
        replace(CONFIG, steps=1000, check_every=2, patience=3),
        tmp_path,
        lambda now, history: pytest.fail("went on"),
    )
    assert same == history
    assert weights(again) == weights(module)


def test_the_last_step_is_always_looked_at(tmp_path, readings):
    _, history, _ = start(readings, replace(CONFIG, steps=7, check_every=5), tmp_path)
    assert history.step == [5, 7]
    _, history, _ = start(readings, replace(CONFIG, steps=1, check_every=100), tmp_path / "one")
    assert history.step == [1]


def spoil(readings, *, held_out: bool):
    """One reading that is not a number."""
    points = readings.values["points"].copy()
    rows = np.flatnonzero(readings.held_out[readings.identity] == held_out)
    points[rows, 0, 0] = np.nan
    return replace(readings, values={**readings.values, "points": points})


def test_a_loss_that_is_no_number_is_one_line_and_keeps_the_checkpoint(tmp_path, readings):
    with pytest.raises(KeyboardInterrupt):
        start(readings, CONFIG, tmp_path, stop_at(9))
    before = (tmp_path / "checkpoint.safetensors").read_bytes()
    head = trainable_for(KIND, readings, CONFIG)
    spoilt = spoil(readings, held_out=False)
    report = lambda step, history: None  # noqa: E731
    message = refusal(ConfigError, lambda: train(head, spoilt, CONFIG, tmp_path, device=CPU, report=report))
    assert "step 9" in message
    assert "learning_rate" in message
    assert (tmp_path / "checkpoint.safetensors").read_bytes() == before


def test_descriptors_that_are_no_numbers_are_one_line(tmp_path, readings):
    """Weights can break in the very step before a look, while the loss was still a number."""
    message = refusal(ConfigError, lambda: start(spoil(readings, held_out=True), CONFIG, tmp_path))
    assert "not a finite number" in message


@pytest.mark.parametrize(
    "readings",
    [
        pytest.param(make_readings(5, held_out=4, points=32), id="one to train on"),
        pytest.param(make_readings(12, rows=1, points=32), id="each seen once"),
        pytest.param(make_readings(12, held_out=0, points=32), id="none held out"),
        pytest.param(make_readings(12, held_out=1, points=32), id="one held out"),
        pytest.param(make_readings(12, held_out=12, points=32), id="all held out"),
    ],
)
def test_too_few_identities_are_refused_before_the_first_step(tmp_path, readings):
    message = refusal(ConfigError, lambda: start(readings, CONFIG, tmp_path, lambda *_: pytest.fail("trained")))
    assert "give more data" in message


def rewrite(path, *, drop: str = "", shape_of: str = "", **about) -> None:
    """The checkpoint with a tensor dropped or misshapen, or other facts."""
    tensors = load_file(path)
    if drop:
        del tensors[next(name for name in sorted(tensors) if drop in name)]
    if shape_of:
        name = next(name for name in sorted(tensors) if shape_of in name)
        tensors[name] = torch.zeros(3, 1, 2)
    history = json.dumps({"step": [4], "loss": [1.0], "error_rate": [0.1], "learning_rate": [0.1]})
    save_file(tensors, path, {"step": "4", "history": history} | about)


DAMAGE = {
    "empty": lambda path: path.write_bytes(b""),
    "text": lambda path: path.write_text("hello"),
    "cut short": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "no facts": lambda path: save_file(load_file(path), path),
    "no step": lambda path: rewrite(path, step="four"),
    "another step": lambda path: rewrite(path, step="5"),
    "no history": lambda path: rewrite(path, history="[]"),
    "deep history": lambda path: rewrite(path, history="[" * 100_000),
    "texts in the history": lambda path: rewrite(
        path, history='{"step": [4], "loss": ["a"], "error_rate": [0.1], "learning_rate": [0.1]}'
    ),
    "uneven history": lambda path: rewrite(
        path, history='{"step": [4], "loss": [], "error_rate": [], "learning_rate": []}'
    ),
    "foreign": lambda path: save_file({"a": torch.zeros(3)}, path, {"step": "4", "history": "{}"}),
    "a weight lacks": lambda path: rewrite(path, drop="module."),
    "a best weight lacks": lambda path: rewrite(path, drop="best."),
    "a moment lacks": lambda path: rewrite(path, drop="exp_avg_sq"),
    "a weight of another shape": lambda path: rewrite(path, shape_of="module."),
    "a best weight of another shape": lambda path: rewrite(path, shape_of="best."),
    "a moment of another shape": lambda path: rewrite(path, shape_of="exp_avg"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_and_foreign_checkpoints_are_one_line(tmp_path, readings, name):
    with pytest.raises(KeyboardInterrupt):
        start(readings, CONFIG, tmp_path, stop_at(5))
    path = tmp_path / "checkpoint.safetensors"
    DAMAGE[name](path)
    message = refusal(ConfigError, lambda: start(readings, CONFIG, tmp_path, lambda *_: pytest.fail("trained")))
    assert str(path) in message
    assert "--resume" in message


def test_a_checkpoint_that_cannot_be_written_is_one_line(tmp_path, readings, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(loop.os, "replace", full)
    message = refusal(OutputError, lambda: start(readings, CONFIG, tmp_path))
    assert "No space left" in message
    assert "--resume" in message
    assert list(tmp_path.iterdir()) == []
