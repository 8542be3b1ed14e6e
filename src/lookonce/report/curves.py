"""Precision and recall of a run's detections, whatever identities they got."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation import DetectionTruth, PrecisionRecall, TrackingTruth, precision_recall
from lookonce.report.run_lines import RunLines
from lookonce.structures import Detections

__all__ = ["Detected", "detection_curve"]

_MIN_IOU = {"trackeval": 0.5, "detrac": 0.7}


@dataclass(frozen=True, slots=True)
class Detected:
    """The detections of one sequence and what there is to be found.

    Attributes:
        truth: rows that count are to be found; on distractors and in ignored regions a detection is neither right nor
            wrong.
        lines: all detections.
        is_chosen: (N,) bool, which of them take part.
    """

    truth: TrackingTruth
    lines: RunLines
    is_chosen: NDArray[np.bool_]


def detection_curve(parts: Sequence[Detected], protocol: str) -> PrecisionRecall:
    """Over all frames of all sequences, classes as one, with the least overlap of the protocol for a new match."""
    truths: list[DetectionTruth] = []
    detections: list[Detections] = []
    for part in parts:
        truths += _truths(part.truth)
        detections += _detections(part)
    return precision_recall(truths, detections, [0], min_iou=_MIN_IOU[protocol])


def _truths(truth: TrackingTruth) -> list[DetectionTruth]:
    """One for each frame; what is neither right nor wrong is a crowd."""
    ignored = truth.ignored.astype(np.float32)
    rows = np.flatnonzero(truth.is_counted | truth.is_distractor)
    found = []
    for mine in _by_frame(truth.frames, truth.row_frames[rows]):
        boxes = np.concatenate([truth.xyxy[rows[mine]].astype(np.float32), ignored])
        is_crowd = np.concatenate([truth.is_distractor[rows[mine]], np.ones(len(ignored), np.bool_)])
        kept = _has_area(boxes)
        found.append(DetectionTruth(boxes[kept], np.zeros(int(kept.sum()), np.int64), is_crowd[kept]))
    return found


def _detections(part: Detected) -> list[Detections]:
    xyxy = part.lines.xyxy.astype(np.float32)
    rows = np.flatnonzero(part.is_chosen & _has_area(xyxy))
    scores = part.lines.scores.astype(np.float32)
    return [
        Detections(xyxy[rows[mine]], scores[rows[mine]], np.zeros(len(mine), np.int64))
        for mine in _by_frame(part.truth.frames, part.lines.row_frames[rows])
    ]


def _by_frame(frames: NDArray[np.int64], row_frames: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """For each of ``frames`` (F,) the places of its rows, in their order."""
    order = np.argsort(row_frames, kind="stable")
    starts = np.searchsorted(row_frames[order], frames)
    ends = np.searchsorted(row_frames[order], frames, side="right")
    return [order[start:end] for start, end in zip(starts.tolist(), ends.tolist(), strict=True)]


def _has_area(xyxy: NDArray[np.float32]) -> NDArray[np.bool_]:
    return (xyxy[:, 2] > xyxy[:, 0]) & (xyxy[:, 3] > xyxy[:, 1])
