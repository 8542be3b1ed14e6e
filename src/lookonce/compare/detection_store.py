"""Detections on disk: an .npz of plain arrays, every one of them bounded and checked before it is used."""

from __future__ import annotations

import io
import os
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.detections import DetectedSequence
from lookonce.errors import FormatError, OutputError
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


@dataclass(frozen=True, slots=True)
class StoredDetections:
    """Detections with what finding them took.

    Attributes:
        sequence: the detections.
        detect_s: seconds for all frames, letterbox and inference; 0 = not known, as of a detections file.
        describe_s: seconds of a separate description step for all frames; 0 = there was none.
        size: (height, width) in px of the pictures; (0, 0) = not known.
    """

    sequence: DetectedSequence
    detect_s: float = 0.0
    describe_s: float = 0.0
    size: tuple[int, int] = (0, 0)


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
        "size": np.array(stored.size, np.int64),
    }
    if sequence.descriptors is not None:
        arrays["descriptors"] = sequence.descriptors
    draft = path.with_suffix(f".{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with draft.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        draft.replace(path)
    except OSError as exc:
        with suppress(OSError):
            draft.unlink()
        raise OutputError(f"{one_line(path)}: cannot be written ({exc.strerror}); choose another folder") from exc


def read_detections(path: Path) -> StoredDetections:
    """What ``write_detections`` wrote.

    Raises:
        FormatError: it is something else, damaged, or too large.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = {name: _array(path, archive, name) for name in _names(path, archive)}
    except (zipfile.BadZipFile, NotImplementedError, EOFError, OSError) as exc:
        raise FormatError(one_line(path), 0, f"no file of detections ({exc}); {_REMEDY}") from exc
    missing = [name for name in _DTYPES if name not in arrays and name != "descriptors"]
    if missing or arrays["version"].shape or int(arrays["version"]) != _VERSION:
        raise FormatError(
            one_line(path), 0, f"of another version, or lacks {', '.join(missing) or 'nothing'}; {_REMEDY}"
        )
    try:
        seconds, size, threshold = arrays["stage_seconds"], arrays["size"], arrays["match_threshold"]
        if seconds.shape != (2,) or size.shape != (2,) or threshold.shape != ():
            raise ValueError("stage_seconds, size or match_threshold: another shape")
        sequence = DetectedSequence(
            arrays["frames"],
            arrays["times"],
            arrays["starts"],
            arrays["xyxy"],
            arrays["scores"],
            arrays["labels"],
            arrays.get("descriptors"),
            float(threshold),
        )
    except (ValueError, IndexError) as exc:
        raise FormatError(one_line(path), 0, f"holds what cannot be detections ({exc}); {_REMEDY}") from exc
    height, width = size.tolist()
    return StoredDetections(sequence, float(seconds[0]), float(seconds[1]), (height, width))


def _names(path: Path, archive: zipfile.ZipFile) -> list[str]:
    """The arrays of the archive, all of them known and together not too large."""
    members = archive.infolist()
    names = [member.filename.removesuffix(".npy") for member in members]
    if len(set(names)) < len(names) or not set(names) <= _DTYPES.keys():
        raise FormatError(one_line(path), 0, f"holds other arrays than detections have; {_REMEDY}")
    if sum(member.file_size for member in members) > _MAX_BYTES:
        raise FormatError(one_line(path), 0, f"larger than {_MAX_BYTES // 1_000_000_000} GB; {_REMEDY}")
    return names


def _array(path: Path, archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """One array, of the dtype that it should have, whose header promises no more than there is."""
    member = archive.getinfo(f"{name}.npy")
    data = io.BytesIO(archive.read(member))  # no more than file_size, or zipfile refuses
    try:
        if np.lib.format.read_magic(data) != (1, 0):
            raise ValueError("another version of .npy")
        shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(cast("IO[bytes]", data))
        values = np.frombuffer(data.getbuffer()[data.tell() :], np.uint8)
        if is_fortran or dtype != np.dtype(_DTYPES[name]) or len(shape) > 2:
            raise ValueError(f"expected {np.dtype(_DTYPES[name]).name}, got {dtype}")
        return values.view(dtype).reshape(shape).copy()
    except ValueError as exc:
        raise FormatError(one_line(path), 0, f"array {name}: {exc}; {_REMEDY}") from exc
