"""The training loop: it can be interrupted at any step, ends with what did best, and says what went wrong."""

from __future__ import annotations

import copy
import json
import math
from contextlib import suppress
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from lightning_fabric import Fabric
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file

from datasets.making import refusal
from lookonce.errors import ConfigError, OutputError
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.detector import learning
from lookonce.make.detector.gather import Gathered
from lookonce.make.detector.learning import CHECKPOINT, DetectorHistory, learn, prepare_
from lookonce.make.detector.objective import Objective
from make.detector.rectangles import (
    CONFIG,
    NAMES,
    data_of,
    make_sample,
    network_of,
    one_grid,
    quick_look,
    write_rectangles,
)

COUNT = 12
CONFIG = replace(CONFIG, epochs=4, check_every=1, batch=4)  # 3 steps an epoch


@pytest.fixture(scope="module", autouse=True)
def _one_thread():
    """For the fixtures of the module too: sums depend on the number of threads."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def gathered(tmp_path_factory) -> Gathered:
    stills = data_of(write_rectangles(tmp_path_factory.mktemp("data") / "boxes", COUNT)).stills[0]
    samples = [
        make_sample(path, objects.xyxy, objects.labels)
        for path, objects in zip(stills.pictures, stills.objects, strict=True)
    ]
    return Gathered(NAMES, samples, samples[:2])


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return network_of(tmp_path_factory.mktemp("net"), one_grid(channels=4))


@pytest.fixture(autouse=True)
def looks(monkeypatch) -> list[dict[str, torch.Tensor]]:
    """Looks that take no time, rising or as ``planned``; the weights that each has seen."""
    seen: list[dict[str, torch.Tensor]] = []

    def look(network, *args, **options):
        seen.append({name: value.clone() for name, value in network.state_dict().items()})
        return quick_look(network, *args, **options)

    monkeypatch.setattr(learning, "look", look)
    return seen


def plan(monkeypatch, *figures: float) -> None:
    """Looks with these figures."""
    rest, look = iter(figures), learning.look

    def planned(*args, **options):
        look(*args, **options)
        value = next(rest)
        return SimpleNamespace(mean=SimpleNamespace(ap=value, ap50=value / 2))

    monkeypatch.setattr(learning, "look", planned)


def start(network, gathered, folder, config=CONFIG, report=lambda *_: None, *, threads=0, precision="32-true"):
    """Train a fresh network; it and its history."""
    folder.mkdir(exist_ok=True)
    torch.manual_seed(config.seed)
    made = DarknetNetwork(network)
    prepare_(made)
    made.to(memory_format=torch.channels_last)
    fabric = Fabric(accelerator="cpu", devices=1, precision=precision)
    return made, learn(made, gathered, config, folder, fabric=fabric, threads=threads, report=report)


def weights(module) -> dict[str, bytes]:
    return {name: value.numpy().tobytes() for name, value in module.state_dict().items()}


def content(path) -> tuple[dict[str, str], dict[str, bytes]]:
    """All that a checkpoint holds, whatever its order."""
    with safe_open(path, "pt") as file:
        about = dict(file.metadata())
    return about, {name: value.numpy().tobytes() for name, value in load_file(path).items()}


def stop_at(step: int):
    def report(stage: str, done: int, total: int, note: str) -> None:
        if done == step:
            raise KeyboardInterrupt

    return report


@pytest.fixture(scope="module")
def whole(network, gathered, tmp_path_factory):
    """Weights, history and checkpoint of a training that nothing interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learning, "look", quick_look)
        made, history = start(network, gathered, folder)
    return weights(made), history, folder / CHECKPOINT


@pytest.mark.parametrize("step", [1, 3, 4, 7, 9, 11, 12])
def test_a_resumed_training_ends_with_the_same_bytes(network, gathered, whole, tmp_path, step):
    with pytest.raises(KeyboardInterrupt):
        start(network, gathered, tmp_path, report=stop_at(step))
    assert (tmp_path / CHECKPOINT).exists() == (step > 3)
    steps = []
    made, history = start(network, gathered, tmp_path, report=lambda stage, done, *_: steps.append(done))
    assert steps[0] == (step - 1) // 3 * 3 + 1
    assert weights(made) == whole[0]
    assert history == whole[1]
    kept, expected = (content(folder / CHECKPOINT) for folder in (tmp_path, whole[2].parent))
    assert kept == expected


