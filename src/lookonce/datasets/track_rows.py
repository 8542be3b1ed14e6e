"""Boxes with identities as a text file holds them, row by row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAX_FRAMES", "NO_CLASS", "TrackRows", "first_twins"]

MAX_FRAMES = 20_000_000
"""A week at 30 frames per second; a higher number is a mistake."""

NO_CLASS = -1


@dataclass(frozen=True, slots=True)
class TrackRows:
    """Rows of a file with tracks, in its order; R rows.

    Attributes:
        frames: (R,) int64, from 0.
        ids: (R,) int64, each once a frame.
        xyxy: (R, 4) float64, px, as the file says.
        labels: (R,) int64, class numbers as the file says; -1 where it says nothing.
        flags: (R,) float64, the seventh number of a row, 1 without: a result's score; of truth, 0 = does not count.
    """

    frames: NDArray[np.int64]
    ids: NDArray[np.int64]
    xyxy: NDArray[np.float64]
    labels: NDArray[np.int64]
    flags: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.frames)


def first_twins(frames: NDArray[np.int64], ids: NDArray[np.int64]) -> tuple[int, int] | None:
    """Two rows of one id in one frame, the earlier row first; None where there are none."""
    order = np.lexsort((ids, frames))  # stable: rows of one id stay in their order
    twins = np.flatnonzero((np.diff(frames[order]) == 0) & (np.diff(ids[order]) == 0))
    return (int(order[twins[0]]), int(order[twins[0] + 1])) if len(twins) else None
