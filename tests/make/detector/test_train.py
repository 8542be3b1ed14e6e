"""From pictures of rectangles to a model file that finds them: the whole of a training, on a few layers."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch

from darknet_files import TINY, write_network
from datasets.making import refusal
from lookonce.boxes import iou
from lookonce.errors import ConfigError, FormatError, OutputError
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.darknet.weights import read_weights
from lookonce.make.detector import learning
from lookonce.make.detector import train as train_module
from lookonce.make.detector.grids import AnchorGrids, decode
from lookonce.make.detector.train import DetectorResult, NetworkSource
from lookonce.model import Model, describe_model
from make.detector.rectangles import CONFIG, NAMES, data_of, one_grid, quick_look, run_training, scene, write_rectangles
from make.training.scenes import Watcher
from model_runs import run_file

LEARNING = replace(CONFIG, epochs=12, check_every=4, learning_rate=3e-2, mosaic=0.3, plain_epochs=6)
SHORT = replace(CONFIG, epochs=4, check_every=1, batch=8)
ONE = replace(SHORT, epochs=1)


@pytest.fixture
def _quick(monkeypatch):
    monkeypatch.setattr(learning, "look", quick_look)


@pytest.fixture
def _no_model_file(monkeypatch):
    """Tracing the network for it takes a second too."""
    monkeypatch.setattr(train_module, "write_detector", lambda *_, **__: None)
    monkeypatch.setattr(train_module, "measure", lambda *_, **__: None)


class Place(NamedTuple):
    """A network and pictures."""

    cfg: Path
    stills: Path


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Place:
    folder = tmp_path_factory.mktemp("place")
    (folder / "net.cfg").write_text(one_grid(stride=8, channels=12))
    return Place(folder / "net.cfg", write_rectangles(folder / "boxes", 40))


class Learnt(NamedTuple):
    """A finished training."""

    output: Path
    result: DetectorResult
    watcher: Watcher

    @property
    def folder(self) -> Path:
        return self.output.with_suffix(".train")


@pytest.fixture(scope="module")
def learnt(place, tmp_path_factory) -> Learnt:
    output, watcher = tmp_path_factory.mktemp("learnt") / "boxes.onnx", Watcher()
    source = NetworkSource(place.cfg)
    result = run_training(source, data_of(place.stills), output, LEARNING, license="CC0-1.0", watcher=watcher)
    return Learnt(output, result, watcher)


def test_average_precision_rises_within_a_few_dozen_steps(learnt):
    history = learnt.result.history
    assert history.epoch == [4, 8, 12]
    assert history.ap50[-1] > 0.7
    assert history.ap50[0] < history.ap50[-1] - 0.2
    assert history.loss[-1] < 0.8 * history.loss[0]
    parts = np.array([history.box, history.objectness, history.classes])
    np.testing.assert_allclose(parts.sum(axis=0), history.loss, rtol=1e-4)
    assert learnt.result.scores.mean.ap == pytest.approx(history.ap[history.best], abs=1e-9)
    assert learnt.result.scores.mean.boxes == 16
    assert learnt.result.pictures == 32


def test_the_model_file_finds_rectangles_in_new_pictures(learnt):
    model, found, all_found = Model(learnt.output, threads=1, score_threshold=0.1), [], 0
    for seed in range(20):
        image, objects = scene(np.random.default_rng(100 + seed))
        detections = model.detect(image)
        all_found += len(detections)
        for label, box in objects:
            own = detections.xyxy[detections.labels == label]
            found.append(iou(np.array([box], np.float32), own).max(initial=0) > 0.5)
    assert np.mean(found) > 0.7  # of 40 objects
    assert all_found < 60


def test_the_model_file_says_how_it_was_trained(learnt):
    metadata = describe_model(learnt.output)
    assert metadata == learnt.result.metadata
    assert metadata.names == NAMES
    assert metadata.license == "CC0-1.0"
    assert metadata.source == {"cfg": "net.cfg", "started_from": "random weights"}
    assert metadata.training["data"] == "boxes"
    assert metadata.training["pictures"] == "32"
    assert "learning_rate=0.03" in metadata.training["settings"]
    assert metadata.descriptor.kind == "native"


def test_stages_and_findings_are_told(learnt):
    assert learnt.watcher.findings[:2] == [
        "boxes: 40 pictures, 40 red, 40 blue",
        "32 pictures to learn from, 8 to validate on",
    ]
    assert learnt.watcher.findings[2].startswith("anchors fitted: ")
    assert learnt.watcher.findings[3:] == ["measuring the model file"]
    assert {stage[0] for stage in learnt.watcher.stages} == {"train"}
    assert learnt.watcher.stages[-1][:3] == ("train", 96, 96)
    assert [s[3] for s in learnt.watcher.stages].count("looking at the validation pictures") == 3


def test_darknets_files_hold_the_network_of_the_model_file(learnt):
    config = read_cfg(learnt.folder / "network.cfg")
    assert config.outputs[0].spec.anchors != ((16, 16), (30, 20), (20, 40))  # fitted
    assert (learnt.folder / "network.names").read_text().split() == list(NAMES)
    network = DarknetNetwork(config).eval()
    network.load_weights_(read_weights(learnt.folder / "network.weights", config)[0])
    pictures = np.stack([scene(np.random.default_rng(seed))[0] for seed in (7, 8)])
    with torch.no_grad():
        raw, _ = network(torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255)
    grids = AnchorGrids(config, torch.device("cpu"))
    for number, outputs in enumerate(grids.outputs(raw)):
        boxes = decode(outputs, grids.facts).numpy()
        scores = (torch.sigmoid(outputs[:, 4:5]) * torch.sigmoid(outputs[:, 5:])).numpy()
        found = run_file(learnt.output, pictures[number : number + 1], score_threshold=0.01, iou_threshold=1.0)
        assert len(found["scores"]) == (scores > 0.01).sum() > 3
        for box, score, label in zip(found["boxes"], found["scores"], found["labels"], strict=True):
            near = np.abs(scores[:, label] - score) < 1e-4
            assert np.abs(boxes[near] - box).max(axis=1).min() < 1e-2


def test_what_is_left_in_the_folder(learnt):
    names = sorted(path.name for path in learnt.folder.iterdir())
    assert names == ["checkpoint.safetensors", "network.cfg", "network.names", "network.weights"]


def result_of(place, output, config=SHORT, **options) -> tuple[bytes, bytes, bytes]:
    """The bytes of the weights, the cfg and the model file."""
    run_training(NetworkSource(place.cfg), data_of(place.stills), output, config, **options)
    folder = output.with_suffix(".train")
    return (folder / "network.weights").read_bytes(), (folder / "network.cfg").read_bytes(), output.read_bytes()


@pytest.fixture(scope="module")
def unbroken(place, tmp_path_factory) -> tuple[bytes, bytes, bytes]:
    """What a short training gives."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learning, "look", quick_look)
        return result_of(place, tmp_path_factory.mktemp("unbroken") / "boxes.onnx")


