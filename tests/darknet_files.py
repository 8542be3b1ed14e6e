"""Writes small Darknet networks: cfg text from a few calls, and seeded random weights that keep values sane."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.layers import Convolutional, DarknetConfig, Region, Shortcut, Yolo

CLASSES = 3
ANCHORS = "8,10, 14,20, 30,24"
RANDOM_HEADER = np.array([0, 2, 5], "<i4").tobytes() + np.array([32_013_312], "<u8").tobytes()


def section(name: str, **keys: object) -> str:
    """One section; a key that is a Python word carries an underscore: ``from_=-2``."""
    return f"[{name}]\n" + "".join(f"{key.rstrip('_')}={value}\n" for key, value in keys.items()) + "\n"


def net(height: int = 64, width: int = 64) -> str:
    return section("net", batch=1, height=height, width=width, channels=3)


def conv(filters: int, size: int = 3, stride: int = 1, activation: str = "leaky", **keys: object) -> str:
    keys = {"batch_normalize": 1, "pad": 1} | keys
    return section("convolutional", filters=filters, size=size, stride=stride, activation=activation, **keys)


def head(anchors: int = 3, activation: str = "linear", classes: int = CLASSES) -> str:
    """The convolution before an output layer."""
    return conv(anchors * (5 + classes), 1, activation=activation, batch_normalize=0)


def yolo(mask: str = "0,1,2", **keys: object) -> str:
    return section("yolo", mask=mask, anchors=ANCHORS, classes=CLASSES, num=3, **keys)


def region(**keys: object) -> str:
    return section("region", anchors="1.0,1.2, 2.1,3.0, 3.5,1.9", classes=CLASSES, num=3, coords=4, softmax=1, **keys)


def route(layers: str, **keys: object) -> str:
    return section("route", layers=layers, **keys)


def maxpool(size: int, stride: int) -> str:
    return section("maxpool", size=size, stride=stride)


def shortcut(source: int, activation: str = "linear") -> str:
    return section("shortcut", from_=source, activation=activation)


def upsample(stride: int = 2) -> str:
    return section("upsample", stride=stride)


_STEM = conv(8, stride=2) + conv(12, stride=2)
_SQUEEZE = section("avgpool") + conv(4, 1, activation="relu") + conv(12, 1, activation="logistic")

TINY: dict[str, str] = {
    f"activation-{name}": net()
    + conv(8, stride=2, activation=name)
    + conv(12, stride=2, activation=name)
    + head()
    + yolo()
    for name in ("linear", "leaky", "mish", "relu", "relu6", "swish", "logistic")
}
TINY |= {
    "no-batch-norm": net()
    + conv(8, stride=2, batch_normalize=0)
    + conv(8, stride=2, batch_normalize=0)
    + head()
    + yolo(),
    "groups": net() + _STEM + conv(12, groups=12) + conv(24, groups=4) + conv(12, 1) + head() + yolo(),
    "padding-key": net() + conv(8, 5, 2, pad=0, padding=2) + conv(8, 3, 2, pad=0, padding=1) + head() + yolo(),
    "maxpool-2": net() + conv(8) + maxpool(2, 2) + conv(8) + maxpool(2, 2) + maxpool(2, 1) + conv(8) + head() + yolo(),
    "maxpool-3": net() + conv(8) + maxpool(3, 2) + conv(8) + maxpool(3, 2) + head() + yolo(),
    "spp": net()
    + _STEM
    + maxpool(3, 1)
    + route("-2")
    + maxpool(5, 1)
    + route("-4")
    + maxpool(9, 1)
    + route("-1,-3,-5,-6")
    + conv(8, 1)
    + head()
    + yolo(),
    "route-groups": net()
    + _STEM
    + route("-1", groups=2, group_id=1)
    + conv(6)
    + conv(6)
    + route("-1,-2")
    + conv(12, 1)
    + route("1,-1")
    + head()
    + yolo(),
    "shortcut": net() + _STEM + conv(6, 1) + conv(12) + shortcut(-3) + conv(12) + shortcut(-2) + head() + yolo(),
    "dropout": net() + _STEM + section("dropout", probability=0.3) + conv(8) + section("dropout") + head() + yolo(),
    "two-scales": net(64, 96)
    + conv(8)
    + maxpool(2, 2)
    + conv(12)
    + maxpool(2, 2)
    + conv(16)
    + maxpool(2, 2)
    + conv(20)
    + conv(16, 1)
    + conv(24)
    + head(2)
    + yolo("1,2")
    + route("-4")
    + conv(8, 1)
    + upsample()
    + route("-1,4")
    + conv(20)
    + head(2)
    + yolo("0,1"),
    "region-reorg": net()
    + _STEM
    + conv(16)
    + maxpool(2, 2)
    + conv(20)
    + route("2")
    + section("reorg", stride=2)
    + route("-1,-3")
    + conv(16)
    + head()
    + region(),
    "scale-x-y": net() + _STEM + conv(10, activation="mish") + head() + yolo(scale_x_y=1.2),
    "new-coords": net()
    + _STEM
    + conv(10, activation="mish")
    + head(activation="logistic")
    + yolo(scale_x_y=2.0, new_coords=1),
    "squeeze-excite": net() + _STEM + _SQUEEZE + section("scale_channels", from_=1) + conv(8) + head() + yolo(),
}


def write_network(folder: Path, body: str, seed: int = 0, **scaling: float) -> tuple[Path, Path]:
    """A cfg file and random weights for it: paths of both."""
    cfg, weights = folder / "tiny.cfg", folder / "tiny.weights"
    cfg.write_text(body, encoding="utf-8")
    write_random_weights(weights, read_cfg(cfg), seed, **scaling)
    return cfg, weights


def write_random_weights(
    path: Path, config: DarknetConfig, seed: int = 0, *, head_gain: float = 2.0, residual_gain: float = 0.3
) -> None:
    """Random weights whose activations keep about the same spread from layer to layer.

    Args:
        path: the file to write.
        config: the network.
        seed: of the numbers.
        head_gain: how widely the raw outputs spread.
        residual_gain: of a branch that is added to an earlier layer: small, so that many sums do not blow up.
    """
    rng = np.random.default_rng(seed)
    with open(path, "wb") as file:
        file.write(RANDOM_HEADER)
        for layer in config.layers:
            if not isinstance(spec := layer.spec, Convolutional):
                continue
            fan_in = config.input_channels(layer) // spec.groups * spec.size**2
            follower = config.layers[layer.index + 1].spec if layer.index + 1 < len(config.layers) else None
            gain = residual_gain if isinstance(follower, Shortcut) else 1.2 if spec.activation != "linear" else 1.0
            gain *= head_gain if isinstance(follower, Yolo | Region) else 1.0
            parts = [rng.normal(0, 0.2, spec.filters)]
            if spec.batch_normalize:
                parts += [rng.uniform(0.7, 1.3, spec.filters), rng.normal(0, 0.2, spec.filters)]
                parts += [rng.uniform(0.7, 1.3, spec.filters)]
            parts += [rng.normal(0, gain / fan_in**0.5, spec.filters * fan_in)]
            for part in parts:
                file.write(part.astype("<f4").tobytes())
