"""The ceiling of association: the same detections, each with the true identity that it overlaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.assignment import solve_dense
from lookonce.boxes import iou
from lookonce.compare.detections import DetectedSequence
from lookonce.evaluation import TrackingTruth

__all__ = ["oracle_ids"]


def oracle_ids(sequence: DetectedSequence, truth: TrackingTruth, min_iou: float = 0.5) -> NDArray[np.int64]:
    """Ids (R,) int64 of all rows, from 1; -1 where no true box overlaps by ``min_iou``, or another row does so better.

    In each frame the one-to-one choice is taken that has most pairs, and of these the largest sum of overlaps.
    """
    ids = np.full(len(sequence), -1, np.int64)
    rows_of = {
        frame: np.flatnonzero(truth.is_counted & (truth.row_frames == frame)) for frame in sequence.frames.tolist()
    }
    bounds = zip(sequence.frames.tolist(), sequence.starts[:-1].tolist(), sequence.starts[1:].tolist(), strict=True)
    for frame, first, last in bounds:
        rows = rows_of[frame]
        if not (len(rows) and last > first):
            continue
        overlap = iou(sequence.xyxy[first:last], truth.xyxy[rows].astype(np.float32)).astype(np.float64)
        count = min(overlap.shape) + 1
        chosen = solve_dense(np.where(overlap >= min_iou, overlap + count, 0.0))
        found = chosen >= 0
        ids[first:last][found] = truth.ids[rows[chosen[found]]] + 1
    return ids