def test_worker_processes_change_nothing(network, gathered, whole, tmp_path):
    made, history = start(network, gathered, tmp_path, threads=2)
    assert weights(made) == whole[0]
    assert history == whole[1]


def test_a_finished_training_is_not_trained_again(network, gathered, whole, tmp_path):
    (tmp_path / CHECKPOINT).write_bytes(whole[2].read_bytes())
    made, history = start(network, gathered, tmp_path, report=lambda *_: pytest.fail("trained"))
    assert weights(made) == whole[0]
    assert history == whole[1]


def test_another_seed_gives_other_weights(network, gathered, whole, tmp_path):
    made, _ = start(network, gathered, tmp_path, replace(CONFIG, seed=1))
    assert weights(made) != whole[0]


def test_the_history_holds_means_since_the_look_before(network, gathered, whole, tmp_path):
    notes = []
    _, history = start(
        network, gathered, tmp_path, report=lambda stage, done, total, note: notes.append((done, total, note))
    )
    losses = [float(note.split(",")[0].removeprefix("loss ")) for _, _, note in notes if note.startswith("loss")]
    assert len(losses) == 12
    np.testing.assert_allclose(history.loss, np.reshape(losses, (4, 3)).mean(axis=1), atol=0.006)
    assert history.epoch == [1, 2, 3, 4]
    assert {total for _, total, _ in notes} == {12}
    assert "AP50" not in notes[0][2]
    assert notes[-2][2].endswith(f"AP50 {history.ap50[int(np.argmax(history.ap[:3]))]:.3f}")


def test_the_weights_that_did_best_are_kept(network, gathered, tmp_path, monkeypatch, looks):
    plan(monkeypatch, 0.1, 0.5, 0.5, 0.2)
    made, history = start(network, gathered, tmp_path)
    assert history.ap == [0.1, 0.5, 0.5, 0.2]
    assert history.best == 1
    assert all(torch.equal(value, looks[1][name]) for name, value in made.state_dict().items())
    assert any(not torch.equal(value, looks[2][name]) for name, value in made.state_dict().items())


def test_training_stops_after_looks_without_progress(network, gathered, tmp_path, monkeypatch, looks):
    plan(monkeypatch, 0.1, 0.5, 0.3, 0.4, 0.9)
    config = replace(CONFIG, epochs=9, patience=2)
    made, history = start(network, gathered, tmp_path, config)
    assert history.epoch == [1, 2, 3, 4]
    assert all(torch.equal(value, looks[1][name]) for name, value in made.state_dict().items())
    again, same = start(network, gathered, tmp_path, config, lambda *_: pytest.fail("trained"))
    assert weights(again) == weights(made)
    assert same == history


@pytest.mark.parametrize(
    ("epochs", "every", "expected"), [(4, 3, [3, 4]), (4, 9, [4]), (4, 2, [2, 4]), (1, 5, [1])], ids=str
)
def test_looks_come_as_asked_for_and_at_the_end(network, gathered, tmp_path, epochs, every, expected):
    _, history = start(network, gathered, tmp_path, replace(CONFIG, epochs=epochs, check_every=every))
    assert history.epoch == expected


def test_the_average_is_what_is_looked_at(network, gathered, tmp_path, looks):
    start(network, gathered, tmp_path / "none", replace(CONFIG, average_decay=0.0, epochs=1))
    saved = load_file(tmp_path / "none" / CHECKPOINT)
    assert all(torch.equal(saved[f"network.{name}"], value) for name, value in looks[0].items())
    start(network, gathered, tmp_path / "some", replace(CONFIG, epochs=1))
    saved = load_file(tmp_path / "some" / CHECKPOINT)
    assert all(torch.equal(saved[f"average.{name}"], value) for name, value in looks[1].items())
    assert any(not torch.equal(saved[f"network.{name}"], value) for name, value in looks[1].items())


