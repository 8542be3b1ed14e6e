"""SORT, ByteTrack, OC-SORT, BoT-SORT and C-BIoU of the package `trackers` (Apache-2.0), with its defaults."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.contenders.online import frame_by_frame
from lookonce.compare.detections import DetectedFrame, DetectedSequence

__all__ = ["associate_botsort", "associate_bytetrack", "associate_cbiou", "associate_ocsort", "associate_sort"]

_ROW = "row"


def associate_sort(sequence: DetectedSequence) -> NDArray[np.int64]:
    """SORT: Kalman filter, overlap, the best assignment."""
    from trackers import SORTTracker

    return _ids_of(SORTTracker(frame_rate=sequence.fps), sequence)


def associate_bytetrack(sequence: DetectedSequence) -> NDArray[np.int64]:
    """ByteTrack: what is seen badly goes to tracks that found nothing better."""
    from trackers import ByteTrackTracker

    return _ids_of(ByteTrackTracker(frame_rate=sequence.fps), sequence)


def associate_ocsort(sequence: DetectedSequence) -> NDArray[np.int64]:
    """OC-SORT: SORT that trusts observations more than its filter."""
    from trackers import OCSORTTracker

    return _ids_of(OCSORTTracker(frame_rate=sequence.fps), sequence)


def associate_botsort(sequence: DetectedSequence) -> NDArray[np.int64]:
    """BoT-SORT without appearance and without compensation of camera motion, for which it would need pictures."""
    from trackers import BoTSORTTracker

    return _ids_of(BoTSORTTracker(frame_rate=sequence.fps, enable_cmc=False), sequence)


def associate_cbiou(sequence: DetectedSequence) -> NDArray[np.int64]:
    """C-BIoU: overlap of boxes that are widened first."""
    from trackers import CBIoUTracker

    return _ids_of(CBIoUTracker(frame_rate=sequence.fps), sequence)


def _ids_of(tracker: Any, sequence: DetectedSequence) -> NDArray[np.int64]:
    """Ids of all rows; the package reorders and drops rows, so each carries its number through it."""
    from supervision import Detections

    def update(frame: DetectedFrame) -> NDArray[np.int64]:
        found = frame.detections
        ids = np.full(len(found), -1, np.int64)
        given = Detections(
            found.xyxy.astype(np.float64),
            confidence=found.scores,
            class_id=found.labels.astype(int),
            data={_ROW: np.arange(len(found))},
        )
        answer = tracker.update(given)
        if len(answer):
            ids[np.asarray(answer.data[_ROW])] = answer.tracker_id
        return ids

    return frame_by_frame(sequence, update)
