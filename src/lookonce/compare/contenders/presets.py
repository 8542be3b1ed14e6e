"""Our own presets, whatever ``lookonce.tracking.PRESETS`` holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lookonce.compare.associated import Associated
from lookonce.compare.detections import DetectedSequence
from lookonce.structures import NO_ID, Detections, Filled
from lookonce.tracking import PRESETS, Tracker, TrackerConfig
from lookonce.tracking.default_config import DefaultConfig

__all__ = ["associate_by", "associate_preset", "calibrated", "needs_descriptors"]


def associate_preset(name: str, sequence: DetectedSequence, makes_boxes: bool = True) -> Associated:
    """What a preset makes of all rows; without ``makes_boxes`` none but those detected, and no gap is filled."""
    config = PRESETS[name]()
    if isinstance(config, DefaultConfig) and not makes_boxes:
        config = replace(config, steady=False, fill_s=0.0)
    return associate_by(calibrated(config, sequence), sequence)


def calibrated(config: TrackerConfig, sequence: DetectedSequence) -> TrackerConfig:
    """The settings with the threshold that was calibrated for the descriptors, where one was."""
    return replace(config, match_threshold=sequence.match_threshold) if sequence.match_threshold else config


def associate_by(config: TrackerConfig, sequence: DetectedSequence) -> Associated:
    """What settings make of all rows.

    A preset that confirms an object gives its earlier rows back, and they count, as in what ``lookonce track`` writes;
    and so do the boxes that it makes itself.
    """
    tracker = Tracker(config)
    ids, xyxy, gaps = np.full(len(sequence), NO_ID, np.int64), sequence.xyxy.copy(), [Filled.nothing()]
    for number, frame in enumerate(sequence):
        first, last = sequence.starts[number : number + 2].tolist()
        tracks = tracker.update(frame.detections, frame.time_s, camera=frame.camera, size=sequence.size, frame=number)
        ids[first:last], xyxy[first:last] = tracks.ids, tracks.xyxy
        back = tracks.given_back
        rows = sequence.starts[back.frames] + back.rows  # of the time before it was confirmed
        ids[rows], xyxy[rows] = back.ids, back.xyxy
        gaps.append(tracks.filled)
    return Associated(ids, xyxy, Filled.joined(gaps))


def needs_descriptors(name: str) -> bool:
    """Whether a preset refuses detections without descriptors."""
    one = Detections(np.array([[0, 0, 9, 9]], np.float32), np.ones(1, np.float32), np.zeros(1, np.int64))
    try:
        Tracker(name).update(one, 0.0)
    except ValueError:
        return True
    return False
