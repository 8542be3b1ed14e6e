"""Head kind ``paper``: the paper's own network (section 3.1, figures 2 and 3), computed only where an object is.

For each output grid two layers of that grid are joined, one near the output and one earlier. Three convolutions follow,
then the *target* layer: a new axis before the channels, repeated for the grid's anchors, and 128 three-dimensional
filters, so each anchor of each cell has a descriptor. The first convolution looks at 3 x 3 cells, all others at one, so
the 3 x 3 cells around a detection give exactly what the whole map would give there, at a small part of the cost.

The figures give shapes but no kernel sizes, widths or activations; ours are YOLOv3's habits: 3 x 3, then 1 x 1, batch
norm, leaky ReLU with slope 0.1; the target layer is linear. Its filters span three anchors, with zeros beyond the first
and the last: spanning one, they would give all anchors of a cell the same descriptor. (Of more than three anchors those
in the middle still get the same: all that the filters see there is equal.) The paper compares descriptors as they are;
in the model file they are of unit length, as those of every kind.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import onnx_ir as ir
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lookonce.errors import ModelError
from lookonce.make.descriptors.head import DESCRIPTOR_SIZE
from lookonce.make.export.detections import SelectedDetections
from lookonce.make.export.graph import GraphWriter
from lookonce.model.metadata import Feature, ModelMetadata

__all__ = ["PaperGrid", "PaperHead", "PaperKind"]

_SIDE = 3  # cells of the neighbourhood, and anchors under a filter of the target layer
_CELLS = _SIDE * _SIDE
_KERNELS = (_SIDE, 1, 1)
_WIDTHS = (256, 256, 128)
_SLOPE = 0.1  # of the leaky ReLU, YOLOv3's
_OUTSIDE = -1


@dataclass(frozen=True, slots=True)
class PaperGrid:
    """What the head reads on one output grid.

    Attributes:
        features: the layer near the output and the earlier one; one only, where they are the same.
        anchors: how many each cell has.
        rows: of cells.
        columns: of cells.
    """

    features: tuple[Feature, ...]
    anchors: int
    rows: int
    columns: int

    @property
    def channels(self) -> int:
        """Of the joined layers."""
        return sum(feature.channels for feature in self.features)


@dataclass(frozen=True, slots=True)
class PaperKind:
    """The kind ``paper`` for one detector.

    Attributes:
        grids: the output grids, in the detections' order.
    """

    grids: tuple[PaperGrid, ...]

    @classmethod
    def of(cls, metadata: ModelMetadata) -> PaperKind:
        """For each output grid its layer near the output and its early layer.

        Raises:
            ModelError: the description lacks one of them.
        """
        by_name = {feature.name: feature for feature in metadata.features}
        grids = []
        for grid in metadata.outputs:
            names = dict.fromkeys((grid.near, grid.early))
            features = tuple(by_name[name] for name in names if name in by_name)
            if len(features) != len(names) or any(feature.stride_px != grid.stride_px for feature in features):
                raise ModelError(
                    f"the model's description lacks a layer of the {grid.stride_px} px grid ({', '.join(names)}); "
                    "make the file again with 'lookonce import'"
                )
            rows, columns = (length // grid.stride_px for length in metadata.size)
            grids.append(PaperGrid(features, len(grid.anchors_px), rows, columns))
        return cls(tuple(grids))

    @property
    def name(self) -> str:
        """``paper``."""
        return "paper"

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the features that are read, each once."""
        return tuple(dict.fromkeys(feature.name for grid in self.grids for feature in grid.features))

    @property
    def channels(self) -> int:
        """C, those of the grid that has most."""
        return max(grid.channels for grid in self.grids)

    def write_reading(
        self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]
    ) -> dict[str, ir.Value]:
        """``patch (N, 9, C)``: the 3 x 3 cells around the detection's, row by row; ``scale`` and ``anchor (N,)`` int64.

        Channels are near, then early, then zeros up to C; cells outside the map are zeros.
        """
        blocks = [self._write_patch(g, rows, features, index) for index in range(len(self.grids))]
        patch = g("Sum", *blocks) if len(blocks) > 1 else blocks[0]  # a row is zeros in all blocks but its own
        return {"patch": patch, "scale": rows.scale, "anchor": rows.anchor}

    def _write_patch(
        self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value], index: int
    ) -> ir.Value:
        """The patches (N, 9, C) of the rows that one grid found; zeros for others."""
        grid = self.grids[index]
        cells = grid.rows * grid.columns
        cell = g("Min", rows.cell, g.constant(cells - 1))  # rows of finer grids: any valid address
        neighbour = g("Gather", g.constant(_neighbours(grid.rows, grid.columns)), cell)  # (N, 9)
        is_own = g("Unsqueeze", g("Equal", rows.scale, g.constant(index)), g.constant([1]))
        is_read = g("And", g("Greater", neighbour, g.constant(_OUTSIDE)), is_own)
        neighbour = g("Max", neighbour, g.constant(0))
        image = g("Unsqueeze", rows.image_index, g.constant([1]))
        parts = []
        for feature in grid.features:
            start = g("Add", g("Mul", image, g.constant(feature.channels * cells)), neighbour)
            channel = g.constant(np.arange(feature.channels, dtype=np.int64) * cells)
            address = g("Add", g("Unsqueeze", start, g.constant([2])), channel)  # (N, 9, channels)
            parts.append(g("Gather", g("Reshape", features[feature.name], g.constant([-1])), address))
        joined = g("Concat", *parts, axis=2) if len(parts) > 1 else parts[0]
        read = g("Where", g("Unsqueeze", is_read, g.constant([2])), joined, g.constant(0.0))
        if grid.channels == self.channels:
            return read
        return g("Pad", read, g.constant([0, 0, 0, 0, 0, self.channels - grid.channels]))


