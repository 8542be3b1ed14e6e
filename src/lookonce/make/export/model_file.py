"""A traced network plus decoding plus descriptors plus metadata: a model file."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import onnx_ir as ir

from lookonce.errors import OutputError
from lookonce.make.export.detections import SelectedDetections
from lookonce.make.export.graph import GraphWriter
from lookonce.model.metadata import METADATA_KEY, ModelMetadata

__all__ = ["DESCRIPTORS", "declare_descriptors", "declare_detections", "save_model"]

DESCRIPTORS = "descriptors"


def declare_detections(g: GraphWriter, detections: SelectedDetections) -> None:
    """Declare the outputs of every model file."""
    real, whole = ir.DataType.FLOAT, ir.DataType.INT64
    g.output("image_index", detections.image_index, whole, ["detections"], "which image of the batch")
    g.output("boxes", detections.boxes, real, ["detections", 4], "left, top, right, bottom in px of the input")
    g.output("scores", detections.scores, real, ["detections"], "confidence in [0, 1]")
    g.output("labels", detections.labels, whole, ["detections"], "index into the class names")


def declare_descriptors(g: GraphWriter, descriptors: ir.Value, size: int) -> None:
    """Declare the descriptors (N, size) as an output."""
    g.output(DESCRIPTORS, descriptors, ir.DataType.FLOAT, ["detections", size], "unit length; near for one object")


def save_model(model: ir.Model, metadata: ModelMetadata, path: Path) -> None:
    """Write the model file in one step: an interrupted run leaves no half file.

    Raises:
        OutputError: the file cannot be written.
    """
    model.metadata_props.clear()
    model.metadata_props[METADATA_KEY] = metadata.to_json()
    model.producer_name, model.producer_version = "lookonce", metadata.made_by
    model.graph.name = "lookonce"
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        ir.save(model, unfinished)
        os.replace(unfinished, path)
    except OSError as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(
            f"{path}: cannot write the model file ({exc.strerror}); choose another place with -o"
        ) from exc
