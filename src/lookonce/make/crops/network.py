"""A small convolutional network on cut-out boxes, in the manner of Deep SORT's and of Siamese trackers."""

from __future__ import annotations

from torch import Tensor, nn

from lookonce.make.descriptors.head import DESCRIPTOR_SIZE

__all__ = ["CropNetwork"]

_CHANNELS = (32, 64, 96, 128)
_STRIPES = 4  # averaged by themselves: trousers and coat, bonnet and roof


class CropNetwork(nn.Module):
    """Pictures (N, 3, 64, 64) in [0, 1] -> (N, 128) of unit length; some 0.6 million parameters."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = 3
        for number, channels in enumerate(_CHANNELS):
            layers += _convolution(before, channels, stride=2)
            if number:
                layers.append(_Residual(channels))
            before = channels
        self.layers = nn.Sequential(*layers, nn.AdaptiveAvgPool2d((_STRIPES, 1)), nn.Flatten())
        self.last = nn.Linear(_STRIPES * before, DESCRIPTOR_SIZE)

    def forward(self, planes: Tensor) -> Tensor:
        """Descriptors of N crops."""
        described: Tensor = nn.functional.normalize(self.last(self.layers(planes - 0.5)), dim=1)
        return described


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(*_convolution(channels, channels, stride=1))

    def forward(self, x: Tensor) -> Tensor:
        result: Tensor = x + self.inner(x)
        return result


def _convolution(before: int, after: int, *, stride: int) -> list[nn.Module]:
    return [
        nn.Conv2d(before, after, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(after),
        nn.ReLU(inplace=True),
    ]