def test_the_average_moves_as_stated(network):
    torch.manual_seed(0)
    made = DarknetNetwork(network)
    average = copy.deepcopy(made)
    before = {name: value.clone() for name, value in average.state_dict().items()}
    with torch.no_grad():
        for value in made.state_dict().values():
            value += 1
    learning._average_(average, made, 0.999, step=2)  # early: 3/12 instead of 0.999
    for name, value in average.state_dict().items():
        moved = 1 if name.endswith("num_batches_tracked") else 0.75
        torch.testing.assert_close(value, before[name] + moved)
    learning._average_(average, made, 0.9, step=1000)
    value = average.blocks["0"].convolution.weight
    torch.testing.assert_close(value, before["blocks.0.convolution.weight"] + 0.775)


def test_the_learning_rate_rises_and_falls():
    config = replace(CONFIG, epochs=10, learning_rate=1e-2, warm_up_epochs=2)
    schedule = learning._Schedule(5, config)
    rates = [schedule.learning_rate(step) for step in range(50)]
    assert rates[:10] == pytest.approx(np.arange(1, 11) * 1e-3)
    assert rates[10] == pytest.approx(1e-2)
    assert rates[10:] == sorted(rates[10:], reverse=True)
    assert rates[30] == pytest.approx(1e-2 * (0.01 + 0.99 / 2))
    assert 1e-4 <= rates[-1] < 2e-4
    assert learning._Schedule(1, replace(config, epochs=1)).learning_rate(0) > 0


def test_only_kernels_decay(network):
    kernels, others = learning._groups(DarknetNetwork(network), 0.3)
    assert (kernels["weight_decay"], others["weight_decay"]) == (0.3, 0.0)
    assert {p.ndim for p in kernels["params"]} == {4}
    assert {p.ndim for p in others["params"]} == {1}
    assert len(kernels["params"]) + len(others["params"]) == len(list(DarknetNetwork(network).parameters()))


def test_a_network_starts_with_hardly_any_objectness(network):
    made = DarknetNetwork(network)
    prepare_(made, prior=0.02)
    bias = made.blocks[str(network.outputs[0].index - 1)].convolution.bias.detach().reshape(3, 7)
    torch.testing.assert_close(torch.sigmoid(bias[:, 4]), torch.full((3,), 0.02))
    assert (bias[:, [0, 1, 2, 3, 5, 6]] == 0).all()


def test_best_look_and_patience():
    history = DetectorHistory()
    assert not history.is_spent(1)
    for ap, spent in ((0.2, False), (0.4, False), (0.4, False), (0.3, True), (0.5, False)):
        history.epoch.append(len(history.epoch) + 1)
        history.ap.append(ap)
        assert history.is_spent(2) == spent
    assert history.best == 4


def test_training_in_bfloat16_keeps_weights_in_float32(network, gathered, whole, tmp_path):
    made, history = start(network, gathered, tmp_path, precision="bf16-mixed")
    assert {value.dtype for name, value in made.state_dict().items() if "tracked" not in name} == {torch.float32}
    assert history.loss == pytest.approx(whole[1].loss, rel=0.2)
    assert history.loss != whole[1].loss


# --- what goes wrong ---


def save_again(path, change) -> None:
    """Write a checkpoint anew with something else in it."""
    with safe_open(path, "pt") as file:
        about = dict(file.metadata())
    tensors = load_file(path)
    change(tensors, about)
    save_file(tensors, path, about)


def without_epoch(about) -> None:
    history = json.loads(about["history"])
    history["epoch"] = history["epoch"][:-1]
    about["history"] = json.dumps(history)


