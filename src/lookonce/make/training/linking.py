"""Identities from unlabelled video: confident detections, linked where nothing else is possible, as short pure tracks.

Two detections of neighbouring frames are linked when they overlap much and neither overlaps anything else that could be
meant. Whatever is ambiguous ends its track: a track that is cut in two costs little, a track of two objects poisons the
training. An object that the detector reports twice, as two classes, counts once, with the better score.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import iou
from lookonce.structures import Detections

__all__ = ["LinkedRow", "Links", "link_detections"]

_LEAST_OVERLAP = 0.5  # of a link
_RIVAL_OVERLAP = 0.2  # a second candidate with more makes a link ambiguous
_TWICE_OVERLAP = 0.6  # of two boxes with more, whatever their classes, the one with the lower score is dropped
_SHORTEST_FRAMES = 5  # a track with fewer is as likely a false detection


@dataclass(frozen=True, slots=True)
class LinkedRow:
    """One detection of a track.

    Attributes:
        frame: index in the source, from 0.
        time_s: seconds on the source's clock.
        track: number of the track, from 0.
        xyxy: (4,) float32 px of the picture.
        label: index into the model's class names.
    """

    frame: int
    time_s: float
    track: int
    xyxy: NDArray[np.float32]
    label: int


@dataclass(frozen=True, slots=True)
class Links:
    """The pure tracks of a video.

    Attributes:
        rows: by frame.
        tracks: how many tracks.
        ambiguous: how often a track was cut because something else could have been meant, or the overlap was small.
        short: detections left out because their track had fewer than 5 frames.
    """

    rows: tuple[LinkedRow, ...]
    tracks: int
    ambiguous: int
    short: int


def link_detections(frames: Iterable[tuple[int, float, Detections]]) -> Links:
    """Short pure tracks from detections in neighbouring frames.

    Args:
        frames: index, time in seconds, and confident detections of each frame, in order; neighbours are those that
            follow each other here, so frames that nobody gives may lie between.
    """
    links = _Linker()
    for index, time_s, detections in frames:
        links.add(index, time_s, detections)
    return links.close()


class _Linker:
    def __init__(self) -> None:
        self._tracks: list[list[LinkedRow]] = []
        self._open: list[int] = []  # the track of each row of the previous frame
        self._before = Detections.empty()
        self._ambiguous = 0

    def add(self, index: int, time_s: float, detections: Detections) -> None:
        detections = _each_object_once(detections)
        same_class = self._before.labels[:, None] == detections.labels[None, :]
        overlap = np.where(same_class, iou(self._before.xyxy, detections.xyxy), 0)
        rivals = iou(detections.xyxy, detections.xyxy) > _RIVAL_OVERLAP
        is_crowded = rivals.sum(axis=1) > 1  # overlaps another detection of its own frame
        candidates = overlap > _RIVAL_OVERLAP
        is_sure = (
            (overlap >= _LEAST_OVERLAP) & (candidates.sum(axis=0) == 1) & (candidates.sum(axis=1, keepdims=True) == 1)
        )
        open_tracks = []
        for row in range(len(detections)):
            partner = np.flatnonzero(is_sure[:, row])
            is_linked = len(partner) == 1 and not is_crowded[row]
            if not is_linked:
                self._ambiguous += bool(candidates[:, row].any())
                self._tracks.append([])
            track = self._open[partner[0]] if is_linked else len(self._tracks) - 1
            self._tracks[track].append(
                LinkedRow(index, time_s, track, detections.xyxy[row], int(detections.labels[row]))
            )
            open_tracks.append(track)
        self._open, self._before = open_tracks, detections

    def close(self) -> Links:
        kept = [track for track in self._tracks if len(track) >= _SHORTEST_FRAMES]
        short = sum(len(track) for track in self._tracks) - sum(len(track) for track in kept)
        rows = [
            LinkedRow(row.frame, row.time_s, number, row.xyxy, row.label)
            for number, track in enumerate(kept)
            for row in track
        ]
        return Links(tuple(sorted(rows, key=lambda row: row.frame)), len(kept), self._ambiguous, short)


def _each_object_once(detections: Detections) -> Detections:
    """Detections without those that overlap a better one so much that both mean one object; the order is kept."""
    is_twin = iou(detections.xyxy, detections.xyxy) > _TWICE_OVERLAP
    kept: list[int] = []
    for row in np.argsort(-detections.scores, kind="stable").tolist():
        if not is_twin[row, kept].any():
            kept.append(row)
    return detections[np.array(sorted(kept), np.int64)]
