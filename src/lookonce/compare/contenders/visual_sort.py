"""VisualSort of the package `similari-trackers-rs` (Apache-2.0): Deep SORT's idea, with our descriptors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.contenders.online import frame_by_frame
from lookonce.compare.detections import DetectedFrame, DetectedSequence

__all__ = ["associate_visual_sort"]

_MEMORY_S = 1.0  # as long as the package `trackers` keeps a lost track
_UNCALIBRATED = 0.7  # the preset `paper` has the same
_MIN_CONFIDENCE = 0.1


def associate_visual_sort(sequence: DetectedSequence) -> NDArray[np.int64]:
    """Ids of all rows: descriptors vote first, overlap decides for the rest."""
    from similari import (
        BoundingBox,
        VisualSort,
        VisualSortMetricType,
        VisualSortObservation,
        VisualSortObservationSet,
        VisualSortOptions,
    )

    options = VisualSortOptions()
    options.max_idle_epochs(max(1, round(_MEMORY_S * sequence.fps)))
    options.visual_metric(VisualSortMetricType.euclidean(sequence.match_threshold or _UNCALIBRATED))
    tracker = VisualSort(shards=1, opts=options)
    numbers: dict[int, int] = {}

    def update(frame: DetectedFrame) -> NDArray[np.int64]:
        found = frame.detections
        assert found.descriptors is not None
        observations = VisualSortObservationSet()
        ltrb = found.xyxy.tolist()
        for row, (box, score) in enumerate(zip(ltrb, found.scores.tolist(), strict=True)):
            left, top, right, bottom = box
            place = BoundingBox.new_with_confidence(left, top, right - left, bottom - top, score).as_xyaah()
            feature = found.descriptors[row].tolist()
            observations.add(VisualSortObservation(feature, score, place, row))
        ids = np.full(len(found), -1, np.int64)
        for track in tracker.predict(observations):
            ids[track.custom_object_id] = numbers.setdefault(track.id, len(numbers) + 1)
        tracker.clear_wasted()
        return ids

    return frame_by_frame(sequence, update)
