"""A Darknet network in PyTorch, built layer by layer from its description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

from lookonce.make.darknet.layers import (
    AvgPool,
    Convolutional,
    DarknetConfig,
    Layer,
    LayerSpec,
    MaxPool,
    Region,
    Reorg,
    Route,
    ScaleChannels,
    Shortcut,
    Upsample,
    Yolo,
)
from lookonce.make.darknet.weights import ConvolutionWeights

__all__ = ["DarknetNetwork"]

_BATCH_NORM_EPSILON = 1e-6  # Darknet's .000001f
_LEAKY_SLOPE = 0.1  # Darknet's


def _activate(x: Tensor, activation: str) -> Tensor:
    match activation:
        case "linear":
            return x
        case "leaky":
            return functional.leaky_relu(x, _LEAKY_SLOPE)
        case "mish":
            return functional.mish(x)
        case "relu":
            return functional.relu(x)
        case "relu6":
            return functional.relu6(x)
        case "swish":
            return functional.silu(x)
        case "logistic":
            return torch.sigmoid(x)
    raise ValueError(f"unknown activation {activation}")


@torch.no_grad()
def _copy_(parameter: Tensor | None, values: NDArray[np.float32] | None) -> None:
    assert parameter is not None
    assert values is not None
    parameter.copy_(torch.tensor(values))


class ConvolutionBlock(nn.Module):
    """Convolution, batch norm where the layer has it, activation."""

    def __init__(self, spec: Convolutional, in_channels: int) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(
            in_channels,
            spec.filters,
            spec.size,
            spec.stride,
            spec.padding,
            groups=spec.groups,
            bias=not spec.batch_normalize,
        )
        self.normalization = nn.BatchNorm2d(spec.filters, eps=_BATCH_NORM_EPSILON) if spec.batch_normalize else None
        self.activation = spec.activation

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, F, H', W')."""
        x = self.convolution(x)
        if self.normalization is not None:
            x = self.normalization(x)
        return _activate(x, self.activation)

    def load_(self, weights: ConvolutionWeights) -> None:
        """Overwrite the parameters with those of a weights file."""
        _copy_(self.convolution.weight, weights.kernel)
        if self.normalization is None:
            _copy_(self.convolution.bias, weights.bias)
        else:
            _copy_(self.normalization.bias, weights.bias)
            _copy_(self.normalization.weight, weights.scale)
            _copy_(self.normalization.running_mean, weights.mean)
            _copy_(self.normalization.running_var, weights.variance)

    def weights(self) -> ConvolutionWeights:
        """A copy of the parameters, as a weights file has them."""

        def values(parameter: Tensor | None) -> NDArray[np.float32]:
            assert parameter is not None
            return parameter.detach().cpu().float().numpy().copy()

        kernel = values(self.convolution.weight)
        if (norm := self.normalization) is None:
            return ConvolutionWeights(kernel, values(self.convolution.bias), None, None, None)
        moments = values(norm.running_mean), values(norm.running_var)
        return ConvolutionWeights(kernel, values(norm.bias), values(norm.weight), *moments)

    def fuse_(self) -> None:
        """Fold batch norm into the convolution; for inference only."""
        if self.normalization is not None:
            self.convolution = fuse_conv_bn_eval(self.convolution, self.normalization)
            self.normalization = None


def _max_pool(x: Tensor, spec: MaxPool) -> Tensor:
    before = spec.padding // 2
    after = spec.padding - before
    if before == after and before <= spec.size // 2:
        return functional.max_pool2d(x, spec.size, spec.stride, before)
    # Where the last window would start beyond the picture, Darknet's padding has no effect: leave it out.
    rest = [(n + spec.padding - spec.size) % spec.stride for n in x.shape[-2:]]
    bottom, right = (max(0, after - r) for r in rest)
    if before or bottom or right:
        x = functional.pad(x, (before, right, before, bottom), value=float("-inf"))
    return functional.max_pool2d(x, spec.size, spec.stride)


