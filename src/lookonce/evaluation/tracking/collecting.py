"""A result from a tracker's answers, frame by frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.tracking.values import TrackingResult
from lookonce.structures import NO_ID, Tracks

__all__ = ["ResultCollector"]

_NO_IDENTITY = "no identity (yet)"


class ResultCollector:
    """Takes the rows that have an identity, and those of earlier frames that are given back or filled in."""

    def __init__(self) -> None:
        self._frames: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
        self._ids: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
        self._xyxy: list[NDArray[np.float64]] = [np.zeros((0, 4))]
        self._labels: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
        self._without = 0

    def add(self, index: int, tracks: Tracks) -> None:
        """One more frame, number ``index`` of the source."""
        rows = tracks.ids != NO_ID
        self._without += int(np.count_nonzero(~rows))
        self._append(
            np.full(int(rows.sum()), index, np.int64), tracks.ids[rows], tracks.xyxy[rows], tracks.labels[rows]
        )
        back = tracks.given_back
        self._without -= len(back)
        self._append(back.frames, back.ids, back.xyxy, back.labels)
        filled = tracks.filled
        self._append(filled.frames, filled.ids, filled.xyxy, filled.labels)

    def _append(
        self, frames: NDArray[np.int64], ids: NDArray[np.int64], xyxy: NDArray[np.float32], labels: NDArray[np.int64]
    ) -> None:
        self._frames.append(frames)
        self._ids.append(ids)
        self._xyxy.append(xyxy.astype(np.float64))
        self._labels.append(labels)

    def result(self, one_class: bool = False) -> TrackingResult:
        """All rows so far; with ``one_class`` the label of each is 0."""
        labels = np.concatenate(self._labels)
        return TrackingResult(
            np.concatenate(self._frames),
            np.concatenate(self._ids),
            np.concatenate(self._xyxy),
            np.zeros_like(labels) if one_class else labels,
            {_NO_IDENTITY: self._without} if self._without > 0 else {},
        )
