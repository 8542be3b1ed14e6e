"""A Darknet network and its weights as a model file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import onnx_ir as ir
import torch

from lookonce.errors import ConfigError, FormatError
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.features import ScaleFeatures, backbone_layers, scale_features
from lookonce.make.darknet.layers import DarknetConfig, Layer, Region, Shortcut, Yolo
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.darknet.weights import read_weights
from lookonce.make.export.detections import OutputScale, write_detections
from lookonce.make.export.graph import GraphWriter
from lookonce.make.export.model_file import declare_descriptors, declare_detections, save_model
from lookonce.make.export.native import FeatureMap, write_native_descriptors
from lookonce.make.export.tracing import trace
from lookonce.model.metadata import DescriptorInfo, Feature, ModelMetadata, OutputGrid

__all__ = ["import_darknet", "read_names", "write_detector"]

_MAX_NAMES_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class _Plan:
    """Which layers the model file names: the raw maps, then everything that descriptors may read."""

    config: DarknetConfig
    features: tuple[Layer, ...]

    def name(self, layer: Layer) -> str:
        return f"layer_{layer.index}"

    def raw_name(self, output: Layer) -> str:
        return f"layer_{output.index - 1}"


def import_darknet(
    cfg: Path,
    weights: Path,
    output: Path,
    *,
    names: Path | None = None,
    size: tuple[int, int] | None = None,
    descriptors: bool = True,
    license: str = "unknown",
) -> ModelMetadata:
    """Write a Darknet detector as a lookonce model file.

    Args:
        cfg: network description.
        weights: its parameters.
        output: the model file to write.
        names: class names, one a line; without it the classes are called ``class 0`` and so on.
        size: input (height, width) in px instead of the cfg's own; multiples of the largest stride.
        descriptors: whether detections carry descriptors of kind ``native``.
        license: terms of the weights, kept in the file.

    Returns:
        What the file says about itself.

    Raises:
        LookonceError: an input is wrong or the file cannot be written.
    """
    if not license.isprintable():
        raise ConfigError("license: expected text on one line")
    config = read_cfg(cfg, size)
    class_names = _class_names(names, config.classes)
    parameters, digest = read_weights(weights, config)
    network = DarknetNetwork(config)
    network.load_weights_(parameters)
    source = {"cfg": cfg.name, "weights": weights.name, "weights_sha256": digest}
    return write_detector(network, class_names, output, descriptors=descriptors, license=license, source=source)


def write_detector(
    network: DarknetNetwork,
    names: tuple[str, ...],
    output: Path,
    *,
    descriptors: bool,
    license: str,
    source: Mapping[str, str],
    training: Mapping[str, str] | None = None,
) -> ModelMetadata:
    """Write a network with its parameters as a model file.

    Args:
        network: it stays as it is.
        names: class names.
        output: the model file to write.
        descriptors: whether detections carry descriptors of kind ``native``.
        license: terms of the weights.
        source: where network and weights came from.
        training: how it was trained, as far as known.

    Raises:
        OutputError: the file cannot be written.
    """
    config = network.config
    plan = _Plan(config, _offered_features(config))
    fused = DarknetNetwork(config, [layer.index for layer in plan.features]).eval()
    fused.load_state_dict(network.state_dict())
    fused.fuse_()
    metadata = ModelMetadata(
        names=names,
        size=config.size,
        outputs=tuple(_output_grid(plan, scale) for scale in scale_features(config)),
        descriptor=_descriptor_info(plan) if descriptors else None,
        features=tuple(Feature(plan.name(f), f.channels, config.stride(f)) for f in plan.features),
        license=license,
        source=source,
        training=training or {},
        made_by=version("lookonce"),
    )
    _write(fused, plan, metadata, output)
    return metadata


def _write(network: DarknetNetwork, plan: _Plan, metadata: ModelMetadata, output: Path) -> None:
    config = plan.config
    raw_names = [plan.raw_name(layer) for layer in config.outputs]
    with torch.no_grad():
        model, values = trace(network, config.size, raw_names + [plan.name(layer) for layer in plan.features])
    g = GraphWriter(model.graph)
    scales = [_output_scale(config, o, values[n]) for o, n in zip(config.outputs, raw_names, strict=True)]
    detections = write_detections(g, scales, config.classes)
    declare_detections(g, detections)
    if metadata.descriptor is not None:

        def feature_map(layer: Layer) -> FeatureMap:
            return FeatureMap(values[plan.name(layer)], layer.channels, layer.height * layer.width)

        pairs = [(feature_map(s.near), feature_map(s.early)) for s in scale_features(config)]
        declare_descriptors(g, write_native_descriptors(g, detections, pairs), metadata.descriptor.size)
    save_model(model, metadata, output)


def _output_scale(config: DarknetConfig, layer: Layer, raw: ir.Value) -> OutputScale:
    stride, spec = config.stride(layer), config.output_spec(layer)
    grid, anchors = (layer.height, layer.width), _anchors_px(config, layer)
    if isinstance(spec, Region):
        return OutputScale(raw, anchors, grid, stride, softmax=True)
    assert isinstance(spec, Yolo)
    return OutputScale(raw, anchors, grid, stride, spec.scale_x_y, spec.new_coords)


def _output_grid(plan: _Plan, scale: ScaleFeatures) -> OutputGrid:
    stride, anchors = plan.config.stride(scale.output), _anchors_px(plan.config, scale.output)
    return OutputGrid(stride, anchors, plan.name(scale.near), plan.name(scale.early))


def _anchors_px(config: DarknetConfig, output: Layer) -> tuple[tuple[float, float], ...]:
    spec = config.output_spec(output)
    unit = config.stride(output) if isinstance(spec, Region) else 1  # YOLOv2's are in cells
    return tuple((width * unit, height * unit) for width, height in spec.anchors)


def _offered_features(config: DarknetConfig) -> tuple[Layer, ...]:
    """Both layers of each output, the last backbone layer of each stride, and its last residual sum."""
    backbone = backbone_layers(config)
    chosen = {layer.index for layer in backbone.values()}
    for scale in scale_features(config):
        chosen |= {scale.near.index, scale.early.index}
    for stride, last in backbone.items():
        sums = [
            layer.index
            for layer in config.layers[: last.index]
            if isinstance(layer.spec, Shortcut) and config.stride(layer) == stride
        ]
        chosen |= set(sums[-1:])
    return tuple(config.layers[index] for index in sorted(chosen))


def _descriptor_info(plan: _Plan) -> DescriptorInfo:
    read = [layer for scale in scale_features(plan.config) for layer in (scale.near, scale.early)]
    return DescriptorInfo("native", sum(layer.channels for layer in read), tuple(plan.name(layer) for layer in read))


def _class_names(path: Path | None, classes: int) -> tuple[str, ...]:
    if path is None:
        return tuple(f"class {index}" for index in range(classes))
    names = read_names(path)
    for line, name in enumerate(names, start=1):
        if not name.isprintable():
            raise FormatError(path, line, "a class name with control characters; expected one name a line")
    if len(names) != classes:
        raise ConfigError(f"{path}: {len(names)} class names, but the network has {classes} classes; give its own file")
    return names


def read_names(path: Path) -> tuple[str, ...]:
    """Class names, one a line; blank lines at the end are left out.

    Raises:
        ConfigError: the file cannot be read as names.
    """
    try:
        with open(path, "rb") as file:
            text = file.read(_MAX_NAMES_BYTES + 1).decode("utf-8")
    except OSError as exc:
        raise ConfigError(f"{path}: cannot read the class names ({exc.strerror}); check the path") from exc
    except UnicodeDecodeError as exc:
        raise ConfigError(f"{path}: not text; expected one class name a line") from exc
    if len(text) > _MAX_NAMES_BYTES:
        raise ConfigError(f"{path}: larger than {_MAX_NAMES_BYTES} bytes; expected one class name a line")
    return tuple(line.strip() for line in text.rstrip().splitlines())