def _reorg(x: Tensor, stride: int) -> Tensor:
    """Darknet's reorg: reads the (C, H, W) buffer as (C / s², H s, W s) and takes every s-th row and column of that."""
    batch, channels, height, width = x.shape
    depth = channels // stride**2
    x = x.reshape(batch, depth, height, stride, width, stride)
    x = x.permute(0, 3, 5, 1, 2, 4)  # (B, row offset, column offset, C / s², H, W)
    return x.reshape(batch, channels * stride**2, height // stride, width // stride)


class DarknetNetwork(nn.Module):
    """The network of a cfg file.

    ``forward`` gives the raw maps that enter the [yolo] or [region] layers and, by layer index, whatever other
    layers' outputs are asked for: descriptors may read any of them.
    """

    def __init__(self, config: DarknetConfig, features: Sequence[int] = ()) -> None:
        super().__init__()
        self.config = config
        self.features = tuple(features)
        self.blocks = nn.ModuleDict()
        for layer in config.layers:
            if isinstance(layer.spec, Convolutional):
                self.blocks[str(layer.index)] = ConvolutionBlock(layer.spec, config.input_channels(layer))
        self._last_use = _last_uses(config, self.features)

    def load_weights_(self, weights: Mapping[int, ConvolutionWeights]) -> None:
        """Overwrite all parameters with those of a weights file, by layer index."""
        for index, block in self.blocks.items():
            assert isinstance(block, ConvolutionBlock)
            block.load_(weights[int(index)])

    def weights(self) -> dict[int, ConvolutionWeights]:
        """A copy of all parameters, by layer index."""
        found = {}
        for index, block in self.blocks.items():
            assert isinstance(block, ConvolutionBlock)
            found[int(index)] = block.weights()
        return found

    def fuse_(self) -> None:
        """Fold every batch norm into its convolution; for inference only."""
        for block in self.blocks.values():
            assert isinstance(block, ConvolutionBlock)
            block.fuse_()

    def forward(self, images: Tensor) -> tuple[list[Tensor], dict[int, Tensor]]:
        """Run the network.

        Args:
            images: (B, 3, H, W) float, RGB in [0, 1].

        Returns:
            The raw map of each output layer, (B, anchors x (5 + classes), h, w), in cfg order; and the outputs of the
            layers in ``features`` by index, (B, C, h, w).
        """
        kept: dict[int, Tensor] = {}
        raw: list[Tensor] = []
        x = images
        for layer in self.config.layers:
            if isinstance(layer.spec, Yolo | Region):
                raw.append(x)
            x = self._run(layer, x, kept)
            kept[layer.index] = x
            for index in self._last_use.get(layer.index, ()):
                del kept[index]
        return raw, {index: kept[index] for index in self.features}

    def _run(self, layer: Layer, x: Tensor, kept: Mapping[int, Tensor]) -> Tensor:
        spec: LayerSpec = layer.spec
        match spec:
            case Convolutional():
                result: Tensor = self.blocks[str(layer.index)](x)
                return result
            case MaxPool():
                return _max_pool(x, spec)
            case AvgPool():
                return x.mean(dim=(2, 3), keepdim=True)
            case Route():
                return _route(spec, kept)
            case Shortcut():
                return _activate(x + kept[spec.source], spec.activation)
            case ScaleChannels():
                return _activate(x * kept[spec.source], spec.activation)
            case Upsample():
                return functional.interpolate(x, scale_factor=float(spec.stride), mode="nearest")
            case Reorg():
                return _reorg(x, spec.stride)
        return x  # [dropout], [yolo] and [region] change nothing here


def _route(spec: Route, kept: Mapping[int, Tensor]) -> Tensor:
    parts = [kept[index] for index in spec.layers]
    if spec.groups > 1:
        parts = [part.chunk(spec.groups, dim=1)[spec.group_id] for part in parts]
    return parts[0] if len(parts) == 1 else torch.cat(parts, dim=1)


def _last_uses(config: DarknetConfig, features: Sequence[int]) -> dict[int, list[int]]:
    """Which outputs nobody reads any more after each layer, so that memory is given back."""
    last = {layer.index: layer.index for layer in config.layers}
    for layer in config.layers:
        match layer.spec:
            case Route(layers=sources):
                last.update(dict.fromkeys(sources, layer.index))
            case Shortcut(source=source) | ScaleChannels(source=source):
                last[source] = layer.index
    uses: dict[int, list[int]] = {}
    for index, user in last.items():
        if index not in features:
            uses.setdefault(user, []).append(index)
    return uses
