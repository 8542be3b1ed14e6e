"""Head kind ``compact``: identity is read where the detector still sees colour, guided by what it knows later.

Over each box a grid of points is read (RoIAlign, He et al. 2017, section 3) from narrow backbone maps. At every point
the earliest map (stride 4), in which members of a class still differ, gives an embedding; all maps together, which know
object from background, give the weights of K attention heads. Each head averages the embeddings of the points that it
attends to, beginning as a horizontal stripe of the box; the joined averages are projected to a vector of unit length.
The descriptor belongs to the box, not to the grid or anchor that happened to find it, and survives a change of scale.

What tells people apart does not tell vehicles apart. Where the detector knows people and other things, people (and who
rides a two-wheeler) have a network of their own; each row is read by one of the two, chosen by its class.

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

from lookonce.make.descriptors.anchors import PEOPLE_CLASSES, TWO_WHEELER_CLASSES
from lookonce.make.descriptors.head import DESCRIPTOR_SIZE
from lookonce.make.export.detections import SelectedDetections
from lookonce.make.export.graph import GraphWriter
from lookonce.model.metadata import Feature, ModelMetadata

__all__ = ["CompactHead", "CompactKind"]

_ROWS, _COLUMNS = 8, 4  # points over a box; taller than wide, for persons; vehicles lose nothing by it
_POINTS = _ROWS * _COLUMNS
_SAMPLES = 2  # of the finest map, per point and axis, averaged; the points lie closer than the cells of the others
_STRIDES_PX = (4, 8, 16)  # of the maps that are read
_HEADS = 8
_SMALLEST_SPREAD = 1e-3
_UNSEEN = -20.0  # logit of a point that is hidden: no weight, but no NaN where all are


@dataclass(frozen=True, slots=True)
class CompactKind:
    """The kind ``compact`` for one detector.

    Attributes:
        features: the maps that are read, finest first; the first gives the embedding.
        size: the network's input (height, width) in px.
        groups: by label, which network reads the class: 1 people and who rides a two-wheeler, 0 all else; all 0 for
            a detector that knows no people, or nothing else.
    """

    features: tuple[Feature, ...]
    size: tuple[int, int]
    groups: tuple[int, ...]

    @classmethod
    def of(cls, metadata: ModelMetadata) -> CompactKind:
        """For each of the strides 4, 8 and 16 px the narrowest backbone map; the finest there are, where none is."""
        near = {grid.near for grid in metadata.outputs}
        backbone = [f for f in metadata.features if f.name not in near] or list(metadata.features)
        narrowest: dict[int, Feature] = {}
        for feature in sorted(backbone, key=lambda f: (f.stride_px, f.channels)):
            narrowest.setdefault(feature.stride_px, feature)
        chosen = [narrowest[stride] for stride in _STRIDES_PX if stride in narrowest]
        features = tuple(chosen or list(narrowest.values())[: len(_STRIDES_PX)])
        return cls(features, metadata.size, _groups([name.lower() for name in metadata.names]))

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
        """What training sees of N rows.

        ``points (N, 32, C)``: the maps' channels, joined, at a grid of points over each box; ``group (N,)`` int64:
        which network reads the row.
        """
        read = self.write_points(g, self.write_inside(g, rows), rows.image_index, [features[n] for n in self.layers])
        joined = g("Concat", *read, axis=1) if len(read) > 1 else read[0]
        points = g("Reshape", joined, g.constant([-1, _POINTS, sum(self.channels)]))
        return {"points": points, "group": self.write_group(g, rows)}

    def write_group(self, g: GraphWriter, rows: SelectedDetections) -> ir.Value:
        """(N,) int64: which network reads each row."""
        return g("Gather", g.constant(self.groups), rows.labels)

    def write_inside(self, g: GraphWriter, rows: SelectedDetections) -> ir.Value:
        """Boxes (N, 4), cut at the border of the picture."""
        height, width = self.size
        limit = g.constant(np.array([width, height, width, height], np.float32))
        return g("Max", g("Min", rows.boxes, limit), g.constant(0.0))

    def write_points(
        self, g: GraphWriter, boxes: ir.Value, image_index: ir.Value, maps: Sequence[ir.Value]
    ) -> list[ir.Value]:
        """Each map (B, C, h, w) at a grid of points over each box, (N x 32, C).

        Args:
            g: the graph.
            boxes: (N, 4) xyxy in px of the input, inside of it.
            image_index: (N,) which picture of the batch.
            maps: for each feature a map of its height and width: itself or what was computed of it.
        """
        points = []
        for feature, value in zip(self.features, maps, strict=True):
            read = g(  # (N, C, rows, columns)
                "RoiAlign",
                value,
                boxes,
                image_index,
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


def _groups(names: Sequence[str]) -> tuple[int, ...]:
    people = [name in PEOPLE_CLASSES for name in names]
    groups = [int(name in PEOPLE_CLASSES or name in TWO_WHEELER_CLASSES) for name in names]
    return tuple(groups if any(people) and not all(groups) else [0] * len(groups))


class CompactHead(nn.Module):
    """The network of kind ``compact``, or both: points (N, P, C) -> descriptors (N, 128) of unit length.

    Args:
        kind: the layout.
        mean: (C,) mean of each channel over the training set.
        spread: (C,) its standard deviation.
        embedding: numbers that are made of each point.
        gate: width of the hidden layer that decides which points count.
    """

    mean: Tensor
    spread: Tensor

    def __init__(
        self, kind: CompactKind, mean: NDArray[np.float32], spread: NDArray[np.float32], embedding: int, gate: int
    ) -> None:
        super().__init__()
        self.kind = kind
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("spread", torch.from_numpy(np.maximum(spread, _SMALLEST_SPREAD)))
        self.networks = nn.ModuleList(_Network(kind, embedding, gate) for _ in range(1 + max(kind.groups)))

    def forward(self, points: Tensor, group: Tensor) -> Tensor:
        """(N, P, C) and (N,), the number of each row's network -> (N, 128)."""
        descriptors = torch.zeros(len(points), DESCRIPTOR_SIZE, device=points.device)
        for number in range(len(self.networks)):
            own = (group == number).nonzero()[:, 0]
            descriptors = descriptors.index_copy(0, own, self.describe_by(number, points[own]))
        return descriptors

    def describe_by(self, number: int, points: Tensor) -> Tensor:
        """(N, P, C) -> (N, 128) by one network, whatever the rows' classes."""
        described: Tensor = self.networks[number]((points.float() - self.mean) / self.spread)
        return described

    def write(self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]) -> ir.Value:
        """Append the head to a graph: ``forward`` of the reading, with the standardisation folded into the weights."""
        maps = [features[name] for name in self.kind.layers]
        boxes, images = self.kind.write_inside(g, rows), rows.image_index
        networks = [network for network in self.networks if isinstance(network, _Network)]
        if len(networks) == 1:
            return networks[0].write(g, boxes, images, maps, self.mean, self.spread)
        group, parts, places = self.kind.write_group(g, rows), [], []
        for number, network in enumerate(networks):
            own = g("Squeeze", g("NonZero", g("Equal", group, g.constant(number))), g.constant([0]))
            some = g("Gather", boxes, own), g("Gather", images, own)
            parts.append(network.write(g, *some, maps, self.mean, self.spread))
            places.append(own)
        _, back = g.many("TopK", 2, g("Concat", *places, axis=0), g.size(group, 0), axis=0, largest=0)
        return g("Gather", g("Concat", *parts, axis=0), back)


