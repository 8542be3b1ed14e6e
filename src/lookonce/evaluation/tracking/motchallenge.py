"""The truth of MOTChallenge's benchmarks with its rules for what counts."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from lookonce.datasets.mot_tracks import read_mot_truth
from lookonce.errors import FormatError
from lookonce.evaluation.tracking.values import TrackingTruth, all_frames

__all__ = ["Benchmark", "read_motchallenge_truth"]

Benchmark = Literal["MOT15", "MOT16", "MOT17", "MOT20"]

_PEDESTRIAN, _CLASSES = 1, 13
_NON_MOTOR_VEHICLE = 6
_DISTRACTORS = (2, 7, 8, 12)  # person on vehicle, static person, distractor, reflection


def read_motchallenge_truth(
    path: Path, benchmark: Benchmark = "MOT17", frame_count: int | None = None
) -> TrackingTruth:
    """Reads a benchmark's ``gt.txt`` with all of its rows, and marks what counts, as TrackEval's ``MotChallenge2DBox``.

    Pedestrians (class 1) count unless their seventh number is 0. Results on a person on a vehicle, a static person, a
    distractor or a reflection (in MOT20 also on a non-motorised vehicle) are neither right nor wrong. In MOT15 classes
    mean nothing, and every row counts whose seventh number is not 0.

    Args:
        path: of the truth; eight columns or more.
        benchmark: whose rules.
        frame_count: how many frames the video has (``seqLength`` in ``seqinfo.ini``); None = up to the last row.

    Raises:
        FormatError: the file breaks its format, or has a class that the benchmark does not know.
        ValueError: there is no such benchmark, or rows lie beyond ``frame_count``.
    """
    if benchmark not in ("MOT15", "MOT16", "MOT17", "MOT20"):
        raise ValueError(f"benchmark: expected MOT15, MOT16, MOT17 or MOT20, got {benchmark}")
    rows = read_mot_truth(path)
    is_counted = rows.flags.astype(np.int64) != 0
    is_distractor = np.zeros(len(rows), np.bool_)
    if benchmark != "MOT15":
        if len(rows) and not (rows.labels.min() >= 1 and rows.labels.max() <= _CLASSES):
            message = f"class: expected 1 to {_CLASSES} as in {benchmark}; name MOT15 for a truth without classes"
            raise FormatError(path, 0, message)
        is_counted &= rows.labels == _PEDESTRIAN
        classes = (*_DISTRACTORS, _NON_MOTOR_VEHICLE) if benchmark == "MOT20" else _DISTRACTORS
        is_distractor = np.isin(rows.labels, classes)
    frames = all_frames(int(rows.frames.max(initial=-1)) + 1 if frame_count is None else frame_count)
    return TrackingTruth(frames, rows.frames, rows.ids, rows.xyxy, rows.labels, is_counted, is_distractor)
