"""A model's descriptors at boxes that another program found. Needs the extra `describe`, but no PyTorch."""

from __future__ import annotations

import hashlib
import os
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lookonce.boxes import clip
from lookonce.errors import ConfigError
from lookonce.letterbox import Fit, Letterboxer, Pictured
from lookonce.make.descriptors.anchors import rows_of_boxes
from lookonce.model import DescriptorInfo, ModelMetadata, available_cpus
from lookonce.model.model import letterbox_image
from lookonce.models import find_model
from lookonce.structures import has_unit_length

__all__ = ["BoxDescriber"]

_SMALLEST_PX = 4.0  # of the network's input: half a cell of the finest grid, in which there is nothing to read


class BoxDescriber:
    """Reads a model's descriptors at any boxes of a picture, in one pass over the picture.

    >>> describe = BoxDescriber("street")
    >>> boxes = np.array([[10, 10, 50, 90], [700, 0, 720, 40]], np.float32)  # the second lies outside
    >>> np.linalg.norm(describe(np.zeros((480, 640, 3), np.uint8), boxes), axis=1).round(3).tolist()
    [1.0, 0.0]

    Args:
        model: path of a model file with descriptors, or the name of one that ships with the package.
        provider: ``cpu``, ``cuda`` or ``openvino``, where the installed ONNX Runtime has it.
        threads: for one inference; all processors by default.

    Attributes:
        path: the file.
        metadata: what it says about itself.

    Raises:
        ModelError: the file is missing, damaged, or has no descriptors.
        ConfigError: the provider or the extra ``describe`` is not installed.
    """

    def __init__(self, model: str | os.PathLike[str], *, provider: str = "cpu", threads: int | None = None) -> None:
        try:
            from lookonce.make.export.reopen import open_describer
        except ModuleNotFoundError as exc:
            message = f"a model's descriptors at given boxes need the extra 'describe' ({exc.name} is missing)"
            raise ConfigError(f"{message}; pip install 'lookonce[describe]'") from exc
        self.path = find_model(model)
        self._read = open_describer(self.path, provider=provider, threads=threads or available_cpus())
        self.metadata: ModelMetadata = self._read.metadata

    @cached_property
    def sha256(self) -> str:
        """Digest of the file."""
        with open(self.path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    @property
    def descriptor(self) -> DescriptorInfo:
        """What the descriptors are."""
        assert self.metadata.descriptor is not None  # a file without any is not opened
        return self.metadata.descriptor

    @property
    def size(self) -> tuple[int, int]:
        """The network's input (height, width) in px."""
        return self.metadata.size

    def __call__(self, image: NDArray[np.uint8] | Pictured, xyxy: ArrayLike) -> NDArray[np.float32]:
        """Descriptors (N, D) float32, rows of unit length, of N boxes in one picture.

        A box that lies outside the picture or is tiny (below 4 px of the network's input in width or height, what
        lies outside not counted) or not finite has a row of zeros: no descriptor, and a tracker matches it by its box.

        Args:
            image: (H, W, 3) uint8 RGB, or a frame of :func:`lookonce.open_video`.
            xyxy: (N, 4) left, top, right, bottom in px of the picture.

        Raises:
            ValueError: the image or the boxes have another shape.
        """
        with np.errstate(over="ignore"):  # what overflows float32 becomes infinite
            boxes = np.asarray(xyxy, np.float32)
        if boxes.ndim != 2 or boxes.shape[1] != 4:
            raise ValueError(f"xyxy: expected (N, 4) numbers left, top, right, bottom, got {boxes.shape}")
        canvas, placed = letterbox_image(Letterboxer(self.size), image)
        return self.read(canvas, placed, boxes)

    def read(self, canvas: NDArray[np.uint8], placed: Fit, xyxy: NDArray[np.float32]) -> NDArray[np.float32]:
        """The same of boxes (N, 4) float32 in a picture that is letterboxed already.

        Args:
            canvas: (height, width, 3) uint8 RGB of the network's size.
            placed: where the picture lies in it.
            xyxy: (N, 4) float32, px of the picture.
        """
        descriptors = np.zeros((len(xyxy), self.descriptor.size), np.float32)
        boxes = placed.to_network(clip(np.where(np.isfinite(xyxy), xyxy, np.float32(np.nan)), placed.source))
        rows = np.flatnonzero((boxes[:, 2:] - boxes[:, :2] >= _SMALLEST_PX).all(axis=1))
        if len(rows):
            (found,) = self._read(canvas[np.newaxis], rows_of_boxes(self.metadata, boxes[rows])).values()
            is_good = has_unit_length(found)
            descriptors[rows[is_good]] = found[is_good]
        return descriptors
