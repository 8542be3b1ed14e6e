"""Which grid, cell, anchor and class of a detector a labelled box belongs to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.model.metadata import ModelMetadata

__all__ = ["PEOPLE_CLASSES", "TWO_WHEELER_CLASSES", "UNKNOWN_CLASS", "labels_of_names", "rows_of_boxes"]

PEOPLE_CLASSES = frozenset(("person", "pedestrian", "people"))
"""Names of classes, in small letters, whose objects are people."""
TWO_WHEELER_CLASSES = frozenset(("bicycle", "bike", "motorcycle", "motorbike", "cyclist", "rider"))
"""The same of those that carry a person, whom detectors take for either from frame to frame."""
UNKNOWN_CLASS = -1
"""The label of a given box of which nobody says what it is: then it has the class that the detector sees there."""


def rows_of_boxes(
    metadata: ModelMetadata,
    boxes: NDArray[np.float32],
    image_index: NDArray[np.int64] | None = None,
    labels: NDArray[np.int64] | None = None,
) -> dict[str, NDArray[Any]]:
    """Boxes as rows of detections, as if the detector had found each at the anchor that is responsible for it.

    That is YOLO's rule for training: of all anchors of all grids the one whose shape overlaps the box most, in the cell
    of the box's centre (YOLOv3, section 2.1).

    Args:
        metadata: of the model file.
        boxes: xyxy (N, 4) float32 in px of the network's input.
        image_index: (N,) which picture of the batch; all 0 by default.
        labels: (N,) by the model's own class names, or ``UNKNOWN_CLASS``; all of them by default.

    Returns:
        For each field of ``SelectedDetections`` an array of N values.
    """
    count = len(boxes)
    sizes = boxes[:, 2:] - boxes[:, :2]
    anchors = np.array([anchor for grid in metadata.outputs for anchor in grid.anchors_px], np.float32)
    scales = np.repeat(np.arange(len(metadata.outputs)), [len(grid.anchors_px) for grid in metadata.outputs])
    numbers = np.concatenate([np.arange(len(grid.anchors_px)) for grid in metadata.outputs])
    common = np.minimum(sizes[:, None], anchors).prod(axis=2)  # (N, A)
    best = (common / (sizes.prod(axis=1)[:, None] + anchors.prod(axis=1) - common)).argmax(axis=1)
    strides = np.array([grid.stride_px for grid in metadata.outputs])
    stride = strides[scales[best]]
    height, width = metadata.size
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    column = np.clip(centre[:, 0] // stride, 0, width // stride - 1)
    row = np.clip(centre[:, 1] // stride, 0, height // stride - 1)
    return {
        "image_index": np.zeros(count, np.int64) if image_index is None else image_index,
        "boxes": boxes,
        "scores": np.ones(count, np.float32),
        "labels": np.full(count, UNKNOWN_CLASS, np.int64) if labels is None else labels,
        "scale": scales[best].astype(np.int64),
        "cell": (row * (width // stride) + column).astype(np.int64),
        "anchor": numbers[best].astype(np.int64),
    }


def labels_of_names(metadata: ModelMetadata, names: Sequence[str]) -> NDArray[np.int64]:
    """Somebody's classes as a model's labels, (classes,); ``UNKNOWN_CLASS`` where it has no class of that name.

    Capitals do not matter, and all names of people are one. Where several fit, the model's first is taken.
    """
    known = {_common_name(name): label for label, name in reversed(list(enumerate(metadata.names)))}
    return np.array([known.get(_common_name(name), UNKNOWN_CLASS) for name in names], np.int64)


def _common_name(name: str) -> str:
    return "person" if name.lower() in PEOPLE_CLASSES else name.lower()
