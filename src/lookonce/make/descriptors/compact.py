"""Head kind ``compact``: identity is read where the detector still sees colour, guided by what it knows later.

Over each box a grid of points is read (RoIAlign, He et al. 2017, section 3) from narrow backbone maps. At every point
the earliest map (stride 4), in which members of a class still differ, gives an embedding; all maps together, which know
object from background, give the weights of K attention heads. Each head averages the embeddings of the points that it
attends to, beginning as a horizontal stripe of the box; the joined averages are projected to a vector of unit length.
The descriptor belongs to the box, not to the grid or anchor that happened to find it, and survives a change of scale.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import onnx_ir as ir
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lookonce.make.descriptors.head import DESCRIPTOR_SIZE
from lookonce.make.export.detections import SelectedDetections
from lookonce.make.export.graph import GraphWriter
from lookonce.model.metadata import Feature, ModelMetadata

__all__ = ["CompactHead", "CompactKind"]

_ROWS, _COLUMNS = 8, 4  # points over a box; taller than wide, for persons; vehicles lose nothing by it
_SAMPLES = 2  # of the finest map, per point and axis, averaged; the points lie closer than the cells of the others
_STRIDES_PX = (4, 8, 16)  # of the maps that are read
_EMBEDDING, _HEADS, _GATE = 48, 8, 24
_SMALLEST_SPREAD = 1e-3
_UNSEEN = -20.0  # logit of a point that is hidden: no weight, but no NaN where all are


@dataclass(frozen=True, slots=True)
class CompactKind:
    """The kind ``compact`` for one detector.

    Attributes:
        features: the maps that are read, finest first; the first gives the embedding.
        size: the network's input (height, width) in px.
    """

    features: tuple[Feature, ...]
    size: tuple[int, int]

    @classmethod
    def of(cls, metadata: ModelMetadata) -> CompactKind:
        """For each of the strides 4, 8 and 16 px the narrowest backbone map; the finest there are, where none is."""
        near = {grid.near for grid in metadata.outputs}
        backbone = [f for f in metadata.features if f.name not in near] or list(metadata.features)
        narrowest: dict[int, Feature] = {}
        for feature in sorted(backbone, key=lambda f: (f.stride_px, f.channels)):
            narrowest.setdefault(feature.stride_px, feature)
        chosen = [narrowest[stride] for stride in _STRIDES_PX if stride in narrowest]
        return cls(tuple(chosen or list(narrowest.values())[: len(_STRIDES_PX)]), metadata.size)

    @property
    def name(self) -> str:
        """``compact``."""
        return "compact"

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the features that are read."""
        return tuple(feature.name for feature in self.features)

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of each map."""
        return tuple(feature.channels for feature in self.features)

    def write_reading(
        self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]
    ) -> dict[str, ir.Value]:
        """``points (N, 32, C)``: the maps' channels, joined, at a grid of points over each box."""
        height, width = self.size
        limit = g.constant(np.array([width, height, width, height], np.float32))
        boxes = g("Max", g("Min", rows.boxes, limit), g.constant(0.0))
        read = [
            g(
                "RoiAlign",
                features[feature.name],
                boxes,
                rows.image_index,
                output_height=_ROWS,
                output_width=_COLUMNS,
                sampling_ratio=_SAMPLES if feature is self.features[0] else 1,
                spatial_scale=1 / feature.stride_px,
                coordinate_transformation_mode="half_pixel",
                mode="avg",
            )
            for feature in self.features
        ]
        joined = g("Concat", *read, axis=1) if len(read) > 1 else read[0]  # (N, C, rows, columns)
        flat = g("Reshape", joined, g.constant([0, sum(self.channels), _ROWS * _COLUMNS]))
        return {"points": g("Transpose", flat, perm=[0, 2, 1])}


