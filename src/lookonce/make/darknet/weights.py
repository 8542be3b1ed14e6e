"""Darknet weights files: a short header, then every parameter as little-endian float32, in layer order."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import WeightsError
from lookonce.make.darknet.layers import Convolutional, DarknetConfig

__all__ = ["ConvolutionWeights", "read_weights"]

_VERSION = struct.Struct("<iii")
_FLOAT_BYTES = 4


@dataclass(frozen=True, slots=True)
class ConvolutionWeights:
    """The parameters of one convolution with F filters over C input channels in G groups, kernel K; all float32.

    Attributes:
        kernel: (F, C / G, K, K).
        bias: (F,), added after batch norm's scaling where there is batch norm.
        scale, mean, variance: (F,) each, batch norm's; None without it.
    """

    kernel: NDArray[np.float32]
    bias: NDArray[np.float32]
    scale: NDArray[np.float32] | None
    mean: NDArray[np.float32] | None
    variance: NDArray[np.float32] | None


def read_weights(path: Path, config: DarknetConfig) -> tuple[dict[int, ConvolutionWeights], str]:
    """Read a weights file that must hold exactly this network's parameters.

    Args:
        path: the file.
        config: the network.

    Returns:
        The parameters by layer index, and the file's SHA-256.

    Raises:
        WeightsError: the file is missing, has an unknown header, or is a byte short or long.
    """
    try:
        if path.is_dir():
            raise WeightsError(f"{path}: a folder, not a weights file")
        length = path.stat().st_size
        if length > _header_bytes(2) + config.parameter_count * _FLOAT_BYTES:
            _fail_length(path, length, config, _header_bytes(2))
        raw = path.read_bytes()
    except OSError as exc:
        raise WeightsError(f"{path}: cannot read the weights file ({exc.strerror}); check the path") from exc
    header = _read_header(path, raw)
    if len(raw) != header + config.parameter_count * _FLOAT_BYTES:
        _fail_length(path, len(raw), config, header)
    values = np.frombuffer(raw, "<f4", offset=header).astype(np.float32, copy=False)
    if not np.isfinite(values).all():
        raise WeightsError(f"{path}: holds NaN or infinity; the file is damaged or training diverged")
    return _split(values, config), hashlib.sha256(raw).hexdigest()


def _header_bytes(version: int) -> int:
    """Bytes of the header: three int32, then the images seen, a 64-bit count from version 0.2 on."""
    return _VERSION.size + (8 if version >= 2 else 4)


def _read_header(path: Path, raw: bytes) -> int:
    if len(raw) < _header_bytes(2):
        raise WeightsError(f"{path}: {len(raw)} bytes are too few for a Darknet weights file")
    major, minor, _ = _VERSION.unpack_from(raw)
    if not (0 <= major < 1000 and 0 <= minor < 1000):
        raise WeightsError(f"{path}: header version {major}.{minor} is not Darknet's; is this a weights file?")
    return _header_bytes(major * 10 + minor)


def _fail_length(path: Path, length: int, config: DarknetConfig, header: int) -> None:
    expected = header + config.parameter_count * _FLOAT_BYTES
    wrong = f"{expected - length:,} short" if length < expected else f"{length - expected:,} too many"
    raise WeightsError(
        f"{path}: {length:,} bytes, expected {expected:,} for {config.path} ({wrong}); "
        "the file is damaged or belongs to another network"
    )


def _split(values: NDArray[np.float32], config: DarknetConfig) -> dict[int, ConvolutionWeights]:
    position = 0

    def take(*shape: int) -> NDArray[np.float32]:
        nonlocal position
        start, position = position, position + int(np.prod(shape))
        return values[start:position].reshape(shape)

    weights: dict[int, ConvolutionWeights] = {}
    for layer in config.layers:
        if not isinstance(spec := layer.spec, Convolutional):
            continue
        bias = take(spec.filters)
        normalization = [take(spec.filters) for _ in range(3)] if spec.batch_normalize else [None] * 3
        kernel = take(spec.filters, config.input_channels(layer) // spec.groups, spec.size, spec.size)
        weights[layer.index] = ConvolutionWeights(kernel, bias, *normalization)
    return weights