DAMAGE = {
    "empty": lambda path: path.write_bytes(b""),
    "cut short": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "text": lambda path: path.write_text("hello " * 1000),
    "no step": lambda path: save_again(path, lambda tensors, about: about.pop("step")),
    "no history": lambda path: save_again(path, lambda tensors, about: about.update(history="[]")),
    "history of other things": lambda path: save_again(path, lambda t, about: about.update(history='{"a": [1]}')),
    "history without a look": lambda path: save_again(
        path, lambda t, about: about.update(history=json.dumps(asdict(DetectorHistory())))
    ),
    "columns of two lengths": lambda path: save_again(path, lambda tensors, about: without_epoch(about)),
    "no best": lambda path: save_again(path, lambda t, about: [t.pop(n) for n in [*t] if n.startswith("best.")]),
    "no moments": lambda path: save_again(path, lambda t, about: [t.pop(n) for n in [*t] if n.startswith("optim")]),
    "a moment missing": lambda path: save_again(path, lambda t, about: [t.pop(n) for n in [*t] if ".3.exp" in n]),
    "a weight missing": lambda path: save_again(path, lambda t, about: t.pop("network.blocks.0.convolution.weight")),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_checkpoints_are_one_line(network, gathered, whole, tmp_path, name):
    path = tmp_path / CHECKPOINT
    path.write_bytes(whole[2].read_bytes())
    DAMAGE[name](path)
    message = refusal(ConfigError, lambda: start(network, gathered, tmp_path))
    assert message == f"{path}: not a checkpoint of this network, or damaged; remove it, or begin with --overwrite"


def test_a_checkpoint_of_another_network_is_one_line(gathered, whole, tmp_path):
    (tmp_path / CHECKPOINT).write_bytes(whole[2].read_bytes())
    other = network_of(tmp_path, one_grid(channels=6))
    assert "not a checkpoint of this network" in refusal(ConfigError, lambda: start(other, gathered, tmp_path))
    (tmp_path / "net.cfg").unlink()
    longer = network_of(tmp_path, one_grid(channels=4, stride=32))
    assert "not a checkpoint of this network" in refusal(ConfigError, lambda: start(longer, gathered, tmp_path))


class Planted(Objective):
    """Has a fault at one step."""

    step, at, fault = 0, 0, "loss"

    def __call__(self, raw, truth):
        Planted.step += 1
        losses = super().__call__(raw, truth)
        if Planted.step != Planted.at:
            return losses
        if Planted.fault == "loss":
            return replace(losses, total=losses.total * math.nan)
        bad = (raw[0] * 0).sum().sqrt()  # 0, with a slope that is no number
        return replace(losses, total=losses.total + bad)


@pytest.mark.parametrize(("fault", "told"), [("loss", 5), ("slope", 6)])
def test_a_loss_that_is_no_number_is_one_line_and_the_last_checkpoint_is_kept(
    network, gathered, whole, tmp_path, monkeypatch, fault, told
):
    """The clipping of gradients raised an error of its own before the loss was looked at."""
    with monkeypatch.context() as patch:
        patch.setattr(learning, "Objective", Planted)
        patch.setattr(Planted, "step", 0)
        patch.setattr(Planted, "at", 5)
        patch.setattr(Planted, "fault", fault)
        message = refusal(ConfigError, lambda: start(network, gathered, tmp_path))
    assert message.startswith(f"the loss is not a finite number at step {told}; try a lower learning_rate")
    made, history = start(network, gathered, tmp_path)
    assert weights(made) == whole[0]
    assert history == whole[1]


def test_an_absurd_learning_rate_has_finite_losses_as_far_as_it_gets(network, gathered, tmp_path):
    config = replace(CONFIG, learning_rate=1.0, weight_decay=0, box_weight=100, warm_up_epochs=0)
    losses = []
    with suppress(ConfigError):
        start(network, gathered, tmp_path, config, lambda stage, done, total, note: losses.append(note))
    assert losses
    assert not any("nan" in note or "inf" in note for note in losses)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), SafetensorError("No space left")])
def test_a_full_disk_is_one_line_and_the_checkpoint_before_is_kept(
    network, gathered, whole, tmp_path, monkeypatch, error
):
    times = []

    def full(tensors, path, about):
        times.append(path)
        if len(times) == 2:
            path.write_bytes(b"half of it")
            raise error
        save_file(tensors, path, about)

    monkeypatch.setattr(learning, "save_file", full)
    message = refusal(OutputError, lambda: start(network, gathered, tmp_path))
    assert message.startswith(f"{tmp_path / CHECKPOINT}: cannot write the checkpoint (")
    assert "No space left" in message
    assert message.endswith("make room and go on with --resume")
    assert [path.name for path in tmp_path.iterdir()] == [CHECKPOINT]
    made, _ = start(network, gathered, tmp_path)
    assert weights(made) == whole[0]
