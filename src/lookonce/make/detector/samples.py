"""Training pictures with what is known about them, transformed and batched."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["Batch", "Sample", "View", "collate"]


@dataclass(frozen=True, slots=True)
class Sample:
    """A picture file and its objects.

    Attributes:
        picture: file.
        xyxy: (N, 4) float32, px of the upright file.
        labels: (N,) int64.
        labelled: (C,) bool: classes whose every object is labelled here. Of the others an unlabelled object is no
            negative.
        ignored: (M, 4) float32, xyxy: regions about which nothing is known.
    """

    picture: Path
    xyxy: NDArray[np.float32]
    labels: NDArray[np.int64]
    labelled: NDArray[np.bool_]
    ignored: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class View:
    """A canvas of the network's size made of one picture or of four.

    Attributes:
        canvas: (H, W, 3) uint8 RGB.
        xyxy: (N, 4) float32, px of the canvas.
        labels: (N,) int64.
        ignored: (M, 4) float32, xyxy.
        split: (2,) float32, column and row where the four quarters meet.
        labelled: (4, C) bool, of the quarters: left top, right top, left bottom, right bottom.
    """

    canvas: NDArray[np.uint8]
    xyxy: NDArray[np.float32]
    labels: NDArray[np.int64]
    ignored: NDArray[np.float32]
    split: NDArray[np.float32]
    labelled: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Batch:
    """B views; boxes of all of them in one list.

    Attributes:
        canvases: (B, H, W, 3) uint8.
        xyxy: (T, 4) float32; labels: (T,) int64; image: (T,) int64, the view each is in.
        ignored: (I, 4) float32; ignored_image: (I,) int64.
        split: (B, 2) float32; labelled: (B, 4, C) bool.
    """

    canvases: NDArray[np.uint8]
    xyxy: NDArray[np.float32]
    labels: NDArray[np.int64]
    image: NDArray[np.int64]
    ignored: NDArray[np.float32]
    ignored_image: NDArray[np.int64]
    split: NDArray[np.float32]
    labelled: NDArray[np.bool_]


def collate(views: list[View]) -> Batch:
    """One batch of some views."""
    return Batch(
        canvases=np.stack([view.canvas for view in views]),
        xyxy=np.concatenate([view.xyxy for view in views]),
        labels=np.concatenate([view.labels for view in views]),
        image=np.repeat(np.arange(len(views)), [len(view.xyxy) for view in views]),
        ignored=np.concatenate([view.ignored for view in views]),
        ignored_image=np.repeat(np.arange(len(views)), [len(view.ignored) for view in views]),
        split=np.stack([view.split for view in views]),
        labelled=np.stack([view.labelled for view in views]),
    )