class _Network(nn.Module):
    """Standardised points (N, P, C) -> descriptors (N, 128) of unit length."""

    def __init__(self, kind: CompactKind, embedding: int, gate: int) -> None:
        super().__init__()
        self.kind = kind
        self.visual = kind.channels[0]
        self.embedding = nn.Linear(self.visual, embedding)
        self.gate = nn.Sequential(nn.Linear(sum(kind.channels), gate), nn.ReLU(), nn.Linear(gate, _HEADS))
        self.position = nn.Parameter(_stripes())
        self.project = nn.Linear(embedding * _HEADS, DESCRIPTOR_SIZE)

    def forward(self, points: Tensor) -> Tensor:
        """(N, P, C) -> (N, 128)."""
        embedded = torch.relu(self.embedding(points[..., : self.visual]))  # (N, P, E)
        logits = self.position + self.gate(points)  # (N, P, K)
        if self.training:
            logits = logits.masked_fill(_hidden(len(points)).to(logits.device)[..., None], _UNSEEN)
        weights = logits.softmax(dim=1)
        pooled = torch.log1p(weights.transpose(1, 2) @ embedded)  # (N, K, E); one bright spot does not decide
        return nn.functional.normalize(self.project(pooled.flatten(1)), dim=1)

    def write(
        self,
        g: GraphWriter,
        boxes: ir.Value,
        image_index: ir.Value,
        maps: Sequence[ir.Value],
        mean: Tensor,
        spread: Tensor,
    ) -> ir.Value:
        """Append the network to a graph, reading and standardisation included: descriptors (N, 128) of the boxes."""
        first, last = self.gate[0], self.gate[2]
        assert isinstance(first, nn.Linear)
        assert isinstance(last, nn.Linear)
        first_weight, first_bias = _folded(first, mean, spread)
        guides = first_weight.split_with_sizes(self.kind.channels, dim=1)  # (gate, channels) for each feature
        later = [
            g("Conv", value, g.constant(_array(weight[:, :, None, None])))
            for value, weight in zip(maps[1:], guides[1:], strict=True)
        ]
        points, *guided = self.kind.write_points(g, boxes, image_index, [maps[0], *later])  # (N P, C), (N P, gate) ...
        hidden = g("Relu", g("Sum", _write_linear(g, points, guides[0], first_bias), *guided))
        logits = _write_linear(g, hidden, last.weight, last.bias)
        logits = g("Transpose", g("Reshape", logits, g.constant([-1, _POINTS, _HEADS])), perm=[0, 2, 1])
        weights = g("Softmax", g("Add", logits, g.constant(_array(self.position.T))), axis=2)  # (N, K, P)
        embedded = g("Relu", _write_linear(g, points, *_folded(self.embedding, mean, spread)))
        average = g("MatMul", weights, g("Reshape", embedded, g.constant([-1, _POINTS, self.embedding.out_features])))
        pooled = g("Log", g("Add", average, g.constant(1.0)))
        flat = g("Reshape", pooled, g.constant([-1, self.project.in_features]))
        return g.unit_length(_write_linear(g, flat, self.project.weight, self.project.bias))


def _folded(layer: nn.Linear, mean: Tensor, spread: Tensor) -> tuple[Tensor, Tensor]:
    """Weight and bias of a layer on standardised channels, as those of a layer on the channels themselves."""
    count = layer.in_features
    weight = layer.weight / spread[:count]
    return weight, layer.bias - weight @ mean[:count]


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
