"""The values that are compared: the true tracks of one sequence, and those that a tracker gave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import FARTHEST_PX
from lookonce.datasets.labelled import LabelledSequence
from lookonce.datasets.track_rows import MAX_FRAMES, TrackRows, first_twins
from lookonce.structures import check_array, check_finite

__all__ = ["TrackingResult", "TrackingTruth", "all_frames"]


def all_frames(count: int) -> NDArray[np.int64]:
    """The frames of a video in which all count: (F,) int64, 0 to ``count`` - 1.

    Raises:
        ValueError: the count is negative, or there are so many that it must be a mistake.
    """
    if not 0 <= count <= MAX_FRAMES:
        raise ValueError(f"frame_count: expected 0 to {MAX_FRAMES:,}, got {count:,}")
    return np.arange(count, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class TrackingTruth:
    """The true boxes of one sequence, checked on construction; N rows in any order, row order kept.

    Attributes:
        frames: (F,) int64, rising, from 0: the frames that count. Truth says of each what is in it, maybe nothing.
        row_frames: (N,) int64, the frame of each row, one of ``frames``.
        ids: (N,) int64, one number an object, once a frame.
        xyxy: (N, 4) float64, px, left < right and top < bottom.
        labels: (N,) int64, class of each row.
        is_counted: (N,) bool, whether the row is to be found. One that is not takes no part; but see ``is_distractor``.
        is_distractor: (N,) bool, whether a result that finds this row is left out; such a row itself does not count.
        ignored: (M, 4) float64, px, xyxy: regions of all frames in which truth is not told; what each protocol leaves
            out there says ``evaluate_tracking``.
        left_out: why -> number of rows that the source had beside these.

    Raises:
        ValueError: a field has another shape, dtype or range, or an id is in a frame twice.
    """

    frames: NDArray[np.int64]
    row_frames: NDArray[np.int64]
    ids: NDArray[np.int64]
    xyxy: NDArray[np.float64]
    labels: NDArray[np.int64]
    is_counted: NDArray[np.bool_]
    is_distractor: NDArray[np.bool_]
    ignored: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_array("frames", self.frames, (None,), np.int64)
        if len(self.frames) and (self.frames[0] < 0 or (np.diff(self.frames) <= 0).any()):
            raise ValueError("frames: expected 0 or more, each once and in rising order")
        _check_rows(self.row_frames, self.ids, self.xyxy, self.labels)
        _check_area("xyxy", self.xyxy)
        check_array("is_counted", self.is_counted, (len(self.ids),), np.bool_)
        check_array("is_distractor", self.is_distractor, (len(self.ids),), np.bool_)
        if (self.is_counted & self.is_distractor).any():
            raise ValueError("is_distractor: expected only rows that do not count, got one that does")
        if not np.isin(self.row_frames, self.frames).all():
            raise ValueError("row_frames: expected frames among `frames`, got another one")
        check_array("ignored", self.ignored, (None, 4), np.float64)
        check_finite("ignored", self.ignored)
        _check_area("ignored", self.ignored)

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def of_sequence(cls, sequence: LabelledSequence, frame_count: int | None = None) -> TrackingTruth:
        """The truth of a labelled sequence; each of its objects counts.

        Args:
            sequence: as ``lookonce.datasets.open_sequences`` gives it.
            frame_count: how many frames the video has, all of which count. None = up to the last frame with truth. A
                frame before that of which truth says nothing holds no object.
        """
        indices = np.array([frame.index for frame in sequence.frames], np.int64)
        parts = [frame.objects for frame in sequence.frames]
        ids = np.concatenate([np.zeros(0, np.int64), *(part.identities for part in parts)])
        return cls(
            frames=all_frames(int(indices.max(initial=-1)) + 1 if frame_count is None else frame_count),
            row_frames=np.repeat(indices, np.array([len(part) for part in parts], np.int64)),
            ids=ids,
            xyxy=np.concatenate([np.zeros((0, 4)), *(part.xyxy for part in parts)]),  # float64
            labels=np.concatenate([np.zeros(0, np.int64), *(part.labels for part in parts)]),
            is_counted=np.ones(len(ids), np.bool_),
            is_distractor=np.zeros(len(ids), np.bool_),
            ignored=sequence.ignored.astype(np.float64),
            left_out=dict(sequence.left_out),
        )

    def in_frames(self, is_chosen: NDArray[np.bool_]) -> TrackingTruth:
        """The truth of the chosen frames; ``is_chosen`` (F,)."""
        frames = self.frames[is_chosen]
        return replace(self.of_rows(np.isin(self.row_frames, frames)), frames=frames)

    def of_rows(self, rows: NDArray[np.bool_]) -> TrackingTruth:
        """The same frames with the chosen rows only; ``rows`` (N,)."""
        return replace(
            self,
            row_frames=self.row_frames[rows],
            ids=self.ids[rows],
            xyxy=self.xyxy[rows],
            labels=self.labels[rows],
            is_counted=self.is_counted[rows],
            is_distractor=self.is_distractor[rows],
        )

    def of_class(self, label: int) -> TrackingTruth:
        """The same truth in which only the rows of one class count."""
        return replace(self, is_counted=self.is_counted & (self.labels == label))


@dataclass(frozen=True, slots=True)
class TrackingResult:
    """The boxes that a tracker gave for one sequence, checked on construction; N rows in any order, row order kept.

    Attributes:
        row_frames: (N,) int64, from 0.
        ids: (N,) int64, one number a track, once a frame.
        xyxy: (N, 4) float64, px, finite. A box of zero or negative size finds nothing and is wrong (in the UA-DETRAC
            protocol: is left out).
        labels: (N,) int64, class of each row; zeros where classes do not matter.
        left_out: why -> number of rows that the source had beside these.

    Raises:
        ValueError: a field has another shape, dtype or range, or an id is in a frame twice.
    """

    row_frames: NDArray[np.int64]
    ids: NDArray[np.int64]
    xyxy: NDArray[np.float64]
    labels: NDArray[np.int64]
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_rows(self.row_frames, self.ids, self.xyxy, self.labels)

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def of_rows(cls, rows: TrackRows) -> TrackingResult:
        """The result of a file, as ``lookonce.datasets.read_mot_results`` gives it; its scores play no part."""
        return cls(rows.frames, rows.ids, rows.xyxy, rows.labels)

    def of_class(self, label: int) -> TrackingResult:
        """The rows of one class only."""
        rows = self.labels == label
        return TrackingResult(self.row_frames[rows], self.ids[rows], self.xyxy[rows], self.labels[rows], self.left_out)


def _check_rows(
    frames: NDArray[np.int64], ids: NDArray[np.int64], xyxy: NDArray[np.float64], labels: NDArray[np.int64]
) -> None:
    check_array("ids", ids, (None,), np.int64)
    check_array("row_frames", frames, (len(ids),), np.int64)
    check_array("labels", labels, (len(ids),), np.int64)
    check_array("xyxy", xyxy, (len(ids), 4), np.float64)
    check_finite("xyxy", xyxy)
    if (np.abs(xyxy) > FARTHEST_PX).any():
        raise ValueError(f"xyxy: expected numbers up to {FARTHEST_PX:,.0f} px, got {np.abs(xyxy).max():g}")
    if frames.min(initial=0) < 0:
        raise ValueError(f"row_frames: expected 0 or more, got {frames.min()}")
    if twins := first_twins(frames, ids):
        raise ValueError(f"ids: expected each once a frame, got {ids[twins[0]]} twice in frame {frames[twins[0]]}")


def _check_area(name: str, xyxy: NDArray[np.float64]) -> None:
    if (xyxy[:, 2:] <= xyxy[:, :2]).any():
        raise ValueError(f"{name}: expected left < right and top < bottom, got a box of zero or negative size")
