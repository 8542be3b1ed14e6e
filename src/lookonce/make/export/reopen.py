"""Model files opened again: to read features, to describe given boxes, to carry other descriptors.

Nothing that leads to a detection is touched: descriptor heads are taken off and put on behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import onnx_ir as ir
from numpy.typing import NDArray
from onnx_ir.passes.common import RemoveUnusedNodesPass

from lookonce.errors import ModelError
from lookonce.make.export.detections import NAME_PREFIX, SelectedDetections
from lookonce.make.export.graph import GraphWriter
from lookonce.make.export.model_file import DESCRIPTORS, declare_descriptors, save_model
from lookonce.model import ModelMetadata, describe_model
from lookonce.model.session import open_session, run_session

__all__ = ["BoxDescriber", "FeatureReader", "replace_descriptors"]

HeadWriter = Callable[[GraphWriter, SelectedDetections, Mapping[str, ir.Value]], ir.Value]


class FeatureReader:
    """Runs a model file's detector for its features.

    Args:
        path: a model file.
        names: of the features to read, as its metadata offers them.
        provider: ``cpu`` or ``cuda``.
        threads: for one inference.

    Raises:
        ModelError: the file is damaged or does not offer a feature.
    """

    def __init__(self, path: Path, names: Sequence[str], *, provider: str = "cpu", threads: int = 1) -> None:
        self.path = path
        self.names = list(names)
        self.metadata, model = _open(path)
        values = _values(model)
        missing = [name for name in names if name not in values]
        if missing:
            raise ModelError(f"{path}: has no feature {missing[0]}; make it again with 'lookonce import'")
        model.graph.outputs[:] = [values[name] for name in names]
        self._session = open_session(path, provider, threads, _content(model))

    def __call__(self, canvases: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
        """The maps (B, channels, rows, columns), in the order of ``names``, of pictures (B, H, W, 3) uint8 RGB."""
        return run_session(self.path, self._session, {"images": canvases}, self.names)


class BoxDescriber:
    """Describes boxes that somebody else found, with the descriptors of a model file.

    Args:
        path: a model file with descriptors.
        provider: ``cpu`` or ``cuda``.
        threads: for one inference.

    Raises:
        ModelError: the file is damaged or has no descriptors.
    """

    def __init__(self, path: Path, *, provider: str = "cpu", threads: int = 1) -> None:
        self.path = path
        self.metadata, model = _open(path)
        values = _values(model)
        found = {field.name: values[f"{NAME_PREFIX}{field.name}"] for field in fields(SelectedDetections)}
        outputs = [value for value in model.graph.outputs if value.name == DESCRIPTORS]
        if not outputs:
            raise ModelError(f"{path}: has no descriptors; train some with 'lookonce fit'")
        model.graph.outputs[:] = outputs
        given = {name: ir.Value(name=f"given_{name}", type=v.type, shape=v.shape) for name, v in found.items()}
        for name, value in found.items():
            ir.convenience.replace_all_uses_with(value, given[name])
        RemoveUnusedNodesPass()(model)
        self._inputs = [name for name, value in given.items() if value.uses()]
        model.graph.inputs[:] = [model.graph.inputs[0], *(given[name] for name in self._inputs)]
        self._session = open_session(path, provider, threads, _content(model))

    def __call__(self, canvases: NDArray[np.uint8], rows: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
        """Descriptors (N, D) of unit length.

        Args:
            canvases: pictures (B, H, W, 3) uint8 RGB of the network's size.
            rows: N values for each field of ``SelectedDetections`` (scores and labels may be left out).
        """
        feed = {"images": canvases} | {f"given_{name}": rows[name] for name in self._inputs}
        return run_session(self.path, self._session, feed, [DESCRIPTORS])[0]


def replace_descriptors(path: Path, write_head: HeadWriter, metadata: ModelMetadata, output: Path) -> None:
    """Write a copy of a model file whose descriptors come from another head.

    Args:
        path: a model file, with or without descriptors.
        write_head: appends the head to the graph; gets the detections and the features by name; gives (N, D).
        metadata: what the new file says about itself.
        output: the new file; may be the same.

    Raises:
        ModelError: the file is damaged.
        OutputError: the new one cannot be written.
    """
    assert metadata.descriptor is not None
    _, model = _open(path)
    graph = model.graph
    values = _values(model)
    kept = {field.name: values[f"{NAME_PREFIX}{field.name}"] for field in fields(SelectedDetections)}
    features = {feature.name: values[feature.name] for feature in metadata.features}
    outputs = [value for value in graph.outputs if value.name != DESCRIPTORS]
    graph.outputs[:] = [*outputs, *kept.values(), *features.values()]  # keep them, whoever read them so far
    RemoveUnusedNodesPass()(model)
    graph.outputs[:] = outputs
    g = GraphWriter(graph)
    declare_descriptors(g, write_head(g, SelectedDetections(**kept), features), metadata.descriptor.size)
    save_model(model, metadata, output)


def _open(path: Path) -> tuple[ModelMetadata, ir.Model]:
    metadata = describe_model(path)  # refuses what is unsafe
    try:
        return metadata, ir.load(path)
    except Exception as exc:
        raise ModelError(f"{path}: not an ONNX file, or damaged; make it again with 'lookonce import'") from exc


def _values(model: ir.Model) -> dict[str, ir.Value]:
    """The tensors of the graph by name, those of detections included.

    Raises:
        ModelError: it lacks one that the format promises.
    """
    values = {str(value.name): value for node in model.graph for value in node.outputs}
    for field in fields(SelectedDetections):
        if f"{NAME_PREFIX}{field.name}" not in values:
            raise ModelError(f"the model file does not name {NAME_PREFIX}{field.name}; make it again")
    return values


def _content(model: ir.Model) -> bytes:
    content: bytes = ir.to_proto(model).SerializeToString()
    return content
