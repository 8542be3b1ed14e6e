"""Detections on disk: an .npz of plain arrays, every one of them bounded and checked before it is used."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.array_file import read_arrays, write_arrays
from lookonce.compare.detections import DetectedSequence
from lookonce.errors import FormatError
from lookonce.video.opening import one_line

__all__ = ["StoredDetections", "read_detections", "rows_digest", "write_detections"]

_VERSION = 2
_MAX_BYTES = 4_000_000_000  # 8 million rows of 128 values
_DTYPES: dict[str, type] = {
    "version": np.int64,
    "frames": np.int64,
    "times": np.float64,
    "starts": np.int64,
    "xyxy": np.float32,
    "scores": np.float32,
    "labels": np.int64,
    "descriptors": np.float32,
    "match_threshold": np.float64,
    "stage_seconds": np.float64,
    "size": np.int64,
    "camera_score": np.float64,
    "camera_steps": np.int64,
    "camera_rows": np.int64,
    "camera_maps": np.float64,
}
_REMEDY = "remove the file, and it is made again"
_NO_SIZE = (0, 0)  # pictures of unknown size
_MOST_STEPS = 1000  # frame rates at which it is kept how the camera moved


@dataclass(frozen=True, slots=True)
class StoredDetections:
    """Detections with what finding them took.

    Attributes:
        sequence: the detections.
        detect_s: seconds for all frames, letterbox and inference; 0 = not known, as of a detections file.
        describe_s: seconds of a separate description step for all frames; 0 = there was none.
        camera_score: boxes from this score on were not looked into for how the camera moved.
    """

    sequence: DetectedSequence
    detect_s: float = 0.0
    describe_s: float = 0.0
    camera_score: float = 0.0


def rows_digest(sequence: DetectedSequence, others: list[int | str]) -> str:
    """A short name for all rows of a sequence, and for what else is to be told apart."""
    total = hashlib.sha256(json.dumps(others).encode())
    for array in (sequence.times, sequence.starts, sequence.xyxy, sequence.scores):
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()[:16]


def write_detections(path: Path, stored: StoredDetections) -> None:
    """Writes the file in one piece: it is whole or not there.

    Raises:
        OutputError: it cannot be written.
    """
    sequence = stored.sequence
    arrays: dict[str, NDArray[Any]] = {
        "version": np.array(_VERSION, np.int64),
        "frames": sequence.frames,
        "times": sequence.times,
        "starts": sequence.starts,
        "xyxy": sequence.xyxy,
        "scores": sequence.scores,
        "labels": sequence.labels,
        "match_threshold": np.array(sequence.match_threshold),
        "stage_seconds": np.array([stored.detect_s, stored.describe_s]),
        "size": np.array(sequence.size or _NO_SIZE, np.int64),
        "camera_score": np.array(stored.camera_score),
        **_camera_arrays(sequence),
    }
    if sequence.descriptors is not None:
        arrays["descriptors"] = sequence.descriptors
    write_arrays(path, arrays)


def read_detections(path: Path) -> StoredDetections:
    """What ``write_detections`` wrote.

    Raises:
        FormatError: it is something else, damaged, or too large.
    """
    arrays = read_arrays(path, _DTYPES, _MAX_BYTES, _REMEDY)
    missing = [name for name in _DTYPES if name not in arrays and name != "descriptors"]
    if missing or arrays["version"].shape or int(arrays["version"]) != _VERSION:
        raise FormatError(
            one_line(path), 0, f"of another version, or lacks {', '.join(missing) or 'nothing'}; {_REMEDY}"
        )
    try:
        seconds, size, threshold = arrays["stage_seconds"], arrays["size"], arrays["match_threshold"]
        if seconds.shape != (2,) or size.shape != (2,) or threshold.shape or arrays["camera_score"].shape:
            raise ValueError("stage_seconds, size, match_threshold or camera_score: another shape")
        height, width = size.tolist()
        sequence = DetectedSequence(
            arrays["frames"],
            arrays["times"],
            arrays["starts"],
            arrays["xyxy"],
            arrays["scores"],
            arrays["labels"],
            arrays.get("descriptors"),
            float(threshold),
            None if (height, width) == _NO_SIZE else (height, width),
            _cameras(arrays),
        )
    except (ValueError, IndexError, TypeError) as exc:
        raise FormatError(one_line(path), 0, f"holds what cannot be detections ({exc}); {_REMEDY}") from exc
    return StoredDetections(sequence, float(seconds[0]), float(seconds[1]), float(arrays["camera_score"]))


def _camera_arrays(sequence: DetectedSequence) -> dict[str, NDArray[Any]]:
    """The steps that were looked at (S,), and of each map (K, 2, 3) its step and frame (K, 2)."""
    moved = [(step, frame) for step, maps in sequence.cameras.items() for frame in maps]
    return {
        "camera_steps": np.array(list(sequence.cameras), np.int64),
        "camera_rows": np.array(moved, np.int64).reshape(-1, 2),
        "camera_maps": np.array([sequence.cameras[step][frame] for step, frame in moved]).reshape(-1, 2, 3),
    }


def _cameras(arrays: dict[str, NDArray[Any]]) -> dict[int, dict[int, NDArray[np.float64]]]:
    steps, rows, maps = arrays["camera_steps"], arrays["camera_rows"], arrays["camera_maps"]
    if steps.ndim != 1 or rows.shape != (len(maps), 2) or maps.shape[1:] != (2, 3):
        raise ValueError("camera_steps, camera_rows or camera_maps: another shape")
    if len(steps) > _MOST_STEPS or len(rows) > len(steps) * len(arrays["frames"]):
        raise ValueError("camera_steps or camera_rows: more than there can be")
    is_there = np.isin(rows[:, 0], steps) & np.isin(rows[:, 1], arrays["frames"])
    if steps.min(initial=1) < 1 or not is_there.all():
        raise ValueError("camera_steps or camera_rows: of frames that there are not")
    cameras: dict[int, dict[int, NDArray[np.float64]]] = {step: {} for step in steps.tolist()}
    for (step, frame), one in zip(rows.tolist(), maps, strict=True):
        cameras[step][frame] = one
    return cameras