class PaperHead(nn.Module):
    """The network of kind ``paper``: raw descriptors at each row's own anchor, or of whole maps by the same weights.

    Args:
        kind: the layout.
    """

    def __init__(self, kind: PaperKind) -> None:
        super().__init__()
        self.kind = kind
        self.channels = kind.channels
        self.grids = nn.ModuleList(_GridLayers(grid) for grid in kind.grids)

    def forward(self, patch: Tensor, scale: Tensor, anchor: Tensor) -> Tensor:
        """(N, 9, C), (N,), (N,) -> (N, 128).

        In training, batch norm takes its statistics from these rows, not from all cells of a map: the rows are what
        it meets later.
        """
        descriptors = torch.zeros(len(patch), DESCRIPTOR_SIZE, device=patch.device)
        for index in range(len(self.grids)):
            own = (scale == index).nonzero()[:, 0]
            if len(own) == 0:
                continue
            layers = self._layers(index)
            cells = patch[own, :, : layers.channels].float().transpose(1, 2)  # (n, 9, C) -> (n, channels, 9)
            every = layers(cells.reshape(len(own), layers.channels, _SIDE, _SIDE), padding=0).flatten(2)
            at_anchor = every[torch.arange(len(own), device=own.device), :, anchor[own]]  # (n, 128, a) -> (n, 128)
            descriptors = descriptors.index_copy(0, own, at_anchor.float())
        return descriptors

    def forward_map(self, scale_index: int, near_map: Tensor, early_map: Tensor) -> Tensor:
        """Descriptors of every anchor of every cell of one grid, as the paper computes them.

        Args:
            scale_index: which grid.
            near_map: (B, channels, rows, columns) of the layer near the output.
            early_map: of the early one; not read where the two are one layer.

        Returns:
            (B, 128, anchors, rows, columns).
        """
        layers = self._layers(scale_index)
        joined = near_map if layers.reads_one_layer else torch.cat([near_map, early_map], dim=1)
        descriptors: Tensor = layers(joined, padding=_SIDE // 2)
        return descriptors

    def write(self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]) -> ir.Value:
        """Append the head to a graph: ``forward`` in evaluation, batch norm folded, each row scaled to unit length."""
        reading = self.kind.write_reading(g, rows, features)
        descriptors = self._layers(0).write(g, self.channels, reading)
        for index in range(1, len(self.grids)):
            is_own = g("Unsqueeze", g("Equal", rows.scale, g.constant(index)), g.constant([1]))
            descriptors = g("Where", is_own, self._layers(index).write(g, self.channels, reading), descriptors)
        return g.unit_length(descriptors)

    def _layers(self, index: int) -> _GridLayers:
        layers = self.grids[index]
        assert isinstance(layers, _GridLayers)
        return layers


