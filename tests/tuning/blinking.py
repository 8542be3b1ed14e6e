"""Scenes in which one setting decides: objects whose look changes from frame to frame by a known distance."""

from __future__ import annotations

import numpy as np

from lookonce.compare.detections import DetectedFrame, DetectedSequence
from lookonce.evaluation import TrackingTruth
from lookonce.structures import Detections
from lookonce.tuning.scenes import TuningScene
from tracking.scenes import apart, at_angle

SWING = 30.0  # degrees by which a look swings to and fro
DISTANCE = apart(SWING)
FRAMES = 20


def make_scene(
    name: str = "a", frames: int = FRAMES, *, speed: float = 2.0, missing: tuple[int, ...] = ()
) -> TuningScene:
    """Two objects that never meet, 10 frames a second; the detector misses both in the frames ``missing``."""
    numbers = np.arange(frames)
    left = np.stack([10 + speed * numbers, 400 - speed * numbers], axis=1)  # (F, 2)
    xyxy = np.stack([left, left * 0 + 20, left + 20, left * 0 + 60], axis=2).reshape(-1, 4)
    truth = TrackingTruth(
        frames=numbers,
        row_frames=np.repeat(numbers, 2),
        ids=np.tile([1, 2], frames),
        xyxy=xyxy,
        labels=np.zeros(2 * frames, np.int64),
        is_counted=np.ones(2 * frames, np.bool_),
        is_distractor=np.zeros(2 * frames, np.bool_),
    )
    found = [_detected(number, xyxy[2 * number : 2 * number + 2], number in missing) for number in range(frames)]
    return TuningScene(name, truth, DetectedSequence.of_frames(found))


def _detected(number: int, xyxy: np.ndarray, is_missed: bool) -> DetectedFrame:
    swing = SWING * (number % 2)
    looks = at_angle(swing, 180 + swing).astype(np.float32)
    both = Detections(xyxy.astype(np.float32), np.full(2, 0.9, np.float32), np.zeros(2, np.int64), looks)
    return DetectedFrame(number, number / 10, both[:0] if is_missed else both)
