"""What tests of detector training work with: pictures of coloured rectangles, tiny networks, a watcher."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import torch
from PIL import Image

from darknet_files import conv, net, section
from lookonce.datasets import open_stills
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.layers import DarknetConfig
from lookonce.make.detector.gather import DetectorData
from lookonce.make.detector.samples import Sample
from lookonce.make.detector.settings import DetectorConfig
from lookonce.make.detector.train import DetectorResult, NetworkSource, train_detector
from lookonce.make.detector.views import Opened
from lookonce.make.training.pictures import open_picture
from make.training.scenes import Watcher

SIZE = 64
COLOURS = {"red": (230, 30, 30), "blue": (30, 60, 230)}
NAMES = tuple(COLOURS)
CONFIG = DetectorConfig(
    epochs=4, batch=4, check_every=2, learning_rate=5e-3, average_decay=0.9, warm_up_epochs=1, plain_epochs=1
)
CONFIG = replace(CONFIG, precision="32-true", held_out=0.25)


def one_grid(
    *,
    stride: int = 16,
    anchors: str = "16,16, 30,20, 20,40",
    classes: int = 2,
    size: int = SIZE,
    channels: int = 8,
    **yolo,
) -> str:
    """The cfg of a network of three convolutions or more with one output grid."""
    count = len(anchors.split(",")) // 2
    halvings = stride.bit_length() - 1
    return (
        net(size, size)
        + "".join(conv(channels, 3, 2) for _ in range(halvings))
        + conv(2 * channels)
        + conv(count * (5 + classes), 1, activation="linear", batch_normalize=0)
        + section("yolo", mask=",".join(map(str, range(count))), anchors=anchors, classes=classes, num=count, **yolo)
    )


def two_grids(*, classes: int = 2, **yolo) -> str:
    """Strides 16 and 8 on 64 x 96, in this order, two anchors each."""
    head = conv(2 * (5 + classes), 1, activation="linear", batch_normalize=0)
    output = {"anchors": "8,10, 14,20, 30,24, 40,44", "classes": classes, "num": 4, **yolo}
    return (
        net(64, 96)
        + conv(6, 3, 2)
        + conv(6, 3, 2)
        + conv(8, 3, 2)
        + conv(8, 3, 2)
        + conv(8)
        + head
        + section("yolo", mask="2,3", **output)
        + section("route", layers="2")
        + conv(8)
        + head
        + section("yolo", mask="0,1", **output)
    )


def network_of(folder: Path, body: str) -> DarknetConfig:
    """A network description from cfg text."""
    path = folder / "net.cfg"
    path.write_text(body)
    return read_cfg(path)


def scene(rng: np.random.Generator, size: tuple[int, int] = (SIZE, SIZE)) -> tuple[np.ndarray, list[tuple[int, list]]]:
    """A grey picture with a red and a blue rectangle that do not touch, and (label, xyxy) of each."""
    height, width = size
    image = np.full((height, width, 3), 110, np.uint8) + rng.integers(0, 25, (height, width, 1), np.uint8)
    found = []
    for label, left_half in enumerate(rng.permutation([True, False])):
        w, h = rng.integers(width // 5, width * 2 // 5), rng.integers(height // 5, height // 2)
        x = rng.integers(0, width // 2 - w + 1) + (0 if left_half else width // 2)
        y = rng.integers(0, height - h + 1)
        image[y : y + h, x : x + w] = COLOURS[NAMES[label]]
        found.append((label, [int(x), int(y), int(x + w), int(y + h)]))
    return image, found


def write_rectangles(
    folder: Path,
    count: int = 32,
    seed: int = 0,
    *,
    size: tuple[int, int] = (SIZE, SIZE),
    names: Sequence[str] | None = NAMES,
    labels: Sequence[int] = (0, 1),
) -> Path:
    """Scenes as stills in YOLO's layout; of the objects only those with ``labels`` are labelled."""
    rng = np.random.default_rng(seed)
    (folder / "images").mkdir(parents=True)
    (folder / "labels").mkdir()
    if names is not None:
        (folder / "classes.txt").write_text("\n".join(names))
    height, width = size
    for number in range(count):
        image, found = scene(rng, size)
        Image.fromarray(image).save(folder / "images" / f"{number:03d}.png")
        lines = [
            f"{label} {(x1 + x2) / 2 / width} {(y1 + y2) / 2 / height} {(x2 - x1) / width} {(y2 - y1) / height}\n"
            for label, (x1, y1, x2, y2) in found
            if label in labels
        ]
        (folder / "labels" / f"{number:03d}.txt").write_text("".join(lines))
    return folder


def make_sample(
    picture: Path,
    boxes: Sequence[Sequence[float]] = (),
    labels: Sequence[int] | None = None,
    *,
    ignored: Sequence[Sequence[float]] = (),
    labelled: Sequence[bool] = (True, True),
) -> Sample:
    """A sample of what is known about a picture file."""
    return Sample(
        picture,
        np.array(boxes, np.float32).reshape(-1, 4),
        np.array([0] * len(boxes) if labels is None else labels, np.int64),
        np.array(labelled, np.bool_),
        np.array(ignored, np.float32).reshape(-1, 4),
    )


def opened(sample: Sample, size: tuple[int, int] = (SIZE, SIZE)) -> Opened:
    """A sample's picture as views take it."""
    picture, factor = open_picture(sample.picture, size)
    return Opened(picture, factor, sample)


def data_of(*folders: Path, **more) -> DetectorData:
    """Stills as training data."""
    return DetectorData(tuple(open_stills(folder) for folder in folders), **more)


def run_training(
    source: NetworkSource,
    data: DetectorData,
    output: Path,
    config: DetectorConfig = CONFIG,
    *,
    classes: tuple[str, ...] = NAMES,
    watcher: Watcher | None = None,
    **options,
) -> DetectorResult:
    """``train_detector`` on one CPU, its folder beside the output."""
    return train_detector(
        source,
        data,
        classes,
        output,
        config,
        folder=output.with_suffix(".train"),
        device=options.pop("device", "cpu"),
        threads=options.pop("threads", 1),
        progress=watcher or Watcher(),
        **options,
    )


def quick_look(network, samples, classes, *, threads):
    """In place of a true look, which takes a second: a figure that depends on the weights."""
    value = float(sum(p.double().abs().sum() for p in network.parameters())) % 1
    return SimpleNamespace(mean=SimpleNamespace(ap=value, ap50=value))


def tensor(values, dtype=torch.float32) -> torch.Tensor:
    """Short for a tensor of some rows."""
    return torch.tensor(values, dtype=dtype)
