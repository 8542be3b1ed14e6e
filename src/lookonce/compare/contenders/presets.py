"""Our own presets, whatever ``lookonce.tracking.PRESETS`` holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.detections import DetectedSequence
from lookonce.structures import NO_ID, Detections
from lookonce.tracking import PRESETS, Tracker

__all__ = ["associate_preset", "needs_descriptors"]


def associate_preset(name: str, sequence: DetectedSequence) -> NDArray[np.int64]:
    """Ids of all rows by a preset, with the threshold that was calibrated for the descriptors.

    A preset that confirms an object gives its earlier rows back, and they count, as in what ``lookonce track`` writes.
    """
    config = PRESETS[name]()
    if sequence.match_threshold:
        config = replace(config, match_threshold=sequence.match_threshold)
    tracker = Tracker(config)
    ids = np.full(len(sequence), NO_ID, np.int64)
    for number, frame in enumerate(sequence):
        first, last = sequence.starts[number : number + 2].tolist()
        tracks = tracker.update(frame.detections, frame.time_s, frame=number)
        ids[first:last] = tracks.ids
        back = tracks.given_back
        ids[sequence.starts[back.frames] + back.rows] = back.ids  # rows of the time before it was confirmed
    return ids


def needs_descriptors(name: str) -> bool:
    """Whether a preset refuses detections without descriptors."""
    one = Detections(np.array([[0, 0, 9, 9]], np.float32), np.ones(1, np.float32), np.zeros(1, np.int64))
    try:
        Tracker(name).update(one, 0.0)
    except ValueError:
        return True
    return False
