"""Detections on disk: an .npz of plain arrays, every one of them bounded and checked before it is used."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.array_file import read_arrays, write_arrays
from lookonce.compare.detections import DetectedSequence
from lookonce.errors import FormatError
from lookonce.video.opening import one_line

__all__ = ["StoredDetections", "read_detections", "write_detections"]

_VERSION = 1
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
}
_REMEDY = "remove the file, and it is made again"
_NO_SIZE = (0, 0)  # pictures of unknown size


@dataclass(frozen=True, slots=True)
class StoredDetections:
    """Detections with what finding them took.

    Attributes:
        sequence: the detections.
        detect_s: seconds for all frames, letterbox and inference; 0 = not known, as of a detections file.
        describe_s: seconds of a separate description step for all frames; 0 = there was none.
    """

    sequence: DetectedSequence
    detect_s: float = 0.0
    describe_s: float = 0.0


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
        if seconds.shape != (2,) or size.shape != (2,) or threshold.shape != ():
            raise ValueError("stage_seconds, size or match_threshold: another shape")
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
        )
    except (ValueError, IndexError) as exc:
        raise FormatError(one_line(path), 0, f"holds what cannot be detections ({exc}); {_REMEDY}") from exc
    return StoredDetections(sequence, float(seconds[0]), float(seconds[1]))
