"""The kinds of heads as the training loop wants them: a module, a loss, descriptors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np
import onnx_ir as ir
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lookonce.make.descriptors.compact import CompactHead, CompactKind
from lookonce.make.descriptors.paper import PaperHead, PaperKind
from lookonce.make.descriptors.paper_loss import PaperClassifier, paper_loss
from lookonce.make.export.detections import SelectedDetections
from lookonce.make.export.graph import GraphWriter
from lookonce.make.training.batches import comparable
from lookonce.make.training.config import FitConfig
from lookonce.make.training.loop import Trainable
from lookonce.make.training.objectives import contrastive_loss
from lookonce.make.training.readings import Readings
from lookonce.model import ModelMetadata

__all__ = ["Head", "Kind", "kind_of", "settled", "trainable_for"]

_ROWS_FOR_STATISTICS = 2048  # of 32 points each; more would take much memory and change little
_OF_ANY_CLASS = ("clips", "stills")  # kinds of sources that teach the networks of all classes

Kind = CompactKind | PaperKind


class Head(Trainable, Protocol):
    """A trainable head that can be written into a model file."""

    def write(self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]) -> ir.Value:
        """Append the head to a graph, reading included: descriptors (N, 128) of the rows."""
        ...


def kind_of(name: str, metadata: ModelMetadata) -> Kind:
    """The layout of a kind of head for one detector."""
    return PaperKind.of(metadata) if name == "paper" else CompactKind.of(metadata)


def settled(kind: Kind, readings: Readings) -> Readings:
    """The same readings, all rows of an identity for one network: that of most of its rows.

    A view may be so small or blurred that the detector takes a car for a person; such an object would hardly be
    detected. Of rendered people it is known what they are.
    """
    if isinstance(kind, PaperKind):
        return readings
    seen = np.bincount(readings.identity)
    people = np.bincount(readings.identity, readings.values["group"])
    is_rendered = np.array([name == "rendered people" for name in readings.kinds])[readings.source]
    group = np.where(is_rendered, max(kind.groups), (2 * people > seen)[readings.identity]).astype(np.int64)
    return replace(readings, values={**readings.values, "group": group})


def trainable_for(kind: Kind, readings: Readings, config: FitConfig) -> Head:
    """A fresh head with its objective; weights drawn from torch's global generator."""
    if isinstance(kind, PaperKind):
        return _Paper(kind, readings)
    return _Compact(kind, readings, config)


class _Compact:
    """Kind ``compact`` with its contrastive loss, summed over the networks of the head.

    Stills and clips teach all of them, whatever they show: more identities are worth more than a class of one's own.
    Labelled sequences and rendered crowds have much of one class, and each row teaches the network of its class alone.

    One more term, of weight ``config.shared_space``, holds the networks' spaces together: of the rows that teach all of
    them, each is read by one of them at random. An object whose class changes, and so the network, then still
    resembles itself.
    """

    def __init__(self, kind: CompactKind, readings: Readings, config: FitConfig) -> None:
        self._readings, self._temperature, self._shared_space = readings, config.temperature, config.shared_space
        points = readings.values["points"]
        some = np.linspace(0, len(points) - 1, min(len(points), _ROWS_FOR_STATISTICS)).astype(int)
        channels = points[some].astype(np.float32).reshape(-1, points.shape[-1])
        self._head = CompactHead(kind, channels.mean(axis=0), channels.std(axis=0), config.embedding, config.gate)
        is_of_any = np.isin(np.array(readings.kinds), _OF_ANY_CLASS)[readings.source]
        self._teaches = [is_of_any | (readings.values["group"] == number) for number in range(len(self._head.networks))]

    @property
    def module(self) -> nn.Module:
        return self._head

    def loss(self, values: Mapping[str, Tensor], rows: NDArray[np.int64]) -> Tensor:
        points = values["points"]
        either = np.all(self._teaches, axis=0)[rows]
        losses, described = [], []
        for number, teaches in enumerate(self._teaches):
            some = np.flatnonzero(teaches[rows])
            if len(some):
                descriptors = self._head.describe_by(number, points[torch.from_numpy(some).to(points.device)])
                losses.append(self._contrast(descriptors, rows[some]))
                described.append(descriptors[torch.from_numpy(either[some]).to(points.device)])
        if self._shared_space > 0 and len(self._teaches) > 1 and either.any():
            of_network = nn.functional.one_hot(torch.randint(len(described), (len(described[0]),)), len(described))
            mixed = (torch.stack(described) * of_network.T[..., None].to(points.device)).sum(dim=0)
            losses.append(self._shared_space * self._contrast(mixed, rows[either]))
        return torch.stack(losses).sum()

    def _contrast(self, descriptors: Tensor, rows: NDArray[np.int64]) -> Tensor:
        identity = torch.from_numpy(self._readings.identity[rows]).to(descriptors.device)
        is_comparable = torch.from_numpy(comparable(self._readings, rows)).to(descriptors.device)
        return contrastive_loss(descriptors, identity, is_comparable, self._temperature)

    def describe(self, values: Mapping[str, Tensor]) -> Tensor:
        described: Tensor = self._head(values["points"], values["group"])
        return described

    def write(self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]) -> ir.Value:
        return self._head.write(g, rows, features)


class _Paper:
    def __init__(self, kind: PaperKind, readings: Readings) -> None:
        trained = np.unique(readings.identity[~readings.held_out[readings.identity]])
        self._class_of = np.full(len(readings.held_out), -1)
        self._class_of[trained] = np.arange(len(trained))
        self._readings = readings
        self._head = PaperHead(kind)
        self._classifier = PaperClassifier(len(trained))
        self._both = nn.ModuleDict({"head": self._head, "classifier": self._classifier})

    @property
    def module(self) -> nn.Module:
        return self._both

    def loss(self, values: Mapping[str, Tensor], rows: NDArray[np.int64]) -> Tensor:
        probabilities = self._classifier(self._head(values["patch"], values["scale"], values["anchor"]))
        wanted = torch.from_numpy(self._class_of[self._readings.identity[rows]]).to(probabilities.device)
        labels = nn.functional.one_hot(wanted, probabilities.shape[-1]).to(probabilities.dtype)
        return paper_loss(probabilities, labels)

    def describe(self, values: Mapping[str, Tensor]) -> Tensor:
        raw: Tensor = self._head(values["patch"], values["scale"], values["anchor"])
        return nn.functional.normalize(raw, dim=1)

    def write(self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]) -> ir.Value:
        return self._head.write(g, rows, features)
