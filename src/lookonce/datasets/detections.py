"""Detections of any program from a file, frame by frame: MOTChallenge's ``det.txt``, UA-DETRAC's, our own results."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import FARTHEST_PX
from lookonce.datasets.jsonl_tracks import read_jsonl_results
from lookonce.datasets.text import Table, quoted, read_table, whole
from lookonce.datasets.track_rows import MAX_FRAMES
from lookonce.errors import ConfigError
from lookonce.structures import Detections
from lookonce.video import Frame
from lookonce.video.opening import one_line

__all__ = ["DetectionFile", "read_detections"]

log = logging.getLogger(__name__)

_COLUMNS = "frame, number or -1, left, top, width, height"
_SCORE, _CLASS = 6, 7
_UNNAMED = ("object",)  # the class where a file knows none
_MOST_CLASSES = 10_000
_MOST = 0.5  # of the rows: then the column is meant as classes
_NO_NUMBER, _NO_SIZE = "with a number that is not finite", "of zero or negative size"
_TOO_FAR = f"farther out than {FARTHEST_PX:,.0f} px"


@dataclass(frozen=True, slots=True)
class DetectionFile:
    """All detections of a file. It detects as a model does: ``detect(frame)`` gives those of the frame's number.

    Attributes:
        path: the file.
        names: class names by label; empty where labels are the file's own class numbers.
        rows: of all frames, by rising frame, within a frame in the file's order; without descriptors.
        frames: (R,) int64, each row's frame, from 0.
        left_out: why -> number of rows that cannot be detections.
        score_range: the file's least and greatest score where these were mapped to 0 and 1, because some lie outside.
    """

    path: Path
    names: tuple[str, ...]
    rows: Detections
    frames: NDArray[np.int64]
    left_out: dict[str, int]
    score_range: tuple[float, float] | None = None

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def first_frame(self) -> int | None:
        """The first frame with a detection, from 0; None without any."""
        return int(self.frames[0]) if len(self.frames) else None

    @property
    def last_frame(self) -> int | None:
        """The last frame with a detection, from 0; None without any."""
        return int(self.frames[-1]) if len(self.frames) else None

    @property
    def sha256(self) -> str:
        """Digest of the file."""
        with open(self.path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def frame(self, index: int) -> Detections:
        """The detections of one frame, counted from 0; none where the file has none."""
        start, end = np.searchsorted(self.frames, (index, index + 1))
        return self.rows[int(start) : int(end)]

    def detect(self, frame: Frame) -> Detections:
        """The detections of a frame of the video that the file belongs to."""
        return self.frame(frame.index)

    def above(self, score: float) -> DetectionFile:
        """Only the detections above a score, 0 to 1."""
        kept = self.rows.scores > score
        return DetectionFile(
            self.path, self.names, self.rows[kept], self.frames[kept], dict(self.left_out), self.score_range
        )

    def labels_of(self, classes: Sequence[str | int]) -> NDArray[np.int64]:
        """Labels (C,) int64 of classes given by name or number.

        Raises:
            ConfigError: the file does not have a class of that name, or names no classes.
        """
        labels = []
        for wanted in classes:
            text = str(wanted).strip()
            if text in self.names:
                labels.append(self.names.index(text))
            elif text.isdecimal() and int(text) < (len(self.names) or _MOST_CLASSES):
                labels.append(int(text))
            else:
                known = f"it has {', '.join(self.names[:12])}" if self.names else "its classes are numbers"
                raise ConfigError(f"class {quoted(text)} is not in {one_line(self.path)}; {known}")
        return np.array(sorted(set(labels)), np.int64)


def read_detections(path: Path) -> DetectionFile:
    """The detections of a text ``frame, number or -1, left, top, width, height[, score[, class ...]]`` or a JSON lines.

    Frames count from 1 in the text and may come in any order; equal rows are all kept. The number or identity is not
    looked at. Without a score it is 1. Where scores lie outside 0 to 1, as in MOT15 and UA-DETRAC, those of the
    whole file are mapped so that the least is 0 and the greatest 1. An eighth column of whole numbers from 0 is the
    class; where only most are, no row has one, which is said. ``tracks.jsonl`` names its classes. Rows whose box or
    score cannot be are left out and counted.

    Args:
        path: the file; JSON lines are known by the suffix ``.jsonl``.

    Raises:
        FormatError: it breaks its format, or a frame's number cannot be.
    """
    if path.suffix.lower() == ".jsonl":
        named = read_jsonl_results(path, needs_identity=False)
        rows = named.rows
        return _sorted(path, named.names, rows.frames, rows.xyxy, rows.flags, rows.labels, dict(named.left_out))
    table = read_table(path, _COLUMNS)
    values = table.values
    _check_frames(table)
    ltwh = values[:, 2:6]
    with np.errstate(over="ignore", invalid="ignore"):
        xyxy = np.hstack([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]])
    scores = values[:, _SCORE] if values.shape[1] > _SCORE else np.ones(len(values))
    labels = np.zeros(len(values), np.int64)
    names: tuple[str, ...] = _UNNAMED
    if values.shape[1] > _CLASS and len(values):
        are_classes = _are_classes(values[:, _CLASS])
        if are_classes.all():
            labels, names = values[:, _CLASS].astype(np.int64), ()
        elif are_classes.mean() > _MOST:
            count = np.count_nonzero(~are_classes)
            said = "%s: the eighth column is no class in %d of %d rows, so no row has one; mend these to have classes"
            log.warning(said, one_line(path), count, len(values))
    return _sorted(path, names, values[:, 0].astype(np.int64) - 1, xyxy, scores, labels, {})


def _check_frames(table: Table) -> None:
    frames = table.values[:, 0]
    table.check(np.isfinite(frames), 0, "frame: expected a finite number")
    table.check(whole(frames), 0, "frame: expected a whole number")
    table.check(frames >= 1, 0, "frame: frames count from 1; add 1 to all of them")
    table.check(frames <= MAX_FRAMES, 0, f"frame: expected up to {MAX_FRAMES:,}")


def _are_classes(numbers: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(R,) bool: whether the eighth column is a class; in MOTChallenge's files it is a place in the world, or -1."""
    are_classes: NDArray[np.bool_] = whole(numbers) & (numbers >= 0) & (numbers < _MOST_CLASSES)
    return are_classes


