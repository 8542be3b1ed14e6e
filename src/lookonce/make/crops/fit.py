"""Trains the crop network on the identities that `lookonce fit` would train a head on, and writes it as ONNX."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np
import onnx_ir as ir
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor, nn

from lookonce.compare.crops import CROP_SIZE, METADATA_KEY
from lookonce.errors import ConfigError, OutputError
from lookonce.make.crops.network import CropNetwork
from lookonce.make.crops.reading import read_crops
from lookonce.make.descriptors.head import DESCRIPTOR_SIZE
from lookonce.make.export.graph import GraphWriter
from lookonce.make.export.tracing import trace
from lookonce.make.training.batches import comparable
from lookonce.make.training.config import FitConfig
from lookonce.make.training.fit import FitData, Progress
from lookonce.make.training.linking import link_detections
from lookonce.make.training.loop import History, train
from lookonce.make.training.objectives import contrastive_loss
from lookonce.make.training.readings import Readings
from lookonce.make.training.sources import SequenceSource, Source, TrackedBoxes
from lookonce.make.training.stills import StillsSource
from lookonce.make.training.validation import Validation, check_comparable
from lookonce.model import Model
from lookonce.video import open_video

__all__ = ["fit_crops"]


def fit_crops(
    model: Model, data: FitData, output: Path, config: FitConfig, *, threads: int, progress: Progress
) -> Validation:
    """Train the network and write it.

    Args:
        model: finds objects in videos without labels; pictures are scaled to its input, as for its own descriptors.
        data: what to learn from; stills need labels.
        output: the ONNX file.
        config: settings; ``kind`` plays no part.
        threads: processors to use.
        progress: who watches.

    Raises:
        LookonceError: an input is wrong, or the file cannot be written.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=r"PIL\.")  # of pictures that are large, and of damaged EXIF
        sources = _sources(model, data, config, progress)
        check_comparable([source.lifetimes[source.held_out] for source in sources])
        readings = read_crops(
            sources,
            workers=threads,
            limit_bytes=round(config.cache_gb * 1e9),
            report=lambda done, total: progress.stage("cut out", done, total),
        )
    seen = len(np.unique(readings.identity))
    progress.say(f"{len(readings)} cut-out boxes of {seen} identities")
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with torch.random.fork_rng([]), tempfile.TemporaryDirectory(prefix="lookonce-crops-") as folder:
            torch.manual_seed(config.seed)
            network = _Trainable(readings, config.temperature)
            _, validation = train(
                network,
                readings,
                config,
                Path(folder),
                device=torch.device("cpu"),
                report=lambda step, history: progress.stage("train", step, config.steps, _note(history)),
            )
            _write(network.module, output, validation, config)
    finally:
        torch.set_num_threads(before)
    return validation


def _note(history: History) -> str:
    return f"error rate {min(history.error_rate):.3f}" if history.error_rate else ""


def _sources(model: Model, data: FitData, config: FitConfig, progress: Progress) -> list[Source]:
    """The sources that `lookonce fit` would read; of each a share of the identities is held out."""
    rng = np.random.default_rng([config.seed, 0])
    tracked = [TrackedBoxes.of_sequence(sequence) for sequence in data.sequences]
    tracked += [_linked(path, model, config.score, progress) for path in data.videos]
    sources: list[Source] = []
    for number, boxes in enumerate(one for one in tracked if len(one.frames)):
        held = _held_out(boxes, config.held_out, rng)
        seed = [config.seed, 1, number]
        sources.append(SequenceSource(boxes, model.size, frames=config.sequence_frames, held_out=held, seed=seed))
    for number, stills in enumerate(data.stills):
        if not any(len(objects) for objects in stills.objects):
            raise ConfigError(f"{stills.name}: no labels, which the crop network needs; leave it out")
        sources.append(
            StillsSource(
                stills,
                model.size,
                views=config.views,
                collages=config.collages,
                variants=config.variants,
                held_out=config.held_out,
                seed=[config.seed, 2, number],
            )
        )
    return [source for source in sources if source.task_count]


def _linked(path: Path, model: Model, score: float, progress: Progress) -> TrackedBoxes:
    """Pure tracks of an unlabelled video."""
    frames = []
    with open_video(path) as video:
        for frame in video:
            found = model.detect(frame)
            frames.append((frame.index, frame.time_s, found[found.scores >= np.float32(score)]))
            progress.stage(f"link {path.name}", len(frames), video.frame_count)
    return TrackedBoxes.of_links(path.stem, path, link_detections(frames))


def _held_out(boxes: TrackedBoxes, share: float, rng: Generator) -> NDArray[np.bool_]:
    """Identities that are there around one moment, so that they can be compared with each other."""
    middle = boxes.spans().mean(axis=1)
    count = max(2, round(share * len(middle))) if len(middle) >= 4 else 0
    order = rng.permutation(len(middle))
    if count:
        order = order[np.argsort(np.abs(middle[order] - middle[order[0]]), kind="stable")]
    return np.isin(np.arange(len(middle)), order[:count])


class _Trainable:
    """The network with its objective, as the training loop wants it."""

    def __init__(self, readings: Readings, temperature: float) -> None:
        self._readings, self._temperature = readings, temperature
        self._network = CropNetwork()

    @property
    def module(self) -> nn.Module:
        return self._network

    def loss(self, values: Mapping[str, Tensor], rows: NDArray[np.int64]) -> Tensor:
        descriptors = self.describe(values)
        identity = torch.from_numpy(self._readings.identity[rows])
        is_comparable = torch.from_numpy(comparable(self._readings, rows))
        return contrastive_loss(descriptors, identity, is_comparable, self._temperature)

    def describe(self, values: Mapping[str, Tensor]) -> Tensor:
        described: Tensor = self._network(values["crop"].permute(0, 3, 1, 2).float() / 255)
        return described


class _ForExport(nn.Module):
    """The network with outputs as ``trace`` takes them."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, planes: Tensor) -> tuple[list[Tensor], dict[str, Tensor]]:
        return [self.network(planes)], {}


def _write(network: nn.Module, output: Path, validation: Validation, config: FitConfig) -> None:
    """``crops uint8 (N, 64, 64, 3)`` in, ``descriptors float32 (N, 128)`` out; written in one step."""
    model, values = trace(_ForExport(network).eval(), (CROP_SIZE, CROP_SIZE), ["raw"])
    g = GraphWriter(model.graph)
    g.output("descriptors", values["raw"], ir.DataType.FLOAT, ["crops", DESCRIPTOR_SIZE], "of unit length")
    about = {
        "format": 1,
        "match_threshold": round(validation.threshold, 4),
        "error_rate": round(validation.error_rate, 4),
        "seed": config.seed,
        "made_by": version("lookonce"),
    }
    model.metadata_props.clear()
    model.metadata_props[METADATA_KEY] = json.dumps(about)
    model.producer_name, model.producer_version = "lookonce", version("lookonce")
    unfinished = output.with_name(f".{output.name}.unfinished")
    try:
        ir.save(model, unfinished)
        os.replace(unfinished, output)
    except OSError as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(f"{output}: cannot be written ({exc.strerror}); choose another place with -o") from exc
