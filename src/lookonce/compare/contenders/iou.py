"""The IOU tracker, and KIOU: the same with a Kalman filter's prediction in place of the last box.

E. Bochinski, V. Eiselein, T. Sikora: High-Speed Tracking-by-Detection Without Using Image Information, AVSS 2017.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import iou
from lookonce.compare.contenders.box_filter import BoxFilter
from lookonce.compare.detections import DetectedSequence

__all__ = ["IouSettings", "associate_iou", "associate_kiou"]


@dataclass(frozen=True, slots=True)
class IouSettings:
    """The publication's numbers, with its values for UA-DETRAC and the detections of R-CNN.

    Attributes:
        low: detections below this score are not looked at.
        high: a track counts if its best detection has at least this score.
        overlap: smallest IoU of a track's last box and the next.
        min_length: a track counts if it has at least so many boxes.
    """

    low: float = 0.0
    high: float = 0.7
    overlap: float = 0.5
    min_length: int = 2


_KIOU = IouSettings(overlap=0.3)  # a prediction is rougher than a box, and tracks live through gaps
_KIOU_MEMORY_S = 1.0  # as long as the package `trackers` keeps a lost track


@dataclass(slots=True)
class _Track:
    """Rows so far, the best score among them, and for KIOU where the next box is expected."""

    rows: list[int] = field(default_factory=list)
    best: float = 0.0
    last_s: float = 0.0
    filter: BoxFilter | None = None


def associate_iou(sequence: DetectedSequence, settings: IouSettings | None = None) -> NDArray[np.int64]:
    """Ids (R,) int64 of all rows, -1 for those in no track that counts.

    Each active track in turn, oldest first, takes the free detection that overlaps its last box most; a track that gets
    none ends. What is left over starts tracks.
    """
    return _associate(sequence, settings or IouSettings(), is_predicting=False, memory_s=0.0)


def associate_kiou(sequence: DetectedSequence, settings: IouSettings | None = None) -> NDArray[np.int64]:
    """Ids as ``associate_iou`` gives them, but a Kalman filter moves tracks on, and they outlive a second of misses."""
    return _associate(sequence, settings or _KIOU, is_predicting=True, memory_s=_KIOU_MEMORY_S)


def _associate(
    sequence: DetectedSequence, settings: IouSettings, *, is_predicting: bool, memory_s: float
) -> NDArray[np.int64]:
    active: list[_Track] = []
    tracks: list[_Track] = []
    bounds = zip(sequence.times.tolist(), sequence.starts[:-1].tolist(), sequence.starts[1:].tolist(), strict=True)
    for time_s, first, last in bounds:
        free = [row for row in range(first, last) if sequence.scores[row] >= np.float32(settings.low)]
        kept: list[_Track] = []
        overlaps = iou(_expected(active, sequence, time_s), sequence.xyxy[first:last])
        for track, overlap in zip(active, overlaps, strict=True):
            best = _best(free, overlap, first)
            if best >= 0 and overlap[best - first] >= settings.overlap:
                free.remove(best)
                _extend(track, best, time_s, sequence)
                kept.append(track)
            elif memory_s and time_s - track.last_s <= memory_s:
                kept.append(track)
        for row in free:
            track = _Track(filter=BoxFilter(sequence.xyxy[row], time_s) if is_predicting else None)
            _extend(track, row, time_s, sequence)
            kept.append(track)
            tracks.append(track)
        active = kept
    ids = np.full(len(sequence), -1, np.int64)
    high = float(np.float32(settings.high))  # as precise as scores are
    counting = [one for one in tracks if one.best >= high and len(one.rows) >= settings.min_length]
    for number, track in enumerate(counting, 1):
        ids[track.rows] = number
    return ids


def _best(free: list[int], overlap: NDArray[np.float32], first: int) -> int:
    """The free row of largest overlap; -1 without any."""
    return max(free, key=lambda row: float(overlap[row - first]), default=-1)


def _expected(active: list[_Track], sequence: DetectedSequence, time_s: float) -> NDArray[np.float32]:
    """Where each active track is expected: xyxy (T, 4)."""
    boxes = [
        sequence.xyxy[track.rows[-1]] if track.filter is None else track.filter.predict(time_s) for track in active
    ]
    return np.array(boxes, np.float32).reshape(-1, 4)


def _extend(track: _Track, row: int, time_s: float, sequence: DetectedSequence) -> None:
    if track.filter is not None and track.rows:
        track.filter.correct(sequence.xyxy[row], time_s)
    track.rows.append(row)
    track.best = max(track.best, float(sequence.scores[row]))
    track.last_s = time_s