class _GridLayers(nn.Module):
    """The layers added to one output grid."""

    def __init__(self, grid: PaperGrid) -> None:
        super().__init__()
        self.channels, self.anchors = grid.channels, grid.anchors
        self.reads_one_layer = len(grid.features) == 1
        sizes = list(zip((grid.channels, *_WIDTHS), _WIDTHS, _KERNELS, strict=False))
        self.convolutions = nn.ModuleList(nn.Conv2d(before, after, side, bias=False) for before, after, side in sizes)
        self.norms = nn.ModuleList(nn.BatchNorm2d(width) for width in _WIDTHS)
        self.target = nn.Conv3d(_WIDTHS[-1], DESCRIPTOR_SIZE, (_SIDE, 1, 1), padding=(_SIDE // 2, 0, 0))

    def forward(self, values: Tensor, padding: int) -> Tensor:
        """(B, C, h, w) -> (B, 128, anchors, h, w); with ``padding`` 0 the cells at the border are neighbours only."""
        for convolution, norm in self._pairs():
            around = padding if convolution.kernel_size[0] > 1 else 0
            values = nn.functional.conv2d(values, convolution.weight, padding=around)
            values = nn.functional.leaky_relu(_normalised(norm, values), _SLOPE)
        repeated = values.unsqueeze(2).expand(-1, -1, self.anchors, -1, -1)
        descriptors: Tensor = self.target(repeated)
        return descriptors

    def write(self, g: GraphWriter, channels: int, reading: Mapping[str, ir.Value]) -> ir.Value:
        """Descriptors (N, 128) of all rows, as if this grid had found them; ``channels``: those of the patches."""
        patch = reading["patch"]
        if self.channels < channels:
            patch = g("Slice", patch, g.constant([0]), g.constant([self.channels]), g.constant([2]))
        values = g("Reshape", patch, g.constant([0, _CELLS * self.channels]))
        for convolution, norm in self._pairs():
            matrix, bias = _folded(convolution, norm)
            values = g("Add", g("MatMul", values, g.constant(matrix)), g.constant(bias))
            values = g("LeakyRelu", values, alpha=_SLOPE)
        matrix, bias = self._target_of_each_anchor()
        every = g("Add", g("MatMul", values, g.constant(matrix)), g.constant(bias))
        every = g("Reshape", every, g.constant([0, self.anchors, DESCRIPTOR_SIZE]))
        anchor = g("Min", reading["anchor"], g.constant(self.anchors - 1))  # rows of other grids: any valid one
        return g("GatherND", every, g("Unsqueeze", anchor, g.constant([1])), batch_dims=1)

    def _target_of_each_anchor(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The target layer as a matrix (width, anchors x 128) and bias: all anchors hold the same values.

        So an anchor's matrix is the sum of those slices of the kernel that fall inside the anchor axis.
        """
        kernel = _float64(self.target.weight)[:, :, :, 0, 0]  # (128, width, 3)
        offsets = range(-(_SIDE // 2), _SIDE // 2 + 1)
        is_inside = [[0 <= anchor + offset < self.anchors for offset in offsets] for anchor in range(self.anchors)]
        matrix = np.einsum("dcs,as->cad", kernel, np.array(is_inside, np.float64))
        assert self.target.bias is not None
        bias = np.tile(_float64(self.target.bias), self.anchors)
        return matrix.reshape(len(matrix), -1).astype(np.float32), bias.astype(np.float32)

    def _pairs(self) -> list[tuple[nn.Conv2d, nn.BatchNorm2d]]:
        pairs = []
        for convolution, norm in zip(self.convolutions, self.norms, strict=True):
            assert isinstance(convolution, nn.Conv2d)
            assert isinstance(norm, nn.BatchNorm2d)
            pairs.append((convolution, norm))
        return pairs


def _normalised(norm: nn.BatchNorm2d, values: Tensor) -> Tensor:
    """Batch norm; a single value per channel has no spread, so it gets the running statistics in training too."""
    if values.numel() > values.shape[1]:
        normalised: Tensor = norm(values)
        return normalised
    return nn.functional.batch_norm(
        values, norm.running_mean, norm.running_var, norm.weight, norm.bias, training=False, eps=norm.eps
    )


def _folded(convolution: nn.Conv2d, norm: nn.BatchNorm2d) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A convolution and its batch norm as a matrix (cells x channels, width) for joined cells, and a bias."""
    assert norm.running_mean is not None
    assert norm.running_var is not None
    factor = _float64(norm.weight) / np.sqrt(_float64(norm.running_var) + norm.eps)
    kernel = _float64(convolution.weight).transpose(2, 3, 1, 0) * factor  # (rows, columns, channels, width)
    bias = _float64(norm.bias) - _float64(norm.running_mean) * factor
    return kernel.reshape(-1, kernel.shape[-1]).astype(np.float32), bias.astype(np.float32)


def _neighbours(rows: int, columns: int) -> NDArray[np.int64]:
    """For each cell of a grid (rows x columns, 9) the 3 x 3 cells around it, row by row; -1 outside the grid."""
    margin = _SIDE // 2
    padded = np.pad(np.arange(rows * columns).reshape(rows, columns), margin, constant_values=_OUTSIDE)
    around = np.lib.stride_tricks.sliding_window_view(padded, (_SIDE, _SIDE))
    return around.reshape(rows * columns, _CELLS).astype(np.int64)


def _float64(tensor: Tensor) -> NDArray[np.float64]:
    return tensor.detach().cpu().numpy().astype(np.float64)