class CompactHead(nn.Module):
    """The network of kind ``compact``: points (N, P, C) -> descriptors (N, 128) of unit length.

    Args:
        kind: the layout.
        mean: (C,) mean of each channel over the training set.
        spread: (C,) its standard deviation.
    """

    mean: Tensor
    spread: Tensor

    def __init__(self, kind: CompactKind, mean: NDArray[np.float32], spread: NDArray[np.float32]) -> None:
        super().__init__()
        self.visual = kind.channels[0]
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("spread", torch.from_numpy(np.maximum(spread, _SMALLEST_SPREAD)))
        self.embedding = nn.Linear(self.visual, _EMBEDDING)
        self.gate = nn.Sequential(nn.Linear(len(mean), _GATE), nn.ReLU(), nn.Linear(_GATE, _HEADS))
        self.position = nn.Parameter(_stripes())
        self.project = nn.Linear(_EMBEDDING * _HEADS, DESCRIPTOR_SIZE)

    def forward(self, points: Tensor) -> Tensor:
        """(N, P, C) -> (N, 128)."""
        points = (points.float() - self.mean) / self.spread
        embedded = torch.relu(self.embedding(points[..., : self.visual]))  # (N, P, E)
        logits = self.position + self.gate(points)  # (N, P, K)
        if self.training:
            logits = logits.masked_fill(_hidden(len(points)).to(logits.device)[..., None], _UNSEEN)
        weights = logits.softmax(dim=1)
        pooled = torch.log1p(weights.transpose(1, 2) @ embedded)  # (N, K, E); one bright spot does not decide
        return nn.functional.normalize(self.project(pooled.flatten(1)), dim=1)

    def write(self, g: GraphWriter, reading: Mapping[str, ir.Value]) -> ir.Value:
        """Append the head to a graph: the operators of ``forward`` with the standardisation folded into the weights."""
        # Flat: ONNX Runtime fuses the reading's transposition into a product of 3-D values, and that fails for N = 0.
        points = g("Reshape", reading["points"], g.constant([-1, len(self.mean)]))  # (N, P, C) -> (N P, C)
        channels = np.arange(self.visual, dtype=np.int64)
        visual = g("Gather", points, g.constant(channels), axis=1)
        embedded = g("Relu", self._linear(g, visual, self.embedding))
        embedded = g("Reshape", embedded, g.constant([-1, _ROWS * _COLUMNS, _EMBEDDING]))
        first, last = self.gate[0], self.gate[2]
        assert isinstance(first, nn.Linear)
        assert isinstance(last, nn.Linear)
        logits = _write_linear(g, g("Relu", self._linear(g, points, first)), last.weight, last.bias)
        logits = g("Reshape", logits, g.constant([-1, _ROWS * _COLUMNS, _HEADS]))
        weights = g("Softmax", g("Add", logits, g.constant(_array(self.position))), axis=1)
        mean = g("MatMul", g("Transpose", weights, perm=[0, 2, 1]), embedded)
        pooled = g("Log", g("Add", mean, g.constant(1.0)))
        flat = g("Reshape", pooled, g.constant([-1, _EMBEDDING * _HEADS]))
        return g.unit_length(_write_linear(g, flat, self.project.weight, self.project.bias))

    def _linear(self, g: GraphWriter, values: ir.Value, layer: nn.Linear) -> ir.Value:
        """A layer on standardised channels, as a layer on the channels themselves."""
        count = layer.in_features
        weight = layer.weight / self.spread[:count]
        return _write_linear(g, values, weight, layer.bias - weight @ self.mean[:count])


def _hidden(count: int) -> Tensor:
    """(count, P) bool: of half of the rows a patch of the points, in training only, as if something stood before it."""
    row = torch.arange(_ROWS * _COLUMNS) // _COLUMNS
    column = torch.arange(_ROWS * _COLUMNS) % _COLUMNS
    top, left = torch.randint(_ROWS, (count, 1)), torch.randint(_COLUMNS, (count, 1))
    is_in_rows = (row >= top) & (row < top + torch.randint(1, 4, (count, 1)))
    is_in_columns = (column >= left) & (column < left + torch.randint(1, 3, (count, 1)))
    is_full_width, is_any = torch.rand(count, 1) < 0.5, torch.rand(count, 1) < 0.5
    return is_in_rows & (is_full_width | is_in_columns) & is_any


def _stripes() -> Tensor:
    """Attention (P, K) before training: head k looks at the k-th horizontal stripe, the middle columns more."""
    row = torch.arange(_ROWS * _COLUMNS) // _COLUMNS
    column = torch.arange(_ROWS * _COLUMNS) % _COLUMNS - (_COLUMNS - 1) / 2
    centre = (torch.arange(_HEADS) + 0.5) * _ROWS / _HEADS - 0.5
    return -((row[:, None] - centre) ** 2) - 0.5 * (column[:, None] / 1.5) ** 2


def _write_linear(g: GraphWriter, values: ir.Value, weight: Tensor, bias: Tensor) -> ir.Value:
    return g("Add", g("MatMul", values, g.constant(_array(weight.T))), g.constant(_array(bias)))


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float32)
