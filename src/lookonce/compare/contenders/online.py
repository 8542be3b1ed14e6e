"""What online trackers have in common: frame after frame, an id for each row."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.detections import DetectedFrame, DetectedSequence

__all__ = ["Update", "frame_by_frame"]

Update = Callable[[DetectedFrame], NDArray[np.int64]]
"""One frame -> ids (N,) int64 of its N rows, from 0 or 1; below 0 = no identity (yet)."""


def frame_by_frame(sequence: DetectedSequence, update: Update) -> NDArray[np.int64]:
    """Ids (R,) int64 of all rows."""
    ids = [np.zeros(0, np.int64), *(update(frame) for frame in sequence)]
    return np.concatenate(ids).astype(np.int64)
