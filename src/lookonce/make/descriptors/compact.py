"""Head kind ``compact``: identity is read where the detector still sees colour, guided by what it knows later.

Over each box a grid of points is read (RoIAlign, He et al. 2017, section 3) from narrow backbone maps. At every point
the earliest map (stride 4), in which members of a class still differ, gives an embedding; all maps together, which know
object from background, give the weights of K attention heads. Each head averages the embeddings of the points that it
attends to, beginning as a horizontal stripe of the box; the joined averages are projected to a vector of unit length.
The descriptor belongs to the box, not to the grid or anchor that happened to find it, and survives a change of scale.

In the model file the later maps are brought to the width of the gate's hidden layer *before* they are read: both steps
are linear, so their order changes nothing but the cost. RoiAlign is what costs most, and it costs by the channel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
_POINTS = _ROWS * _COLUMNS
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
        read = self.write_points(g, rows, [features[name] for name in self.layers])
        joined = g("Concat", *read, axis=1) if len(read) > 1 else read[0]
        return {"points": g("Reshape", joined, g.constant([-1, _POINTS, sum(self.channels)]))}

    def write_points(self, g: GraphWriter, rows: SelectedDetections, maps: Sequence[ir.Value]) -> list[ir.Value]:
        """Each map (B, C, h, w) at a grid of points over each box, (N x 32, C).

        Args:
            g: the graph.
            rows: N detections.
            maps: for each feature a map of its height and width: itself or what was computed of it.
        """
        height, width = self.size
        limit = g.constant(np.array([width, height, width, height], np.float32))
        boxes = g("Max", g("Min", rows.boxes, limit), g.constant(0.0))
        points = []
        for feature, value in zip(self.features, maps, strict=True):
            read = g(  # (N, C, rows, columns)
                "RoiAlign",
                value,
                boxes,
                rows.image_index,
                output_height=_ROWS,
                output_width=_COLUMNS,
                sampling_ratio=_SAMPLES if feature is self.features[0] else 1,
                spatial_scale=1 / feature.stride_px,
                coordinate_transformation_mode="half_pixel",
                mode="avg",
            )
            # Flat: ONNX Runtime fuses a transposition into a product of 3-D values, and that fails for N = 0.
            points.append(g("Flatten", g("Transpose", read, perm=[0, 2, 3, 1]), axis=3))
        return points


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
        self.kind = kind
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

    def write(self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]) -> ir.Value:
        """Append the head to a graph: ``forward`` of the reading, with the standardisation folded into the weights."""
        first, last = self.gate[0], self.gate[2]
        assert isinstance(first, nn.Linear)
        assert isinstance(last, nn.Linear)
        first_weight, first_bias = self._folded(first)
        guides = first_weight.split_with_sizes(self.kind.channels, dim=1)  # (gate, channels) for each feature
        finest, *later = (features[name] for name in self.kind.layers)
        later = [
            g("Conv", value, g.constant(_array(weight[:, :, None, None])))
            for value, weight in zip(later, guides[1:], strict=True)
        ]
        points, *guided = self.kind.write_points(g, rows, [finest, *later])  # (N P, C), (N P, gate) ...
        hidden = g("Relu", g("Sum", _write_linear(g, points, guides[0], first_bias), *guided))
        logits = _write_linear(g, hidden, last.weight, last.bias)
        logits = g("Transpose", g("Reshape", logits, g.constant([-1, _POINTS, _HEADS])), perm=[0, 2, 1])
        weights = g("Softmax", g("Add", logits, g.constant(_array(self.position.T))), axis=2)  # (N, K, P)
        embedded = g("Relu", _write_linear(g, points, *self._folded(self.embedding)))
        mean = g("MatMul", weights, g("Reshape", embedded, g.constant([-1, _POINTS, _EMBEDDING])))
        pooled = g("Log", g("Add", mean, g.constant(1.0)))
        flat = g("Reshape", pooled, g.constant([-1, _EMBEDDING * _HEADS]))
        return g.unit_length(_write_linear(g, flat, self.project.weight, self.project.bias))

    def _folded(self, layer: nn.Linear) -> tuple[Tensor, Tensor]:
        """Weight and bias of a layer on standardised channels, as those of a layer on the channels themselves."""
        count = layer.in_features
        weight = layer.weight / self.spread[:count]
        return weight, layer.bias - weight @ self.mean[:count]


def _hidden(count: int) -> Tensor:
    """(count, P) bool: of half of the rows a patch of the points, in training only, as if something stood before it."""
    row = torch.arange(_POINTS) // _COLUMNS
    column = torch.arange(_POINTS) % _COLUMNS
    top, left = torch.randint(_ROWS, (count, 1)), torch.randint(_COLUMNS, (count, 1))
    is_in_rows = (row >= top) & (row < top + torch.randint(1, 4, (count, 1)))
    is_in_columns = (column >= left) & (column < left + torch.randint(1, 3, (count, 1)))
    is_full_width, is_any = torch.rand(count, 1) < 0.5, torch.rand(count, 1) < 0.5
    return is_in_rows & (is_full_width | is_in_columns) & is_any


def _stripes() -> Tensor:
    """Attention (P, K) before training: head k looks at the k-th horizontal stripe, the middle columns more."""
    row = torch.arange(_POINTS) // _COLUMNS
    column = torch.arange(_POINTS) % _COLUMNS - (_COLUMNS - 1) / 2
    centre = (torch.arange(_HEADS) + 0.5) * _ROWS / _HEADS - 0.5
    return -((row[:, None] - centre) ** 2) - 0.5 * (column[:, None] / 1.5) ** 2


def _write_linear(g: GraphWriter, values: ir.Value, weight: Tensor, bias: Tensor) -> ir.Value:
    return g("Add", g("MatMul", values, g.constant(_array(weight.T))), g.constant(_array(bias)))


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float32)
