"""What a model file says about itself: one JSON object in its ONNX metadata, versioned and checked on reading."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from lookonce.errors import ModelError

__all__ = ["FORMAT_VERSION", "METADATA_KEY", "DescriptorInfo", "Feature", "ModelMetadata", "OutputGrid"]

METADATA_KEY = "lookonce"
FORMAT_VERSION = 1
_MAX_SIZE_PX = 4096
_MAX_CLASSES = 10_000
_MAX_DESCRIPTOR = 65_536


@dataclass(frozen=True, slots=True)
class Feature:
    """A tensor of the graph that descriptor heads may read, (B, channels, H / stride, W / stride) float32."""

    name: str
    channels: int
    stride_px: int


@dataclass(frozen=True, slots=True)
class OutputGrid:
    """One grid on which the detector finds objects.

    Attributes:
        stride_px: input px for one cell.
        anchors_px: (width, height) of the anchors in px of the input.
        near: name of the feature near the output: what the last convolution before it reads.
        early: name of the earlier feature of the same grid, rich in visual detail; ``near`` where there is none.
    """

    stride_px: int
    anchors_px: tuple[tuple[float, float], ...]
    near: str
    early: str


@dataclass(frozen=True, slots=True)
class DescriptorInfo:
    """What the output ``descriptors`` holds.

    Attributes:
        kind: how they are made, such as ``native``.
        size: D, values in one descriptor.
        layers: names of the features that are read.
        match_threshold: Euclidean distance up to which two descriptors are taken for one object; None where nobody
            has calibrated it.
    """

    kind: str
    size: int
    layers: tuple[str, ...]
    match_threshold: float | None = None


@dataclass(frozen=True, slots=True)
class ModelMetadata:
    """All of a model file's own description.

    Attributes:
        names: class names, by label.
        size: the network's input (height, width) in px.
        outputs: the grids on which the detector finds objects.
        descriptor: None for a file that only detects.
        features: tensors that descriptor heads may read.
        license: terms of the weights, as far as known.
        source: where the network came from: file names, SHA-256 digests.
        training: how it was trained, as far as known.
        made_by: the lookonce version that wrote the file.
    """

    names: tuple[str, ...]
    size: tuple[int, int]
    outputs: tuple[OutputGrid, ...]
    descriptor: DescriptorInfo | None = None
    features: tuple[Feature, ...] = ()
    license: str = "unknown"
    source: Mapping[str, str] = field(default_factory=dict)
    training: Mapping[str, str] = field(default_factory=dict)
    made_by: str = ""

    def to_json(self) -> str:
        """The text that goes into the file."""
        content = {"format_version": FORMAT_VERSION, **asdict(self)}
        return json.dumps(content, ensure_ascii=False, sort_keys=True)

    @classmethod
    def from_json(cls, path: str, text: str) -> ModelMetadata:
        """Read the text of a file at ``path``.

        Raises:
            ModelError: it is not ours, of another version, or a field is missing or out of range.
        """
        try:
            content = json.loads(text)
            version = content["format_version"]
        except (ValueError, KeyError, TypeError, RecursionError) as exc:
            raise ModelError(f"{path}: its description is damaged; make the file again") from exc
        if version != FORMAT_VERSION:
            raise ModelError(
                f"{path}: format version {version!s:.20}, but this lookonce reads version {FORMAT_VERSION}; "
                "make the file again or install the lookonce that made it"
            )
        try:
            return cls(
                names=tuple(_text(name) for name in _list(content["names"], 1, _MAX_CLASSES)),
                size=_size(content["size"]),
                outputs=tuple(_output(grid) for grid in _list(content["outputs"], 1, 16)),
                descriptor=_descriptor(content["descriptor"]),
                features=tuple(_feature(f) for f in _list(content["features"], 0, 1000)),
                license=_text(content["license"]),
                source=_texts(content["source"]),
                training=_texts(content["training"]),
                made_by=_text(content["made_by"]),
            )
        except KeyError as exc:
            raise ModelError(f"{path}: its description lacks {exc}; make the file again") from exc
        except (TypeError, ValueError) as exc:
            raise ModelError(f"{path}: its description is damaged ({exc}); make the file again") from exc


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > 10_000 or not value.isprintable():
        raise ValueError("expected a short text on one line")
    return value


def _texts(value: object) -> dict[str, str]:
    if not isinstance(value, dict) or len(value) > 1000:
        raise ValueError("expected named texts")
    return {_text(key): _text(item) for key, item in value.items()}


def _whole(value: object, low: int, high: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"expected a whole number from {low} to {high}, got {value!s:.20}")
    return value


def _list(value: object, low: int, high: int) -> list[object]:
    if not isinstance(value, list) or not low <= len(value) <= high:
        raise ValueError(f"expected a list of {low} to {high} values")
    return value


def _size(value: object) -> tuple[int, int]:
    height, width = (_whole(n, 1, _MAX_SIZE_PX) for n in _list(value, 2, 2))
    return height, width


def _output(value: object) -> OutputGrid:
    if not isinstance(value, dict):
        raise ValueError("expected an output grid")
    stride_px = _whole(value["stride_px"], 1, _MAX_SIZE_PX)
    return OutputGrid(stride_px, _anchors(value["anchors_px"]), _text(value["near"]), _text(value["early"]))


def _anchors(value: object) -> tuple[tuple[float, float], ...]:
    pairs = [_list(pair, 2, 2) for pair in _list(value, 1, 100)]
    return tuple((_positive(width, "anchors_px"), _positive(height, "anchors_px")) for width, height in pairs)


def _positive(value: object, name: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not 0 < value < math.inf:
        raise ValueError(f"{name}: expected a positive number")
    return float(value)


def _feature(value: object) -> Feature:
    if not isinstance(value, dict):
        raise ValueError("expected a feature")
    return Feature(
        _text(value["name"]), _whole(value["channels"], 1, 1 << 20), _whole(value["stride_px"], 1, _MAX_SIZE_PX)
    )


def _descriptor(value: object) -> DescriptorInfo | None:
    if value is None:
        return None
    if not isinstance(value, dict):
        raise ValueError("expected a descriptor")
    threshold = value["match_threshold"]
    if threshold is not None:
        threshold = _positive(threshold, "match_threshold")
    layers = tuple(_text(name) for name in _list(value["layers"], 0, 1000))
    return DescriptorInfo(_text(value["kind"]), _whole(value["size"], 1, _MAX_DESCRIPTOR), layers, threshold)
