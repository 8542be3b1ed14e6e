"""Descriptors from a second network, run on every cut-out box: what reading the detector's features saves."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.compare.detection_store import StoredDetections, read_detections, write_detections
from lookonce.errors import ModelError
from lookonce.model.onnx_file import read_metadata
from lookonce.model.session import open_session, run_session
from lookonce.video import open_video

__all__ = ["CROP_SIZE", "METADATA_KEY", "CropDescriber", "cut_out", "describe_crops"]

CROP_SIZE = 64
METADATA_KEY = "lookonce-crops"

_SMALLEST_PX = 1.0
_TWICE = 2.0  # scaling down goes by averaging to this, then bilinear: as good, and much faster for large boxes


def cut_out(image: NDArray[np.uint8], xyxy: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Boxes (N, 4) of an RGB image (H, W, 3) as (N, 64, 64, 3), stretched to that size; cut at the border."""
    height, width = image.shape[:2]
    picture = Image.fromarray(image)
    crops = np.zeros((len(xyxy), CROP_SIZE, CROP_SIZE, 3), np.uint8)
    for row, box in enumerate(np.clip(xyxy, 0, [width, height, width, height]).tolist()):
        left, top = min(box[0], width - _SMALLEST_PX), min(box[1], height - _SMALLEST_PX)
        place = (left, top, max(box[2], left + _SMALLEST_PX), max(box[3], top + _SMALLEST_PX))
        small = picture.resize((CROP_SIZE, CROP_SIZE), Image.Resampling.BILINEAR, box=place, reducing_gap=_TWICE)
        crops[row] = np.asarray(small)
    return crops


class CropDescriber:
    """The trained network, as `lookonce fit-crops` writes it.

    Args:
        path: the ONNX file.
        threads: for one inference.

    Attributes:
        sha256: digest of the file.
        match_threshold: calibrated, largest distance of one object's descriptors.

    Raises:
        ModelError: it is missing, damaged, or something else.
    """

    def __init__(self, path: Path, threads: int) -> None:
        self.path = path
        try:
            about = json.loads(read_metadata(path)[METADATA_KEY])
            threshold = float(about["match_threshold"])
            if about["format"] != 1 or not (math.isfinite(threshold) and 0 < threshold <= 2):
                raise ValueError("other contents")
        except (KeyError, TypeError, ValueError, RecursionError) as exc:
            raise ModelError(f"{path}: no crop network of lookonce; make one with 'lookonce fit-crops'") from exc
        self.match_threshold = threshold
        self.sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
        self._session = open_session(path, "cpu", threads)

    def __call__(self, image: NDArray[np.uint8], xyxy: NDArray[np.float32]) -> NDArray[np.float32]:
        """Descriptors (N, D) of the boxes (N, 4) of an RGB image, of unit length or zero."""
        if not len(xyxy):
            return np.zeros((0, 0), np.float32)
        (found,) = run_session(self.path, self._session, {"images": cut_out(image, xyxy)}, ["descriptors"])
        if found.ndim != 2 or len(found) != len(xyxy) or found.dtype != np.float32:
            raise ModelError(f"{self.path}: its descriptors are {found.shape} {found.dtype}; make it again")
        length = np.linalg.norm(found, axis=1, keepdims=True)
        is_good = np.isfinite(length) & (length > 0)
        units: NDArray[np.float32] = np.divide(found, length, out=np.zeros_like(found), where=is_good)
        return units


def describe_crops(
    path: Path,
    stored: StoredDetections,
    pictures: Path,
    describer: CropDescriber,
    fps: float | None,
    min_score: float,
    report: Callable[[int, int | None], None],
) -> StoredDetections:
    """The same detections with the network's descriptors, from ``path`` where they are kept.

    Args:
        path: see ``crops_file``.
        stored: the detections.
        pictures: that they were found in.
        describer: the network.
        fps: of a folder of pictures.
        min_score: boxes below this are not described; their descriptors are zero.
        report: told how many frames are done, of how many.
    """
    if path.exists():
        return read_detections(path)
    frames = {frame.index: frame.detections for frame in stored.sequence}
    parts: dict[int, NDArray[np.float32]] = {}
    seconds = 0.0
    with open_video(pictures, fps=fps) as video:
        for frame in video:
            found = frames.get(frame.index)
            if found is not None and len(found):
                image = frame.image
                start = time.perf_counter()
                rows = found.scores >= np.float32(min_score)
                described = describer(image, found.xyxy[rows])
                parts[frame.index] = _spread(described, rows)
                seconds += time.perf_counter() - start
            report(frame.index + 1, video.frame_count)
    size = max((part.shape[1] for part in parts.values()), default=1)
    none = np.zeros((0, size), np.float32)
    ordered = [_widened(parts.get(index, none), len(found), size) for index, found in frames.items()]
    sequence = replace(
        stored.sequence, descriptors=np.concatenate([none, *ordered]), match_threshold=describer.match_threshold
    )
    described_all = replace(stored, sequence=sequence, describe_s=seconds)
    write_detections(path, described_all)
    return described_all


def _spread(described: NDArray[np.float32], rows: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Descriptors of the chosen rows among zeros for the others."""
    every = np.zeros((len(rows), described.shape[1]), np.float32)
    every[rows] = described
    return every


def _widened(part: NDArray[np.float32], count: int, size: int) -> NDArray[np.float32]:
    """A frame's descriptors (count, size); zeros where nothing was described."""
    return part if part.shape == (count, size) else np.zeros((count, size), np.float32)
