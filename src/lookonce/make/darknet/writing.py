"""Darknet's own two files of a trained network: the cfg with other anchors or classes, and the weights."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lookonce.make.darknet.layers import DarknetConfig
from lookonce.make.darknet.weights import ConvolutionWeights

__all__ = ["cfg_with", "weights_bytes"]

_HEADER = struct.pack("<iiiq", 0, 2, 5, 0)  # version 0.2.5, no images seen


def weights_bytes(weights: Mapping[int, ConvolutionWeights]) -> bytes:
    """The parameters as a Darknet weights file; ``read_weights`` reads it back."""
    parts: list[NDArray[np.float32]] = []
    for index in sorted(weights):
        one = weights[index]
        normalization = [v for v in (one.scale, one.mean, one.variance) if v is not None]
        parts += [one.bias, *normalization, one.kernel]
    return _HEADER + np.concatenate([part.ravel() for part in parts]).astype("<f4").tobytes()


def cfg_with(
    text: str,
    network: DarknetConfig,
    *,
    anchors: Sequence[Sequence[tuple[float, float]]] | None = None,
    classes: int | None = None,
    size: tuple[int, int] | None = None,
) -> str:
    """The text of a cfg file with other anchors, classes or input size.

    Args:
        text: of the file that ``network`` was read from.
        network: as read; all its outputs are [yolo].
        anchors: of each output (width, height) in px, as many as it has.
        classes: number; the filters before each [yolo] follow.
        size: (height, width) in px.
    """
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if line.strip().startswith("[")]
    ends = [*starts[1:], len(lines)]
    if size is not None:
        _set_(lines, starts[0], ends[0], "height", str(size[0]))
        _set_(lines, starts[0], ends[0], "width", str(size[1]))
    for number, layer in enumerate(network.outputs):
        section, before = layer.index + 1, layer.index
        if anchors is not None:
            own = anchors[number]
            shown = ",  ".join(f"{width:.1f},{height:.1f}" for width, height in own)
            values = {"anchors": shown, "num": str(len(own)), "mask": ",".join(map(str, range(len(own))))}
            for key, value in values.items():
                _set_(lines, starts[section], ends[section], key, value)
        if classes is not None:
            count = len(network.output_spec(layer).anchors)
            _set_(lines, starts[section], ends[section], "classes", str(classes))
            _set_(lines, starts[before], ends[before], "filters", str(count * (5 + classes)))
    return "\n".join(lines) + "\n"


def _set_(lines: list[str], start: int, end: int, key: str, value: str) -> None:
    """Give a key of one section another value, in place; a key that is not there is added."""
    for number in range(start, end):
        if lines[number].split("#")[0].partition("=")[0].strip() == key:
            lines[number] = f"{key}={value}"
            return
    lines[start] += f"\n{key}={value}"
