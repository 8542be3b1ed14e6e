"""Detections that others have published: MOTChallenge's det.txt, and UA-DETRAC's files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lookonce.boxes import FARTHEST_PX
from lookonce.compare.detection_store import rows_digest
from lookonce.compare.detections import DEFAULT_FPS, DetectedSequence
from lookonce.datasets.text import fault, read_table, whole
from lookonce.datasets.track_rows import MAX_FRAMES
from lookonce.errors import ConfigError
from lookonce.video.opening import one_line

__all__ = ["find_detection_file", "given_file", "read_detection_file"]

_FORMAT = 2  # raised where other detections, or other motion of the camera, come of the same file

_COLUMNS = "frame, number, left, top, width, height, score"
_SCORE = 6


def find_detection_file(place: Path, name: str) -> Path:
    """The file of sequence ``name``: ``place`` itself, or in this folder NAME.txt, NAME_Det_SOMETHING.txt or NAME/det.

    Raises:
        ConfigError: there is none, or there are several.
    """
    if place.is_file():
        return place
    plain = [place / f"{name}.txt", place / name / "det" / "det.txt", place / "det" / "det.txt", place / "det.txt"]
    found = [path for path in plain[:2] if path.is_file()] or sorted(place.glob(f"{_escaped(name)}_Det_*.txt"))
    found = found or [path for path in plain[2:] if path.is_file()]
    if len(found) != 1:
        what = "no detections" if not found else f"{len(found)} files of detections"
        expected = f"expected one {name}.txt, {name}_Det_*.txt or {name}/det/det.txt"
        raise ConfigError(f"{one_line(place)}: {what} of sequence {one_line(name)}; {one_line(expected)}")
    return found[0]


def _escaped(name: str) -> str:
    """``name`` as a pattern that fits only itself."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)


def given_file(folder: Path, name: str, pictures: str, sequence: DetectedSequence) -> Path:
    """Where detections of a text file are kept in the form that trackers' processes read.

    The name changes with them and with ``pictures``, their ``fingerprint_of``.
    """
    key = rows_digest(sequence, [_FORMAT, pictures])
    return folder / f"{name}-given-{key}.npz"


def read_detection_file(path: Path, frame_count: int | None, fps: float | None) -> DetectedSequence:
    """Detections of one sequence, a line each: ``frame, number, left, top, width, height, score``.

    Frames count from 1 in the file. Scores that are no probabilities, as those of DPM and ACF, are moved to 0 to 1: all
    of the file by one even map from its lowest and highest, so that thresholds keep their order.

    Args:
        path: the file.
        frame_count: of the sequence; None = up to the last frame with a detection.
        fps: frames per second, for the trackers; None = 25.

    Raises:
        FormatError: it breaks its format, or has frames that the sequence has not.
    """
    table = read_table(path, _COLUMNS)
    values = table.values[:, : _SCORE + 1]
    for column in range(values.shape[1]):
        table.check(np.isfinite(values[:, column]), column, f"expected a finite number in column {column + 1}")
    limit = min(MAX_FRAMES, frame_count or MAX_FRAMES)
    table.check(whole(values[:, 0]) & (values[:, 0] >= 1), 0, "frame: expected a whole number from 1")
    table.check(values[:, 0] <= limit, 0, f"frame: expected up to {limit:,}, the frames of the sequence")
    xyxy = np.hstack([values[:, 2:4], values[:, 2:4] + values[:, 4:6]])
    table.check(np.abs(xyxy).max(axis=1, initial=0.0) <= FARTHEST_PX, 2, f"expected a box within {FARTHEST_PX:,.0f} px")
    boxes = xyxy.astype(np.float32)
    is_box = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    for column in (0, 1):
        table.check(values[:, 4 + column] >= 0, 4 + column, "width and height: expected 0 or more")
    order = np.flatnonzero(is_box)[np.argsort(values[is_box, 0], kind="stable")]
    count = frame_count or int(values[:, 0].max(initial=0))
    if not count:
        raise fault(path, 0, "holds no detection; check that it is the right file")
    row_frames = values[order, 0].astype(np.int64) - 1
    return DetectedSequence(
        np.arange(count),
        np.arange(count) / (fps or DEFAULT_FPS),
        np.searchsorted(row_frames, np.arange(count + 1)).astype(np.int64),
        boxes[order],
        _shares(values[:, _SCORE])[order].astype(np.float32),
        np.zeros(len(order), np.int64),
    )


def _shares(scores: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Scores (R,) between 0 and 1: as they are where they are so already."""
    low, high = float(scores.min(initial=0.0)), float(scores.max(initial=1.0))
    if low >= 0 and high <= 1:
        return scores
    return (scores - low) / (high - low)