def _sorted(
    path: Path,
    names: tuple[str, ...],
    frames: NDArray[np.int64],
    xyxy: NDArray[np.float64],
    scores: NDArray[np.float64],
    labels: NDArray[np.int64],
    left_out: dict[str, int],
) -> DetectionFile:
    """Rows by frame, without those that cannot be detections."""
    is_finite = np.isfinite(xyxy).all(axis=1) & np.isfinite(scores)
    with np.errstate(over="ignore", invalid="ignore"):
        boxes = xyxy.astype(np.float32)
        is_near = (np.abs(xyxy) <= FARTHEST_PX).all(axis=1)
        has_size = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    for why, is_wrong in (
        (_NO_NUMBER, ~is_finite),
        (_NO_SIZE, is_finite & is_near & ~has_size),
        (_TOO_FAR, is_finite & ~is_near),
    ):
        if count := int(np.count_nonzero(is_wrong)):
            left_out[why] = left_out.get(why, 0) + count
    good = np.flatnonzero(is_finite & is_near & has_size)
    good = good[np.argsort(frames[good], kind="stable")]
    mapped, score_range = _mapped(scores[good])
    rows = Detections(boxes[good], mapped.astype(np.float32), labels[good])
    return DetectionFile(path, names, rows, frames[good], left_out, score_range)


def _mapped(scores: NDArray[np.float64]) -> tuple[NDArray[np.float64], tuple[float, float] | None]:
    """Scores (R,) from 0 to 1, and their range where they had another; equal ones outside become 1."""
    least, greatest = float(scores.min(initial=1.0)), float(scores.max(initial=0.0))
    if least >= 0 and greatest <= 1:
        return scores, None
    least, greatest = float(scores.min()), float(scores.max())
    if least == greatest:
        return np.ones(len(scores)), (least, greatest)
    half = scores / 2 - least / 2  # the whole difference may be too large for a float
    return half / (greatest / 2 - least / 2), (least, greatest)