@pytest.mark.usefixtures("_quick")
def test_the_same_seed_gives_the_same_bytes(place, unbroken, tmp_path):
    torch.manual_seed(12345)  # not what is drawn from
    assert result_of(place, tmp_path / "a.onnx") == unbroken


@pytest.mark.usefixtures("_quick")
@pytest.mark.parametrize(
    "after",
    [
        pytest.param(3, id="before the first look", marks=pytest.mark.slow),
        pytest.param(10, id="after a look"),
        pytest.param(20, id="at the last step", marks=pytest.mark.slow),
    ],
)
def test_an_interrupted_training_ends_with_the_same_bytes(place, unbroken, tmp_path, after):
    with pytest.raises(KeyboardInterrupt):
        result_of(place, tmp_path / "boxes.onnx", watcher=Watcher("train", after))
    assert not (tmp_path / "boxes.onnx").exists()
    watcher = Watcher()
    assert result_of(place, tmp_path / "boxes.onnx", watcher=watcher) == unbroken
    steps = [done for stage, done, *_ in watcher.stages if stage == "train"]
    assert (steps[0] > 4) == (after > 4)


@pytest.mark.usefixtures("_quick")
def test_the_callers_randomness_and_threads_stay_as_they_are(place, tmp_path, monkeypatch):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        torch.manual_seed(77)
        expected = torch.get_rng_state()
        run_training(NetworkSource(place.cfg), data_of(place.stills), tmp_path / "a.onnx", ONE)
        assert torch.equal(torch.get_rng_state(), expected)
        assert torch.get_num_threads() == 2
        monkeypatch.setattr(train_module, "learn", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            run_training(NetworkSource(place.cfg), data_of(place.stills), tmp_path / "b.onnx", ONE)
        assert torch.equal(torch.get_rng_state(), expected)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


@pytest.mark.usefixtures("_quick", "_no_model_file")
@pytest.mark.parametrize(
    "change",
    [
        pytest.param({"precision": "bf16-mixed"}, id="bf16-mixed"),
        pytest.param({"precision": "auto"}, id="auto"),
        pytest.param({"positives": "best", "box_loss": "squared", "objectness": "one"}, id="as published"),
        pytest.param({"average_decay": 0.0, "mosaic": 0.0, "warm_up_epochs": 0.0}, id="plain"),
        pytest.param({"batch": 32, "mosaic": 1.0, "plain_epochs": 0}, id="batch of all"),
        pytest.param({"fit_anchors": False}, id="its own anchors"),
    ],
)
def test_settings_train_without_a_complaint(place, tmp_path, change):
    config = replace(ONE, **change)
    result = run_training(NetworkSource(place.cfg), data_of(place.stills), tmp_path / "a.onnx", config)
    assert np.isfinite(result.history.loss).all()
    assert all(np.isfinite(w.kernel).all() for w in weights_in(tmp_path / "a.train").values())
    anchors = read_cfg(tmp_path / "a.train" / "network.cfg").outputs[0].spec.anchors
    assert (anchors == ((16, 16), (30, 20), (20, 40))) == (not config.fit_anchors)


def weights_in(folder: Path):
    """The weights that a training left."""
    return read_weights(folder / "network.weights", read_cfg(folder / "network.cfg"))[0]


@pytest.mark.usefixtures("_quick")
def test_another_size_and_number_of_classes(place, tmp_path):
    (tmp_path / "three.cfg").write_text(one_grid(stride=8, classes=3))
    source = NetworkSource(tmp_path / "three.cfg", size=(64, 96), change_classes=True)
    result = run_training(source, data_of(place.stills), tmp_path / "a.onnx", ONE)
    assert result.metadata.size == (64, 96)
    assert result.metadata.names == NAMES
    written = read_cfg(tmp_path / "a.train" / "network.cfg")
    assert (written.size, written.classes) == ((64, 96), 2)


# --- starting from weights ---


def start_from(place, tmp_path, monkeypatch, body, source_names, classes, **change):
    """The weights that training would start with, those of the file, and the network."""
    cfg, path = write_network(tmp_path, body, seed=3)
    caught = {}

    def catch(network, *_, **__):
        caught.update(network.weights())
        raise KeyboardInterrupt

    monkeypatch.setattr(train_module, "learn", catch)
    source = NetworkSource(cfg, path, source_names, **change)
    data = data_of(write_rectangles(tmp_path / "stills", 16, names=classes))
    with pytest.raises(KeyboardInterrupt):
        run_training(source, data, tmp_path / "a.onnx", classes=classes)
    return caught, read_weights(path, read_cfg(cfg))[0], read_cfg(cfg)


def assert_body_is_taken_over(found, theirs, network) -> None:
    heads = {layer.index - 1 for layer in network.outputs}
    for index in theirs.keys() - heads:
        for field in ("kernel", "bias", "scale", "mean", "variance"):
            np.testing.assert_array_equal(getattr(found[index], field), getattr(theirs[index], field))


@pytest.mark.parametrize("names", [(), NAMES], ids=["without names", "with names"])
def test_weights_of_the_same_classes_are_taken_over_whole(place, tmp_path, monkeypatch, names):
    found, theirs, network = start_from(place, tmp_path, monkeypatch, one_grid(stride=8), names, NAMES)
    assert_body_is_taken_over(found, theirs, network)
    head = network.outputs[0].index - 1
    np.testing.assert_array_equal(found[head].kernel, theirs[head].kernel)
    np.testing.assert_array_equal(found[head].bias, theirs[head].bias)


@pytest.mark.parametrize(
    ("source_names", "classes", "pairs"),
    [
        pytest.param(("cat", "blue", "dog"), NAMES, {1: 1}, id="one of two"),
        pytest.param(("blue", "dog", "red"), NAMES, {0: 2, 1: 0}, id="in another order"),
        pytest.param(("dog", "aeroplane", "car"), ("airplane", "Car"), {0: 1, 1: 2}, id="spelt otherwise"),
        pytest.param((), NAMES, {}, id="without names"),
    ],
)
def test_weights_of_other_classes_are_taken_over_by_name(place, tmp_path, monkeypatch, source_names, classes, pairs):
    body = one_grid(stride=8, classes=3)
    found, theirs, network = start_from(place, tmp_path, monkeypatch, body, source_names, classes, change_classes=True)
    assert_body_is_taken_over(found, theirs, network)
    head = network.outputs[0].index - 1
    ours, other = found[head].kernel.reshape(3, 7, -1), theirs[head].kernel.reshape(3, 8, -1)
    our_bias, other_bias = found[head].bias.reshape(3, 7), theirs[head].bias.reshape(3, 8)
    np.testing.assert_array_equal(ours[:, :5], other[:, :5])
    np.testing.assert_array_equal(our_bias[:, :5], other_bias[:, :5])
    for number in range(2):
        if number in pairs:
            np.testing.assert_array_equal(ours[:, 5 + number], other[:, 5 + pairs[number]])
            np.testing.assert_array_equal(our_bias[:, 5 + number], other_bias[:, 5 + pairs[number]])
        else:  # fresh
            assert (our_bias[:, 5 + number] == 0).all()
            assert not any(np.array_equal(ours[:, 5 + number], other[:, 5 + n]) for n in range(3))


def test_two_classes_in_another_order_are_put_in_order(place, tmp_path, monkeypatch):
    found, theirs, network = start_from(place, tmp_path, monkeypatch, one_grid(stride=8), NAMES[::-1], NAMES)
    head = network.outputs[0].index - 1
    ours, other = found[head].kernel.reshape(3, 7, -1), theirs[head].kernel.reshape(3, 7, -1)
    np.testing.assert_array_equal(ours[:, [5, 6]], other[:, [6, 5]])


# --- what cannot work ---


def refused(kind, place, output, source, **options) -> str:
    return refusal(kind, lambda: run_training(source, data_of(place.stills), output, SHORT, **options))


@pytest.mark.parametrize("name", ["region-reorg", "new-coords"])
def test_networks_of_other_outputs_are_refused(place, tmp_path, name):
    (tmp_path / "net.cfg").write_text(TINY[name])
    message = refused(ConfigError, place, tmp_path / "a.onnx", NetworkSource(tmp_path / "net.cfg", change_classes=True))
    assert "only [yolo] outputs without new_coords can be trained" in message
    assert message.startswith(f"{tmp_path / 'net.cfg'}:")


def test_other_classes_than_the_networks_must_be_asked_for(place, tmp_path):
    (tmp_path / "net.cfg").write_text(one_grid(classes=5))
    message = refused(ConfigError, place, tmp_path / "a.onnx", NetworkSource(tmp_path / "net.cfg"))
    assert "has 5 classes, but the data have 2 (red, blue); give --change-classes" in message


def test_names_that_do_not_fit_the_weights_are_refused(place, tmp_path):
    cfg, path = write_network(tmp_path, one_grid())
    message = refused(ConfigError, place, tmp_path / "a.onnx", NetworkSource(cfg, path, ("red",)))
    assert "has 2 classes, but 1 names were given" in message


def test_wrong_sizes_devices_and_batches_are_refused(place, tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    output, source = tmp_path / "a.onnx", NetworkSource(place.cfg)
    assert "multiple of 8" in refused(ConfigError, place, output, replace(source, size=(60, 64)))
    assert "expected auto, cpu or cuda" in refused(ConfigError, place, output, source, device="abacus")
    assert "sees no CUDA device" in refused(ConfigError, place, output, source, device="cuda")
    assert "expected a multiple of the 3 devices" in refused(ConfigError, place, output, source, devices=3)
    assert "check the path" in refused(FormatError, place, output, NetworkSource(tmp_path / "gone.cfg"))


def test_a_damaged_picture_is_named(place, tmp_path):
    folder = write_rectangles(tmp_path / "boxes", 16)
    paths = sorted((folder / "images").iterdir())
    whole = data_of(folder)
    for path in paths:
        path.write_bytes(path.read_bytes()[:100])
    message = refusal(FormatError, lambda: run_training(NetworkSource(place.cfg), whole, tmp_path / "a.onnx", SHORT))
    assert "not a picture, or damaged" in message
    assert str(folder) in message


@pytest.mark.usefixtures("_quick")
@pytest.mark.parametrize("name", ["network.cfg", "network.weights", "a.onnx"])
def test_a_full_disk_is_one_line_and_what_was_learnt_is_kept(place, tmp_path, monkeypatch, name):
    rename = os.replace

    def full(source, target, *rest):
        if Path(target).name == name:
            raise OSError(28, "No space left on device")
        rename(source, target, *rest)

    monkeypatch.setattr(os, "replace", full)
    message = refusal(
        OutputError,
        lambda: run_training(NetworkSource(place.cfg), data_of(place.stills), tmp_path / "a.onnx", ONE),
    )
    assert name in message
    assert "No space left on device" in message
    assert (tmp_path / "a.train" / "checkpoint.safetensors").exists() == (name != "network.cfg")
    assert not (tmp_path / "a.onnx").exists()
