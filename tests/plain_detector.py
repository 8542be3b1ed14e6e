"""Decoding and suppression written plainly, one anchor at a time: the opposite of the graph, with the same results."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lookonce.make.darknet.layers import DarknetConfig, Region


class PlainDetection(NamedTuple):
    """One row: box xyxy in px of the input, and the output grid, row and column that found it."""

    score: float
    label: int
    box: tuple[float, float, float, float]
    scale: int
    row: int
    column: int


def _sigmoid(x):
    return 1 / (1 + np.exp(-np.float64(x)))


def plain_detections(
    config: DarknetConfig,
    maps: list[np.ndarray],
    score_threshold: float = 0.25,
    iou_threshold: float = 0.45,
    max_detections: int = 1000,
) -> list[PlainDetection]:
    """Detections of one image from its raw maps (C, h, w), best score first."""
    anchors = [anchor for scale, raw in enumerate(maps) for anchor in _decode(config, scale, raw)]
    anchors.sort(key=lambda anchor: -anchor[0])  # by objectness; equal ones stay in place
    found = []
    for label in range(config.classes):
        rows = [(objectness * classes[label], box, where) for objectness, classes, box, where in anchors]
        rows = sorted((row for row in rows if row[0] > score_threshold), key=lambda row: -row[0])
        kept: list[tuple] = []
        for row in rows:
            if len(kept) < max_detections and all(_iou(row[1], other[1]) <= iou_threshold for other in kept):
                kept.append(row)
        found += [PlainDetection(score, label, box, *where) for score, box, where in kept]
    return sorted(found, key=lambda detection: -detection.score)[:max_detections]


def _decode(config: DarknetConfig, scale: int, raw: np.ndarray):
    layer = config.outputs[scale]
    spec, stride = config.output_spec(layer), config.size[0] // layer.height
    values = 5 + spec.classes
    for number, (anchor_width, anchor_height) in enumerate(spec.anchors):
        block = np.float64(raw[number * values : (number + 1) * values])
        for row in range(layer.height):
            for column in range(layer.width):
                x, y, width, height, objectness, *classes = block[:, row, column]
                if isinstance(spec, Region):
                    x, y, objectness = _sigmoid(x), _sigmoid(y), _sigmoid(objectness)
                    width, height = np.exp(width) * anchor_width * stride, np.exp(height) * anchor_height * stride
                    powers = np.exp(np.array(classes) - max(classes))
                    classes = powers / powers.sum()
                elif spec.new_coords:
                    width, height = (2 * width) ** 2 * anchor_width, (2 * height) ** 2 * anchor_height
                else:
                    x, y, objectness = _sigmoid(x), _sigmoid(y), _sigmoid(objectness)
                    width, height = np.exp(width) * anchor_width, np.exp(height) * anchor_height
                    classes = _sigmoid(classes)
                leeway = getattr(spec, "scale_x_y", 1.0)
                x = (column + x * leeway - (leeway - 1) / 2) * stride
                y = (row + y * leeway - (leeway - 1) / 2) * stride
                box = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
                yield objectness, classes, box, (scale, row, column)


def _iou(a, b) -> float:
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0 or height <= 0:
        return 0.0
    both = width * height
    return both / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - both)
