"""A Darknet network as typed, checked values: what each layer is and the shape of its output."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "AvgPool",
    "Convolutional",
    "DarknetConfig",
    "Dropout",
    "Layer",
    "LayerSpec",
    "MaxPool",
    "Region",
    "Reorg",
    "Route",
    "ScaleChannels",
    "Shortcut",
    "Upsample",
    "Yolo",
]


@dataclass(frozen=True, slots=True)
class Convolutional:
    """Convolution, then batch norm (or bias), then activation."""

    filters: int
    size: int
    stride: int
    padding: int
    groups: int
    batch_normalize: bool
    activation: str


@dataclass(frozen=True, slots=True)
class MaxPool:
    """Maximum; Darknet pads with minus infinity, ``padding`` in all, the smaller half first."""

    size: int
    stride: int
    padding: int


@dataclass(frozen=True, slots=True)
class AvgPool:
    """Mean over the whole grid."""


@dataclass(frozen=True, slots=True)
class Route:
    """Concatenation of earlier layers' channels, or of one group of each."""

    layers: tuple[int, ...]
    groups: int
    group_id: int


@dataclass(frozen=True, slots=True)
class Shortcut:
    """Sum with an earlier layer, then activation."""

    source: int
    activation: str


@dataclass(frozen=True, slots=True)
class ScaleChannels:
    """An earlier layer, each channel multiplied by this layer's one value for it, then activation."""

    source: int
    activation: str


@dataclass(frozen=True, slots=True)
class Upsample:
    """Nearest-neighbour enlargement."""

    stride: int


@dataclass(frozen=True, slots=True)
class Reorg:
    """YOLOv2's rearrangement of space into channels, in Darknet's own order."""

    stride: int


@dataclass(frozen=True, slots=True)
class Dropout:
    """Nothing at run time."""


@dataclass(frozen=True, slots=True)
class Region:
    """YOLOv2's output: anchors in grid cells, softmax over the classes."""

    classes: int
    anchors: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Yolo:
    """YOLOv3's and v4's output: anchors in px of the input, (width, height), already chosen by the mask."""

    classes: int
    anchors: tuple[tuple[float, float], ...]
    scale_x_y: float
    new_coords: bool


LayerSpec = (
    Convolutional | MaxPool | AvgPool | Route | Shortcut | ScaleChannels | Upsample | Reorg | Dropout | Region | Yolo
)


@dataclass(frozen=True, slots=True)
class Layer:
    """A layer with the shape of its output at the network's size, (channels, height, width)."""

    index: int
    spec: LayerSpec
    channels: int
    height: int
    width: int
    line: int


@dataclass(frozen=True, slots=True)
class DarknetConfig:
    """A whole network.

    Attributes:
        path: the cfg file.
        size: input (height, width) in px.
        layers: in file order; ``layers[i].index == i``.
    """

    path: str
    size: tuple[int, int]
    layers: tuple[Layer, ...]

    @property
    def outputs(self) -> tuple[Layer, ...]:
        """The [yolo] or [region] layers."""
        return tuple(layer for layer in self.layers if isinstance(layer.spec, Yolo | Region))

    @property
    def classes(self) -> int:
        """Number of object classes."""
        return self.output_spec(self.outputs[0]).classes

    @property
    def largest_stride(self) -> int:
        """Input px for one cell of the coarsest output grid; the input size must be a multiple of it."""
        return max(self.stride(layer) for layer in self.outputs)

    @staticmethod
    def output_spec(layer: Layer) -> Yolo | Region:
        """What an output layer is."""
        assert isinstance(layer.spec, Yolo | Region)
        return layer.spec

    def input_channels(self, layer: Layer) -> int:
        """Channels that enter ``layer`` from the layer before it (3 for the first)."""
        return self.layers[layer.index - 1].channels if layer.index else 3

    def stride(self, layer: Layer) -> int:
        """Input px for one cell of that layer."""
        return self.size[0] // layer.height

    @property
    def parameter_count(self) -> int:
        """How many float32 numbers a weights file for this network holds."""
        total = 0
        for layer in self.layers:
            if isinstance(spec := layer.spec, Convolutional):
                total += spec.filters * (4 if spec.batch_normalize else 1)
                total += spec.filters * (self.input_channels(layer) // spec.groups) * spec.size**2
        return total
