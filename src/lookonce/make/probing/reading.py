"""Whose boxes are described: those of the truth, or those that the detector itself finds for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import iou
from lookonce.errors import ConfigError, ModelError
from lookonce.evaluation.retrieval.objects import GRID_STEP
from lookonce.letterbox import Fit
from lookonce.make.descriptors.anchors import rows_of_boxes
from lookonce.make.export.model_file import DESCRIPTORS
from lookonce.make.export.reopen import RowReader, open_describer
from lookonce.model import Model, ModelMetadata, available_cpus

__all__ = ["BOXES", "BoxReader", "DetectionReader", "SeenBoxes", "TruthReader", "open_reader", "pair_by_overlap"]

BOXES = ("truth", "detections")
_LEAST_OVERLAP = 0.5  # intersection over union of a truth box and a detection that is taken for it


@dataclass(frozen=True, slots=True)
class SeenBoxes:
    """Truth boxes of one frame as the model sees them; M of them.

    Attributes:
        rows: (M,) int64, rows of the truth, each at most once.
        xyxy: (M, 4) float32, the described boxes in px of the picture.
        descriptors: (M, D) float32, rows of unit length; a row of zeros = no descriptor.
        grids: (M,) int64, as in ``DescribedObjects``: of the anchor that is responsible for the box by YOLO's rule.
    """

    rows: NDArray[np.int64]
    xyxy: NDArray[np.float32]
    descriptors: NDArray[np.float32]
    grids: NDArray[np.int64]

    def __getitem__(self, rows: NDArray[np.int64]) -> SeenBoxes:
        """The chosen rows, all fields kept aligned."""
        return SeenBoxes(self.rows[rows], self.xyxy[rows], self.descriptors[rows], self.grids[rows])


class BoxReader(Protocol):
    """Describes the truth boxes of a frame, or what stands for them."""

    @property
    def path(self) -> Path:
        """The model file."""
        ...

    @property
    def metadata(self) -> ModelMetadata:
        """What it says about itself."""
        ...

    def __call__(
        self, canvas: NDArray[np.uint8], placed: Fit, xyxy: NDArray[np.float32], labels: NDArray[np.int64]
    ) -> SeenBoxes:
        """What is seen of N truth boxes.

        Args:
            canvas: (H, W, 3) uint8 RGB of the network's size.
            placed: where the picture lies in it.
            xyxy: (N, 4) float32, truth boxes in px of the picture.
            labels: (N,) int64, their classes as the model's labels; ``UNKNOWN_CLASS`` where it has no such class.
        """
        ...


def open_reader(
    path: Path, boxes: str = "truth", *, score: float = 0.1, provider: str = "cpu", threads: int | None = None
) -> BoxReader:
    """What describes the boxes of labelled sequences.

    Args:
        path: a model file.
        boxes: ``truth``: at the truth boxes, whatever the detector finds; ``detections``: at the detections that
            overlap truth boxes by half or more, which is what a tracker will see.
        score: detections above this score are kept.
        provider: ``cpu`` or ``cuda``.
        threads: for one inference; all processors by default.

    Raises:
        ModelError: the model file is damaged or has no descriptors.
        ConfigError: a setting cannot work.
    """
    if boxes not in BOXES:
        raise ConfigError(f"boxes '{boxes}': expected {' or '.join(BOXES)}")
    if boxes == "truth":
        return TruthReader.open(path, provider=provider, threads=threads)
    return DetectionReader(Model(path, provider=provider, threads=threads, score_threshold=score))


class TruthReader:
    """Reads the descriptors at the truth boxes themselves."""

    def __init__(self, describer: RowReader) -> None:
        self._describer = describer

    @classmethod
    def open(cls, path: Path, *, provider: str = "cpu", threads: int | None = None) -> TruthReader:
        """On a model file; raises ``ModelError`` for one without descriptors."""
        return cls(open_describer(path, provider=provider, threads=threads or available_cpus()))

    @property
    def path(self) -> Path:
        """The model file."""
        return self._describer.path

    @property
    def metadata(self) -> ModelMetadata:
        """What it says about itself."""
        return self._describer.metadata

    def __call__(
        self, canvas: NDArray[np.uint8], placed: Fit, xyxy: NDArray[np.float32], labels: NDArray[np.int64]
    ) -> SeenBoxes:
        """All N boxes, in their order."""
        boxes = rows_of_boxes(self.metadata, placed.to_network(xyxy), labels=labels)
        descriptors = self._describer(canvas[np.newaxis], boxes)[DESCRIPTORS]
        return SeenBoxes(np.arange(len(xyxy)), xyxy, descriptors, _grids(boxes))


class DetectionReader:
    """Reads the descriptors of the model's own detections, each given to the truth box that it overlaps."""

    def __init__(self, model: Model) -> None:
        if model.metadata.descriptor is None:
            raise ModelError(f"{model.path}: has no descriptors; train some with 'lookonce fit'")
        self._model = model

    @property
    def path(self) -> Path:
        """The model file."""
        return self._model.path

    @property
    def metadata(self) -> ModelMetadata:
        """What it says about itself."""
        return self._model.metadata

    def __call__(
        self, canvas: NDArray[np.uint8], placed: Fit, xyxy: NDArray[np.float32], labels: NDArray[np.int64]
    ) -> SeenBoxes:
        """The truth boxes that were found, in their order; each is read as the class that it was found as."""
        (found,) = self._model.run(canvas[np.newaxis], [placed])
        rows, partners = pair_by_overlap(xyxy, found.xyxy)
        assert found.descriptors is not None  # the model has some
        boxes = found.xyxy[partners]
        grids = _grids(rows_of_boxes(self.metadata, placed.to_network(boxes)))
        return SeenBoxes(rows, boxes, found.descriptors[partners], grids)


def _grids(rows: Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
    grids: NDArray[np.int64] = rows["scale"] * GRID_STEP + rows["anchor"]
    return grids


def pair_by_overlap(
    truth: NDArray[np.float32], found: NDArray[np.float32], least: float = _LEAST_OVERLAP
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Truth boxes and detections that belong together: the largest overlap first, each box once.

    Args:
        truth: xyxy (N, 4).
        found: xyxy (M, 4).
        least: smallest intersection over union.

    Returns:
        Rows of ``truth`` (P,) int64, rising, and their rows of ``found`` (P,) int64.

    >>> boxes = np.array([[0, 0, 4, 4], [1, 0, 5, 4]], np.float32)
    >>> pair_by_overlap(boxes, boxes[1:])
    (array([1]), array([0]))
    """
    overlap = iou(truth, found)
    partner: dict[int, int] = {}
    for place in np.argsort(-overlap, axis=None, kind="stable").tolist():
        row, column = divmod(place, len(found))
        if overlap[row, column] < least:
            break
        if row not in partner and column not in partner.values():
            partner[row] = column
    rows = sorted(partner)
    return np.array(rows, np.int64), np.array([partner[row] for row in rows], np.int64)
