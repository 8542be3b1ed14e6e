"""A model file that runs: picture in, detections with descriptors out."""

from __future__ import annotations

import difflib
import hashlib
import os
import threading
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import clip
from lookonce.errors import ConfigError, ModelError
from lookonce.letterbox import Fit, Letterboxer, Pictured
from lookonce.model.metadata import METADATA_KEY, ModelMetadata
from lookonce.model.onnx_file import read_metadata
from lookonce.model.session import available_cpus, open_session, run_session
from lookonce.models import find_model
from lookonce.structures import Detections, has_unit_length

__all__ = ["Model", "describe_model", "letterbox_image"]


def describe_model(path: Path) -> ModelMetadata:
    """What a model file says about itself, without running it.

    Raises:
        ModelError: it is not a model file of this version, or unsafe.
    """
    properties = read_metadata(path)
    if METADATA_KEY not in properties:
        raise ModelError(f"{path}: an ONNX file, but not made by lookonce; make one with 'lookonce import'")
    return ModelMetadata.from_json(str(path), properties[METADATA_KEY])


class Model:
    """A detector with descriptors, opened from a model file.

    Args:
        model: path of a model file, or the name of one that ships with the package.
        provider: ``cpu``, ``cuda`` or ``openvino``, where the installed ONNX Runtime has it.
        threads: threads for one inference; all processors by default.
        score_threshold: detections above this score are kept.
        iou_threshold: of two boxes of one class that overlap more, the weaker is dropped.
        max_detections: at most so many for a picture, the best ones.

    Attributes:
        path: the file.
        metadata: what the file says about itself.
        dropped_rows: how many detections were left out so far because their numbers were not finite.

    Raises:
        ModelError: the file is missing, damaged, unsafe, not ours or of another version.
        ConfigError: a setting is out of range, or the provider is not installed.
    """

    def __init__(
        self,
        model: str | os.PathLike[str],
        *,
        provider: str = "cpu",
        threads: int | None = None,
        score_threshold: float = 0.25,
        iou_threshold: float = 0.45,
        max_detections: int = 1000,
    ) -> None:
        if threads is not None and not 1 <= threads <= 1024:
            raise ConfigError(f"threads={threads}: expected 1 to 1024")
        for name, value in (("score_threshold", score_threshold), ("iou_threshold", iou_threshold)):
            if not 0 <= value <= 1:
                raise ConfigError(f"{name}={value}: expected 0 to 1")
        if max_detections < 1:
            raise ConfigError(f"max_detections={max_detections}: expected at least 1")
        self.path = find_model(model)
        self.metadata = describe_model(self.path)
        self.provider = provider
        self.threads = threads or available_cpus()
        self.score_threshold = score_threshold
        self.iou_threshold = iou_threshold
        self.max_detections = max_detections
        self.dropped_rows = 0
        self._counting = threading.Lock()  # several threads may use one model
        self._session = open_session(self.path, provider, self.threads)
        self._outputs = ["image_index", "boxes", "scores", "labels"]
        if self.metadata.descriptor is not None:
            self._outputs.append("descriptors")
        self._check_interface()
        self._thresholds: dict[str, NDArray[Any]] = {
            "score_threshold": np.array(score_threshold, np.float32),
            "iou_threshold": np.array(iou_threshold, np.float32),
            "max_detections": np.array(max_detections, np.int64),
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Class names, by label."""
        return self.metadata.names

    @property
    def size(self) -> tuple[int, int]:
        """The network's input (height, width) in px."""
        return self.metadata.size

    @cached_property
    def sha256(self) -> str:
        """Digest of the model file."""
        with open(self.path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def labels_of(self, classes: Sequence[str | int]) -> NDArray[np.int64]:
        """Labels (C,) int64 of classes given by name or number.

        Raises:
            ConfigError: a class is not in the model; the nearest ones are named.
        """
        by_name = {name: label for label, name in enumerate(self.names)}
        labels = []
        for wanted in classes:
            text = str(wanted).strip()
            if text in by_name:
                labels.append(by_name[text])
            elif text.isdecimal() and int(text) < len(self.names):
                labels.append(int(text))
            else:
                near = difflib.get_close_matches(text, self.names, n=1)
                known = ", ".join(self.names[:12]) + (", ..." if len(self.names) > 12 else "")
                hint = f"did you mean {near[0]}?" if near else f"it has {known}"
                raise ConfigError(f"class '{text}' is not in {self.path}; {hint}")
        return np.array(sorted(set(labels)), np.int64)

    def detect(self, image: NDArray[np.uint8] | Pictured) -> Detections:
        """What the detector sees in one picture; boxes in its px, cut at its border.

        Args:
            image: (H, W, 3) uint8 RGB; or a frame of :func:`lookonce.open_video`, which is scaled as its decoder gave
                it: faster, and exactly what :func:`lookonce.track` sees.
        """
        return self.detect_batch([image])[0]

    def detect_batch(self, images: Sequence[NDArray[np.uint8] | Pictured]) -> list[Detections]:
        """One :class:`Detections` for each image or frame, in order; they may differ in size.

        The result for an image does not depend on the others in the batch.

        Raises:
            ValueError: an image is not (H, W, 3) uint8.
        """
        if not images:
            return []
        letterbox = Letterboxer(self.size)  # its tables belong to one thread, and cost little beside a network
        canvases, fits = zip(*(letterbox_image(letterbox, image) for image in images), strict=True)
        return self.run(np.stack(canvases), fits)

    def run(self, canvases: NDArray[np.uint8], fits: Sequence[Fit]) -> list[Detections]:
        """Detections in pictures that are letterboxed already.

        Args:
            canvases: (B, height, width, 3) uint8 RGB of the network's size.
            fits: where each picture lies in its canvas.

        Returns:
            B results; boxes in px of the source pictures, cut at their borders.
        """
        feed = {"images": canvases, **self._thresholds}
        outputs = run_session(self.path, self._session, feed, self._outputs)
        image_index, boxes, scores, labels = outputs[:4]
        descriptors = outputs[4] if len(outputs) > 4 else None
        results = []
        for index, placed in enumerate(fits):
            rows = image_index == index
            results.append(
                self._to_detections(
                    placed, boxes[rows], scores[rows], labels[rows], None if descriptors is None else descriptors[rows]
                )
            )
        return results

    def _to_detections(
        self,
        placed: Fit,
        boxes: NDArray[np.float32],
        scores: NDArray[np.float32],
        labels: NDArray[np.int64],
        descriptors: NDArray[np.float32] | None,
    ) -> Detections:
        """Rows in px of the source picture; what cannot be a detection is left out and counted."""
        is_finite = np.isfinite(boxes).all(axis=1) & np.isfinite(scores)
        xyxy = clip(placed.to_source(boxes), placed.source)
        is_inside = (xyxy[:, 2:] > xyxy[:, :2]).all(axis=1)
        if not is_finite.all():
            with self._counting:
                self.dropped_rows += int(np.count_nonzero(~is_finite))
        rows = is_finite & is_inside
        if descriptors is not None:
            descriptors = descriptors[rows]
            descriptors[~has_unit_length(descriptors)] = 0  # a zero row says: no descriptor
        return Detections(xyxy[rows], scores[rows], labels[rows], descriptors)

    def _check_interface(self) -> None:
        height, width = self.metadata.size
        try:
            inputs = {value.name: (value.type, list(value.shape)) for value in self._session.get_inputs()}
            known = inputs.keys() | {value.name for value in self._session.get_overridable_initializers()}
            outputs = {value.name: list(value.shape) for value in self._session.get_outputs()}
        except UnicodeDecodeError as exc:
            raise ModelError(f"{self.path}: its inputs or outputs have damaged names; make it again") from exc
        expected = {"images", "score_threshold", "iou_threshold", "max_detections"}
        if not (expected <= known and set(self._outputs) <= outputs.keys()):
            raise ModelError(f"{self.path}: lacks inputs or outputs that its description promises; make it again")
        kind, shape = inputs.get("images", ("", []))
        if kind != "tensor(uint8)" or shape[1:] != [height, width, 3]:
            raise ModelError(f"{self.path}: its input is {shape} {kind}, not as described; make it again")
        descriptor = self.metadata.descriptor
        if descriptor is not None and outputs["descriptors"][1:] != [descriptor.size]:
            raise ModelError(
                f"{self.path}: its descriptors are {outputs['descriptors']}, not as described; make it again"
            )


def letterbox_image(letterbox: Letterboxer, image: NDArray[np.uint8] | Pictured) -> tuple[NDArray[np.uint8], Fit]:
    """A picture, or a frame as its decoder gave it, as the network wants it, and where it lies there.

    Raises:
        ValueError: it is neither a frame nor (H, W, 3) uint8.
    """
    if isinstance(image, Pictured):
        return letterbox(image.picture, image.rotation)
    if not isinstance(image, np.ndarray):
        raise ValueError(f"image: expected (H, W, 3) uint8 RGB or a frame, got {type(image).__name__}")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ValueError(f"image: expected (H, W, 3) uint8 RGB with pixels, got {image.shape} {image.dtype}")
    return letterbox(image)
