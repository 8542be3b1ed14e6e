"""Which layers of a network descriptors may read.

The paper joins, for each output scale, two layers of the same grid: one near the output and one earlier that still
holds visual features. `near` is the input of the last convolution before the output; `early` is the last backbone
layer of that stride: the last one before the network goes on to a coarser grid, or, on the coarsest grid, the last
residual sum (the widest layer, where there are none) before the head. A backbone without any layer of an output's grid
leaves `near` alone. Finer grids than the outputs' are offered too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lookonce.make.darknet.layers import AvgPool, Convolutional, DarknetConfig, Dropout, Layer, Region, Shortcut, Yolo

__all__ = ["ScaleFeatures", "backbone_layers", "scale_features"]

_FINEST_STRIDE = 4


@dataclass(frozen=True, slots=True)
class ScaleFeatures:
    """The layers that descriptors of one output scale read: `output`, `near` and `early`, all of one grid."""

    output: Layer
    near: Layer
    early: Layer


def scale_features(config: DarknetConfig) -> tuple[ScaleFeatures, ...]:
    """For each output layer in cfg order, the two layers of its grid that its descriptors read."""
    backbone = backbone_layers(config)
    result = []
    for output in config.outputs:
        near = _skip_dropout(config, config.layers[output.index - 2])
        early = backbone.get(config.stride(output), near)
        if (early.height, early.width) != (output.height, output.width):
            early = near
        result.append(ScaleFeatures(output, near, early))
    return tuple(result)


def backbone_layers(config: DarknetConfig) -> dict[int, Layer]:
    """The last backbone layer of each stride from 4 to the coarsest output's, by stride in px, finest first."""
    layers: dict[int, Layer] = {}
    trunk = _trunk(config)
    for stride in sorted({config.stride(layer) for layer in trunk}):
        if not _FINEST_STRIDE <= stride <= config.largest_stride:
            continue
        of_stride = [layer for layer in trunk if config.stride(layer) == stride]
        if stride < config.largest_stride:
            layers[stride] = _skip_dropout(config, of_stride[-1])
        else:
            sums = [layer for layer in of_stride if isinstance(layer.spec, Shortcut)]
            widest = max(of_stride, key=lambda layer: (layer.channels, -layer.index))
            layers[stride] = sums[-1] if sums else widest
    return layers


def _trunk(config: DarknetConfig) -> list[Layer]:
    """The layers of the backbone: all before the grid first becomes finer again, or an output's own two layers."""
    coarsest = config.size[0] // config.largest_stride
    trunk: list[Layer] = []
    for layer in _with_grid(config):
        if isinstance(layer.spec, Yolo | Region):
            return [before for before in trunk if before.index < layer.index - 2]
        if trunk and layer.height > trunk[-1].height and trunk[-1].height <= coarsest:
            return trunk
        trunk.append(layer)
    return trunk


def _with_grid(config: DarknetConfig) -> Iterator[Layer]:
    """The layers that keep a grid: not the average pools and what follows them up to the product with a grid."""
    is_pooled = False
    for layer in config.layers:
        if isinstance(layer.spec, AvgPool):
            is_pooled = True
        elif not isinstance(layer.spec, Convolutional | Dropout):
            is_pooled = False
        if not is_pooled:
            yield layer


def _skip_dropout(config: DarknetConfig, layer: Layer) -> Layer:
    while isinstance(layer.spec, Dropout) and layer.index:
        layer = config.layers[layer.index - 1]
    return layer
