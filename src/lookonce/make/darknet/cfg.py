"""A Darknet cfg file as a checked network description: typed layers with their shapes.

Reads the YOLO families v2, v3, v4, Yolo-Fastest and MobileNet-YOLO. Everything that changes the result of a forward
pass is read and checked; keys that only training uses are accepted and ignored; any other key is an error.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lookonce.errors import ConfigError, FormatError
from lookonce.make.darknet.layers import (
    AvgPool,
    Convolutional,
    DarknetConfig,
    Dropout,
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
from lookonce.make.darknet.sections import Section, read_sections

__all__ = ["read_cfg"]

ACTIVATIONS = ("linear", "leaky", "mish", "relu", "relu6", "swish", "logistic")
_MAX_CHANNELS = 16_384
_MAX_SIZE_PX = 4096
_MAX_CELLS = 1 << 28  # values in one layer's output: 1 GiB of float32
_MAX_PARAMETERS = 400_000_000  # yolov4x-mish has 100 million
_MAX_CLASSES = 10_000


def read_cfg(path: Path, size: tuple[int, int] | None = None) -> DarknetConfig:
    """Read a cfg file.

    Args:
        path: the file.
        size: input (height, width) in px instead of the file's own.

    Raises:
        FormatError: the file is not a network that lookonce can run; names path and line.
        ConfigError: the size does not suit the network.
    """
    sections = read_sections(path)
    own_size = _read_net(sections[0])
    config = _build(path, sections[1:], own_size)
    if size is None or size == own_size:
        return config
    stride = config.largest_stride
    if not all(0 < n <= _MAX_SIZE_PX and n % stride == 0 for n in size):
        raise ConfigError(
            f"size {size[0]}x{size[1]}: each side must be a multiple of {stride} px, the network's largest stride, "
            f"up to {_MAX_SIZE_PX}"
        )
    return _build(path, sections[1:], size)


def _build(path: Path, sections: list[Section], size: tuple[int, int]) -> DarknetConfig:
    layers: list[Layer] = []
    shape = (3, *size)
    for section in sections:
        layer = _Reader(section, layers, shape).read()
        layers.append(layer)
        shape = (layer.channels, layer.height, layer.width)
    config = DarknetConfig(str(path), size, tuple(layers))
    _check_network(config)
    return config


_NET_TRAINING_KEYS = (
    "batch subdivisions momentum decay angle saturation exposure hue learning_rate burn_in max_batches policy steps "
    "scales mosaic cutmix mixup blur letter_box ema_alpha power flip max_crop min_crop optimized_memory "
    "dynamic_minibatch adversarial_lr time_steps track augment_speed label_smooth_eps num_sigmas_reject_badlabels "
    "badlabels_rejection_percentage equidistant_point show_receptive_field max_chart_loss workspace_size_limit_MB"
).split()
_OUTPUT_TRAINING_KEYS = (
    "jitter ignore_thresh truth_thresh random objectness_smooth resize iou_thresh iou_normalizer cls_normalizer "
    "obj_normalizer iou_loss iou_thresh_kind nms_kind beta_nms max_delta max uc_normalizer counters_per_class "
    "focal_loss label_smooth_eps bias_match rescore object_scale noobject_scale class_scale coord_scale absolute "
    "thresh delta_normalizer show_details"
).split()


def _read_net(section: Section) -> tuple[int, int]:
    if section.name not in ("net", "network"):
        raise section.fail("expected [net] as the first section")
    height = section.integer("height", None, 32, _MAX_SIZE_PX)
    width = section.integer("width", None, 32, _MAX_SIZE_PX)
    if section.integer("channels", 3, 1, 4) != 3:
        raise section.fail("channels: lookonce reads RGB networks (channels=3) only", "channels")
    section.finish(_NET_TRAINING_KEYS)
    return height, width


@dataclass(frozen=True, slots=True)
class _Reader:
    """Reads one section as a layer, given the layers before it and the shape that enters it."""

    section: Section
    layers: list[Layer]
    shape: tuple[int, int, int]

    def read(self) -> Layer:
        """The layer, its shape checked against the limits."""
        readers = {
            "convolutional": self._convolutional,
            "conv": self._convolutional,
            "maxpool": self._maxpool,
            "max": self._maxpool,
            "avgpool": self._avgpool,
            "route": self._route,
            "shortcut": self._shortcut,
            "upsample": self._upsample,
            "reorg": self._reorg,
            "scale_channels": self._scale_channels,
            "dropout": self._dropout,
            "region": self._region,
            "yolo": self._yolo,
        }
        if self.section.name not in readers:
            raise self.section.fail(f"is not a layer that lookonce supports (it has {', '.join(readers)})")
        spec, (channels, height, width) = readers[self.section.name]()
        if height < 1 or width < 1:
            raise self.section.fail("leaves no cell of the grid; choose a larger size")
        if channels > _MAX_CHANNELS or channels * height * width > _MAX_CELLS:
            raise self.section.fail(f"output of {channels} x {height} x {width} is beyond the limit")
        return Layer(len(self.layers), spec, channels, height, width, self.section.line)

    def _convolutional(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        s, (channels, height, width) = self.section, self.shape
        size = s.integer("size", 1, 1, 63)
        padding = s.integer("padding", 0, 0, 63)
        if s.integer("pad", 0, 0, 1):
            padding = size // 2
        spec = Convolutional(
            filters=s.integer("filters", 1, 1, _MAX_CHANNELS),
            size=size,
            stride=s.integer("stride", 1, 1, 16),
            padding=padding,
            groups=s.integer("groups", 1, 1, _MAX_CHANNELS),
            batch_normalize=bool(s.integer("batch_normalize", 0, 0, 1)),
            activation=s.choice("activation", "logistic", ACTIVATIONS),
        )
        if channels % spec.groups or spec.filters % spec.groups:
            raise s.fail(f"groups={spec.groups} must divide {channels} input channels and {spec.filters} filters")
        s.finish(("stopbackward", "learning_rate_scale", "burnin_update", "train_only_bn"))
        rows, columns = ((n + 2 * padding - size) // spec.stride + 1 for n in (height, width))
        return spec, (spec.filters, rows, columns)

    def _maxpool(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        s, (channels, height, width) = self.section, self.shape
        stride = s.integer("stride", 1, 1, 16)
        size = s.integer("size", stride, 1, 63)
        padding = s.integer("padding", size - 1, 0, 2 * (size - 1))
        s.finish(())
        rows, columns = ((n + padding - size) // stride + 1 for n in (height, width))
        return MaxPool(size, stride, padding), (channels, rows, columns)

    def _avgpool(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        self.section.finish(())
        return AvgPool(), (self.shape[0], 1, 1)

    def _route(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        s = self.section
        groups = s.integer("groups", 1, 1, _MAX_CHANNELS)
        group_id = s.integer("group_id", 0, 0, groups - 1)
        sources = [self._source(offset, "layers") for offset in s.integers("layers", -_MAX_CHANNELS, _MAX_CHANNELS)]
        s.finish(("stopbackward",))
        first = sources[0]
        for source in sources:
            if (source.height, source.width) != (first.height, first.width):
                raise s.fail(f"layers {first.index} and {source.index} have different grids", "layers")
            if source.channels % groups:
                raise s.fail(f"groups={groups} does not divide the {source.channels} channels of {source.index}")
        channels = sum(source.channels // groups for source in sources)
        spec = Route(tuple(source.index for source in sources), groups, group_id)
        return spec, (channels, first.height, first.width)

    def _shortcut(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        s = self.section
        source = self._source(s.integer("from", None, -_MAX_CHANNELS, _MAX_CHANNELS), "from")
        activation = s.choice("activation", "linear", ACTIVATIONS)
        s.finish(())
        if (source.channels, source.height, source.width) != self.shape:
            raise s.fail(f"layer {source.index} has another shape than the layer before", "from")
        return Shortcut(source.index, activation), self.shape

    def _scale_channels(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        s = self.section
        source = self._source(s.integer("from", None, -_MAX_CHANNELS, _MAX_CHANNELS), "from")
        activation = s.choice("activation", "linear", ACTIVATIONS)
        if s.integer("scale_wh", 0, 0, 1):
            raise s.fail("scale_wh=1 is not supported", "scale_wh")
        s.finish(())
        if self.shape != (source.channels, 1, 1):
            raise s.fail(f"expected {source.channels} x 1 x 1 from the layer before (an [avgpool] is missing?)")
        return ScaleChannels(source.index, activation), (source.channels, source.height, source.width)

    def _upsample(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        stride = self.section.integer("stride", 2, 1, 16)
        self.section.finish(())
        channels, height, width = self.shape
        return Upsample(stride), (channels, height * stride, width * stride)

    def _reorg(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        s, (channels, height, width) = self.section, self.shape
        stride = s.integer("stride", 1, 1, 16)
        if s.integer("reverse", 0, 0, 1) or s.integer("flatten", 0, 0, 1) or s.integer("extra", 0, 0, 0):
            raise s.fail("reverse, flatten and extra are not supported")
        s.finish(())
        if height % stride or width % stride or channels % (stride * stride):
            raise s.fail(f"stride={stride} does not divide {channels} x {height} x {width}")
        return Reorg(stride), (channels * stride * stride, height // stride, width // stride)

    def _dropout(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        self.section.finish(("probability", "dropblock", "dropblock_size_rel", "dropblock_size_abs"))
        return Dropout(), self.shape

    def _region(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        s = self.section
        anchors = self._anchors(s.integer("num", 1, 1, 100))
        classes = s.integer("classes", 20, 1, _MAX_CLASSES)
        if s.integer("coords", 4, 1, 100) != 4:
            raise s.fail("only coords=4 is supported", "coords")
        if s.integer("softmax", 0, 0, 1) != 1:
            raise s.fail("only softmax=1 is supported", "softmax")
        s.finish(_OUTPUT_TRAINING_KEYS)
        self._check_output(len(anchors), classes)
        return Region(classes, anchors), self.shape

    def _yolo(self) -> tuple[LayerSpec, tuple[int, int, int]]:
        s = self.section
        anchors = self._anchors(s.integer("num", 1, 1, 100))
        classes = s.integer("classes", 20, 1, _MAX_CLASSES)
        if s.has("mask"):
            anchors = tuple(anchors[i] for i in s.integers("mask", 0, len(anchors) - 1))
        scale_x_y = s.number("scale_x_y", 1.0, 1.0, 10.0)
        new_coords = bool(s.integer("new_coords", 0, 0, 1))
        s.finish(_OUTPUT_TRAINING_KEYS)
        self._check_output(len(anchors), classes)
        return Yolo(classes, anchors, scale_x_y, new_coords), self.shape

    def _anchors(self, count: int) -> tuple[tuple[float, float], ...]:
        values = self.section.numbers("anchors", 1e-3, _MAX_SIZE_PX)
        if len(values) != 2 * count:
            raise self.section.fail(
                f"anchors: expected {2 * count} numbers for num={count}, got {len(values)}", "anchors"
            )
        return tuple(zip(values[::2], values[1::2], strict=True))

    def _check_output(self, anchors: int, classes: int) -> None:
        expected = anchors * (5 + classes)
        if not self.layers or self.shape[0] != expected:
            raise self.section.fail(
                f"needs {expected} channels ({anchors} anchors x (5 + {classes} classes)), gets {self.shape[0]}"
            )

    def _source(self, offset: int, key: str) -> Layer:
        index = offset if offset >= 0 else len(self.layers) + offset
        if not 0 <= index < len(self.layers):
            raise self.section.fail(
                f"{key}={offset} points to layer {index}, which is not before layer {len(self.layers)}", key
            )
        return self.layers[index]


def _check_network(config: DarknetConfig) -> None:
    """Raise unless the network ends in outputs that share their classes, and suits its size."""
    outputs = config.outputs
    if not outputs:
        raise FormatError(config.path, 0, "no [yolo] or [region] layer: not a detector")
    if len({(type(o.spec), config.output_spec(o).classes) for o in outputs}) > 1:
        raise FormatError(config.path, outputs[-1].line, "all outputs must be of one kind and have the same classes")
    for layer in outputs:
        before = config.layers[layer.index - 1].spec
        if not isinstance(before, Convolutional):
            raise FormatError(config.path, layer.line, "expected a [convolutional] before an output layer")
        if layer.index < 2 or not _same_grid(layer, config.layers[layer.index - 2]):
            raise FormatError(config.path, layer.line, "expected two layers of the same grid before an output layer")
        if isinstance(layer.spec, Yolo) and layer.spec.new_coords != (before.activation == "logistic"):
            raise FormatError(
                config.path, layer.line, "new_coords=1 and activation=logistic in the layer before go together"
            )
    if config.parameter_count > _MAX_PARAMETERS:
        raise FormatError(config.path, 0, f"more than {_MAX_PARAMETERS:,} parameters")
    height, width = config.size
    if any(height % o.height or width % o.width or height * o.width != width * o.height for o in outputs):
        raise FormatError(config.path, 0, f"size {height}x{width} is not a multiple of the largest stride")
    _check_readers(config)


def _check_readers(config: DarknetConfig) -> None:
    """Raise where a layer reads an output layer: Darknet would hand on activated values, lookonce does not."""
    outputs = {layer.index for layer in config.outputs}
    for layer in config.layers:
        match layer.spec:
            case Route(layers=sources):
                read = set(sources)
            case Shortcut(source=source) | ScaleChannels(source=source):
                read = {source, layer.index - 1}
            case _:
                read = {layer.index - 1}
        if read & outputs:
            raise FormatError(
                config.path, layer.line, "reads an output layer; a [route] to an earlier layer is missing"
            )


def _same_grid(a: Layer, b: Layer) -> bool:
    return (a.height, a.width) == (b.height, b.width)
