"""Which grid, cell and anchor of a detector a labelled box belongs to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.model.metadata import ModelMetadata

__all__ = ["rows_of_boxes"]


def rows_of_boxes(
    metadata: ModelMetadata, boxes: NDArray[np.float32], image_index: NDArray[np.int64] | None = None
) -> dict[str, NDArray[Any]]:
    """Boxes as rows of detections, as if the detector had found each at the anchor that is responsible for it.

    That is YOLO's rule for training: of all anchors of all grids the one whose shape overlaps the box most, in the cell
    of the box's centre (YOLOv3, section 2.1).

    Args:
        metadata: of the model file.
        boxes: xyxy (N, 4) float32 in px of the network's input.
        image_index: (N,) which picture of the batch; all 0 by default.

    Returns:
        For each field of ``SelectedDetections`` but the labels an array of N values.
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
        "scale": scales[best].astype(np.int64),
        "cell": (row * (width // stride) + column).astype(np.int64),
        "anchor": numbers[best].astype(np.int64),
    }
