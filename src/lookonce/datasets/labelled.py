"""The values that every reader gives: labelled objects of a picture, sequences and sets of stills."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import check_array, check_boxes, check_finite

__all__ = ["LAYOUTS", "LabelledFrame", "LabelledObjects", "LabelledSequence", "LabelledStills"]

LAYOUTS = ("motchallenge", "ua-detrac", "kitti", "cvat")


def _check_labels(labels: list[NDArray[np.int64]], classes: tuple[str, ...]) -> None:
    highest = int(np.concatenate(labels).max(initial=-1)) if labels else -1
    if highest >= len(classes):
        raise ValueError(f"labels: expected below {len(classes)}, the number of classes, got {highest}")


@dataclass(frozen=True, slots=True)
class LabelledObjects:
    """What truth says about one picture, checked on construction; row order is the file's.

    Attributes:
        xyxy: (N, 4) float32, px of the original picture, left < right and top < bottom, from 0 at its left top corner;
            cut at the picture's border where its size is known.
        identities: (N,) int64, >= 0. In a sequence one number an object; in stills running numbers over the whole set,
            each box its own.
        labels: (N,) int64, index into the class names.
        visibility: (N,) float32, share of the object that can be seen, 0 to 1; 1 where the format does not say.

    Raises:
        ValueError: a field has another shape, dtype, row count or range, or is not finite.

    >>> len(LabelledObjects.empty())
    0
    """

    xyxy: NDArray[np.float32]
    identities: NDArray[np.int64]
    labels: NDArray[np.int64]
    visibility: NDArray[np.float32]

    def __post_init__(self) -> None:
        check_boxes("xyxy", self.xyxy)
        count = len(self.xyxy)
        check_array("identities", self.identities, (count,), np.int64)
        check_array("labels", self.labels, (count,), np.int64)
        check_array("visibility", self.visibility, (count,), np.float32)
        check_finite("visibility", self.visibility)
        for name, numbers in (("identities", self.identities), ("labels", self.labels)):
            if count and numbers.min() < 0:
                raise ValueError(f"{name}: expected 0 or more, got {numbers.min()}")
        if count and not (self.visibility.min() >= 0 and self.visibility.max() <= 1):
            raise ValueError("visibility: expected shares from 0 to 1, got another number")

    def __len__(self) -> int:
        return len(self.xyxy)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice) -> LabelledObjects:
        """The chosen rows (a mask, indices or a slice), all fields kept aligned."""
        return LabelledObjects(self.xyxy[rows], self.identities[rows], self.labels[rows], self.visibility[rows])

    @classmethod
    def empty(cls) -> LabelledObjects:
        """No objects."""
        return cls(np.zeros((0, 4), np.float32), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.float32))


@dataclass(frozen=True, slots=True)
class LabelledFrame:
    """One frame that has truth.

    Attributes:
        index: the frame's number from 0, as ``lookonce.open_video`` numbers the frames of the sequence's pictures.
        objects: what is in it; 0 rows = truth says that there is nothing.
    """

    index: int
    objects: LabelledObjects

    def __post_init__(self) -> None:
        if self.index < 0:
            raise ValueError(f"index: expected 0 or more, got {self.index}")


@dataclass(frozen=True, slots=True)
class LabelledSequence:
    """A video with truth.

    Attributes:
        name: of the folder or as the file says; unique among the sequences of one call.
        layout: one of ``LAYOUTS``.
        pictures: what ``lookonce.open_video`` takes: a folder of pictures or a video file.
        fps: frames per second of a picture folder, where stated; None for a video, which has its own clock.
        frames: the frames that have truth, by index. Frames without truth are not among them.
        classes: class names by label; the same for all sequences of one call.
        ignored: (M, 4) float32, xyxy in px: regions that do not count in any frame; cut at the picture's border.
        left_out: why -> number of rows of the truth file that were left out.

    Raises:
        ValueError: a field is out of range, or two frames are out of order.
    """

    name: str
    layout: str
    pictures: Path
    fps: float | None
    frames: tuple[LabelledFrame, ...]
    classes: tuple[str, ...]
    ignored: NDArray[np.float32]
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.layout not in LAYOUTS:
            raise ValueError(f"layout: expected one of {', '.join(LAYOUTS)}, got {self.layout}")
        if self.fps is not None and not (self.fps > 0 and math.isfinite(self.fps)):
            raise ValueError(f"fps: expected frames per second > 0, got {self.fps}")
        indices = np.array([frame.index for frame in self.frames], np.int64)
        if (np.diff(indices) <= 0).any():
            raise ValueError("frames: expected each index once and in rising order")
        check_boxes("ignored", self.ignored)
        _check_labels([frame.objects.labels for frame in self.frames], self.classes)


@dataclass(frozen=True, slots=True)
class LabelledStills:
    """Pictures that have nothing to do with each other, with truth.

    Attributes:
        name: of the folder.
        pictures: picture files.
        objects: what is in each of them, in the same order.
        classes: class names by label.
        left_out: why -> number of rows left out; "pictures without labels" counts pictures.

    Raises:
        ValueError: the lengths differ, or a label has no class name.
    """

    name: str
    pictures: tuple[Path, ...]
    objects: tuple[LabelledObjects, ...]
    classes: tuple[str, ...]
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.pictures) != len(self.objects):
            raise ValueError(f"objects: expected {len(self.pictures)}, one a picture, got {len(self.objects)}")
        _check_labels([objects.labels for objects in self.objects], self.classes)
