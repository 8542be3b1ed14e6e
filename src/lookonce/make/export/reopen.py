"""Model files opened again: to read at given boxes, and to carry other descriptors.

Nothing that leads to a detection is touched: descriptor heads are taken off and put on behind it. A given box of
which nobody says what it is has the class that the detector sees there.
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
from lookonce.make.export.detections import BEFORE_CLASSES, NAME_PREFIX, SelectedDetections
from lookonce.make.export.graph import GraphWriter
from lookonce.make.export.model_file import DESCRIPTORS, declare_descriptors, save_model
from lookonce.model import ModelMetadata, describe_model
from lookonce.model.session import open_session, run_session

__all__ = ["HeadWriter", "ReadingWriter", "RowReader", "open_describer", "replace_descriptors"]

Rows = Mapping[str, NDArray[Any]]
HeadWriter = Callable[[GraphWriter, SelectedDetections, Mapping[str, ir.Value]], ir.Value]
ReadingWriter = Callable[[GraphWriter, SelectedDetections, Mapping[str, ir.Value]], Mapping[str, ir.Value]]


class RowReader:
    """Reads a model file's graph at boxes that somebody else found.

    Args:
        path: a model file.
        write: appends operators to the graph and names what is to be read; gets the rows of the detections, here
            given from outside, and the features by name.
        provider: ``cpu`` or ``cuda``.
        threads: for one inference.

    Raises:
        ModelError: the file is damaged or lacks what it promises.
    """

    def __init__(self, path: Path, write: ReadingWriter, *, provider: str = "cpu", threads: int = 1) -> None:
        self.path = path
        self.metadata, model = _open(path)
        rows, features = _rows(path, model), _features(path, model, self.metadata)
        given = {name: _given(name) for name in rows}
        g = GraphWriter(model.graph)
        is_unknown = g("Less", given["labels"], g.constant(0))
        seen = _write_seen_labels(g, self.metadata, given, _raw_maps(path, self.metadata, features))
        used = given | {"labels": g("Where", is_unknown, seen, given["labels"])}
        for name, row in rows.items():
            ir.convenience.replace_all_uses_with(row, used[name])
        read = write(g, SelectedDetections(**used), features)
        outputs = {name: g("Identity", value) for name, value in read.items()}  # it may be a given row, or read twice
        self._outputs = {name: str(value.name) for name, value in outputs.items()}
        model.graph.outputs[:] = list(outputs.values())
        model.graph.sort()  # the labels of given rows stand behind what the file itself reads by them
        RemoveUnusedNodesPass()(model)
        self._inputs = [name for name, value in given.items() if value.uses()]
        model.graph.inputs[:] = [model.graph.inputs[0], *(given[name] for name in self._inputs)]
        self._session = open_session(path, provider, threads, ir.to_proto(model).SerializeToString())

    def __call__(self, canvases: NDArray[np.uint8], rows: Rows) -> dict[str, NDArray[Any]]:
        """What is read, by name, N rows each.

        Args:
            canvases: pictures (B, H, W, 3) uint8 RGB of the network's size.
            rows: N values for each field of ``SelectedDetections`` that is read; a label may be ``UNKNOWN_CLASS``.
        """
        feed = {"images": canvases} | {f"given_{name}": rows[name] for name in self._inputs}
        values = run_session(self.path, self._session, feed, list(self._outputs.values()))
        return dict(zip(self._outputs, values, strict=True))


def open_describer(path: Path, *, provider: str = "cpu", threads: int = 1) -> RowReader:
    """A reader of the model file's own ``descriptors`` (N, D) float32 at given boxes.

    Raises:
        ModelError: the file is damaged or has no descriptors.
    """
    metadata, model = _open(path)
    outputs = [value for value in model.graph.outputs if value.name == DESCRIPTORS]
    if not outputs or metadata.descriptor is None:
        raise ModelError(f"{path}: has no descriptors; train some with 'lookonce fit'")

    def write(g: GraphWriter, _: SelectedDetections, __: Mapping[str, ir.Value]) -> Mapping[str, ir.Value]:
        return {DESCRIPTORS: next(value for value in g.graph.outputs if value.name == DESCRIPTORS)}

    return RowReader(path, write, provider=provider, threads=threads)


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
    described, model = _open(path)
    graph = model.graph
    rows, features = _rows(path, model), _features(path, model, described)
    outputs = [value for value in graph.outputs if value.name != DESCRIPTORS]
    graph.outputs[:] = [*outputs, *rows.values(), *features.values()]  # keep them, whoever read them so far
    RemoveUnusedNodesPass()(model)
    graph.outputs[:] = outputs
    g = GraphWriter(graph)
    declare_descriptors(g, write_head(g, SelectedDetections(**rows), features), metadata.descriptor.size)
    save_model(model, metadata, output)


def _open(path: Path) -> tuple[ModelMetadata, ir.Model]:
    metadata = describe_model(path)  # refuses what is unsafe
    try:
        model = ir.load(path)
    except Exception as exc:
        raise ModelError(f"{path}: not an ONNX file, or damaged; make it again with 'lookonce import'") from exc
    if not model.graph.inputs or model.graph.inputs[0].name != "images":
        raise ModelError(f"{path}: its first input is not 'images'; make it again with 'lookonce import'")
    return metadata, model


def _given(field: str) -> ir.Value:
    """An input in place of one field of ``SelectedDetections``."""
    dtype = ir.DataType.FLOAT if field in ("boxes", "scores") else ir.DataType.INT64
    shape = ir.Shape(["rows", 4] if field == "boxes" else ["rows"])
    return ir.Value(name=f"given_{field}", type=ir.TensorType(dtype), shape=shape)


def _values(model: ir.Model) -> dict[str, ir.Value]:
    return {str(value.name): value for node in model.graph for value in node.outputs}


def _rows(path: Path, model: ir.Model) -> dict[str, ir.Value]:
    """The tensors of the detections, by field of ``SelectedDetections``."""
    values = _values(model)
    names = {field.name: f"{NAME_PREFIX}{field.name}" for field in fields(SelectedDetections)}
    missing = [name for name in names.values() if name not in values]
    if missing:
        raise ModelError(f"{path}: does not name {missing[0]}; make it again with 'lookonce import'")
    return {field: values[name] for field, name in names.items()}


def _features(path: Path, model: ir.Model, metadata: ModelMetadata) -> dict[str, ir.Value]:
    values = _values(model)
    missing = [feature.name for feature in metadata.features if feature.name not in values]
    if missing or not metadata.features:
        name = f"lacks the feature {missing[0]}" if missing else "names no features that descriptors could read"
        raise ModelError(f"{path}: {name}; make it again with 'lookonce import'")
    return {feature.name: values[feature.name] for feature in metadata.features}


def _raw_maps(path: Path, metadata: ModelMetadata, features: Mapping[str, ir.Value]) -> list[ir.Value]:
    """Of each output grid the map (B, anchors x (5 + classes), rows, columns) that the detector decodes."""
    maps = []
    for grid in metadata.outputs:
        channels = len(grid.anchors_px) * (BEFORE_CLASSES + len(metadata.names))
        near = features.get(grid.near)
        readers = [] if near is None else [node for node, _ in near.uses() if node.op_type == "Conv"]
        found = [node.outputs[0] for node in readers if _has_filters(node, channels)]
        if len(found) != 1:
            raise ModelError(
                f"{path}: cannot tell which map the {grid.stride_px} px grid is decoded from; make it again with "
                "'lookonce import'"
            )
        maps += found
    return maps


def _has_filters(convolution: ir.Node, count: int) -> bool:
    weight = convolution.inputs[1]
    return weight is not None and weight.const_value is not None and weight.const_value.shape[0] == count


def _write_seen_labels(
    g: GraphWriter, metadata: ModelMetadata, rows: Mapping[str, ir.Value], raw_maps: Sequence[ir.Value]
) -> ir.Value:
    """(N,) int64: the class that is most probable at each row's own anchor."""
    labels = g.constant(0)
    height, width = metadata.size
    classes = np.arange(len(metadata.names), dtype=np.int64)
    for index, (grid, raw) in enumerate(zip(metadata.outputs, raw_maps, strict=True)):
        cells = (height // grid.stride_px) * (width // grid.stride_px)
        attributes = BEFORE_CLASSES + len(classes)
        anchor = g("Min", rows["anchor"], g.constant(len(grid.anchors_px) - 1))  # rows of other grids: any valid one
        cell = g("Min", rows["cell"], g.constant(cells - 1))
        image = g("Mul", rows["image_index"], g.constant(len(grid.anchors_px) * attributes * cells))
        first = g("Add", g("Add", image, g("Mul", anchor, g.constant(attributes * cells))), cell)
        addresses = g("Add", g("Unsqueeze", first, g.constant([1])), g.constant((BEFORE_CLASSES + classes) * cells))
        scores = g("Gather", g("Reshape", raw, g.constant([-1])), addresses)  # (N, classes)
        is_own = g("Equal", rows["scale"], g.constant(index))
        labels = g("Where", is_own, g("ArgMax", scores, axis=1, keepdims=0), labels)
    return labels
