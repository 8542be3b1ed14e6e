"""Descriptors of kind ``native``: the detector's own features at the detection's own cell, without any training.

Of the grid that found the object, the layer near the output and the early layer are each scaled to unit length, joined,
and scaled again. Features of different grids come from different layers and cannot be compared: every grid has columns
of its own in the descriptor, so two detections of different grids are sqrt(2) apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import onnx_ir as ir

from lookonce.make.export.detections import SelectedDetections
from lookonce.make.export.graph import GraphWriter

__all__ = ["FeatureMap", "write_native_descriptors"]


class FeatureMap:
    """A tensor of the graph to read features from: (B, channels, cells) when its grid is flattened."""

    def __init__(self, value: ir.Value, channels: int, cells: int) -> None:
        self.value = value
        self.channels = channels
        self.cells = cells


def write_native_descriptors(
    g: GraphWriter, detections: SelectedDetections, scales: Sequence[tuple[FeatureMap, FeatureMap]]
) -> ir.Value:
    """Append the lookup of features for each detection.

    Args:
        g: the graph.
        detections: N rows.
        scales: for each output grid, in the detections' order, the near and the early layer.

    Returns:
        (N, D) float32, D = all channels together.
    """
    blocks = []
    for index, layers in enumerate(scales):
        is_own = g("Unsqueeze", g("Equal", detections.scale, g.constant(index)), g.constant([1]))  # (N, 1)
        cell = g("Min", detections.cell, g.constant(layers[0].cells - 1))  # rows of finer grids: any valid address
        joined = g(
            "Concat", *(g.unit_length(_read(g, layer, detections.image_index, cell)) for layer in layers), axis=1
        )
        blocks.append(g("Where", is_own, g.unit_length(joined), g.constant(0.0)))
    return g("Concat", *blocks, axis=1) if len(blocks) > 1 else blocks[0]


def _read(g: GraphWriter, layer: FeatureMap, image_index: ir.Value, cell: ir.Value) -> ir.Value:
    """The features at one cell for each detection, (N, channels), looked up by address in the flat map."""
    flat = g("Reshape", layer.value, g.constant([-1]))
    start = g("Add", g("Mul", image_index, g.constant(layer.channels * layer.cells)), cell)
    channel = g.constant(np.arange(layer.channels, dtype=np.int64) * layer.cells)
    return g("Gather", flat, g("Add", g("Unsqueeze", start, g.constant([1])), channel))
