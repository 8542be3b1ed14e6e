"""How good settings are: association over detections at hand, held against the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lookonce.compare.detections import DetectedFrame
from lookonce.errors import ConfigError
from lookonce.evaluation import (
    ResultCollector,
    TrackingResult,
    TrackingScores,
    TrackingTruth,
    combine,
    evaluate_tracking,
)
from lookonce.tracking import Tracker, TrackerConfig
from lookonce.tuning.scenes import TuningScene

__all__ = ["OBJECTIVES", "Gain", "Scorer", "objective_value"]

OBJECTIVES: Mapping[str, Callable[[TrackingScores], float]] = {
    "hota": lambda scores: scores.hota.hota,
    "idf1": lambda scores: scores.identity.idf1,
    "mota": lambda scores: scores.clear.mota,
}
"""What can be made as large as possible."""

_PARTS = 5  # of a scene, to see how far a gain differs from part to part


@dataclass(frozen=True, slots=True)
class Gain:
    """How much better one of two settings is.

    Attributes:
        value: mean over consecutive parts of all scenes, of each the mean over the frame rates.
        error: its standard error, from how the parts differ; infinite where there is one part only.
    """

    value: float
    error: float

    @property
    def is_clear(self) -> bool:
        """Whether it is larger than twice its standard error."""
        return self.value > 2 * self.error


@dataclass(frozen=True, slots=True)
class _Prepared:
    """A scene at one frame rate, its frames ready for a tracker; ``size`` of the pictures as ``DetectedSequence``."""

    truth: TrackingTruth
    frames: tuple[DetectedFrame, ...]
    size: tuple[int, int] | None


class Scorer:
    """Scores settings on some scenes.

    Args:
        scenes: one or more.
        every: take every so many-th frame: one pass over all scenes for each.

    Raises:
        ConfigError: a scene holds no object at one of the frame rates.
    """

    def __init__(self, scenes: Sequence[TuningScene], every: Sequence[int]) -> None:
        self.every = tuple(every)
        self._rates = [[_prepare(scene, step) for scene in scenes] for step in every]
        self._parts = [_parts(scene, every) for scene in scenes]

    def scores(self, config: TrackerConfig) -> list[TrackingScores]:
        """The figures at each frame rate, combined over the scenes."""
        return [
            combine([evaluate_tracking(scene.truth, _associate(config, scene)) for scene in scenes])
            for scenes in self._rates
        ]

    def gain(self, objective: str, before: TrackerConfig, after: TrackerConfig) -> Gain:
        """How much ``after`` is better than ``before``."""
        value = OBJECTIVES[objective]
        gains: list[float] = []
        for number, parts in enumerate(self._parts):
            scenes = [rate[number] for rate in self._rates]
            results = [(_associate(before, scene), _associate(after, scene)) for scene in scenes]
            for truths in parts:
                rates = [
                    value(evaluate_tracking(truth, new)) - value(evaluate_tracking(truth, old))
                    for truth, (old, new) in zip(truths, results, strict=True)
                ]
                gains.append(float(np.mean(rates)))
        error = float(np.std(gains, ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else np.inf
        return Gain(float(np.mean(gains)) if gains else 0.0, error)


def objective_value(objective: str, scores: Sequence[TrackingScores]) -> float:
    """The mean of one figure over the frame rates."""
    return float(np.mean([OBJECTIVES[objective](one) for one in scores]))


def _prepare(scene: TuningScene, step: int) -> _Prepared:
    thinned = scene.every(step)
    if not thinned.has_objects:
        which = f"every {step}th frame of the part" if step > 1 else "the part"
        raise ConfigError(f"{scene.name}: no object that counts in {which} that is used; take more frames")
    return _Prepared(thinned.truth, tuple(thinned.detections), thinned.detections.size)


def _parts(scene: TuningScene, every: Sequence[int]) -> list[tuple[TrackingTruth, ...]]:
    """The truth of consecutive parts, each at every frame rate; parts with nothing to find are left out."""
    parts = [[part.every(step) for step in every] for part in scene.cut(_PARTS)]
    return [tuple(one.truth for one in part) for part in parts if all(one.has_objects for one in part)]


def _associate(config: TrackerConfig, scene: _Prepared) -> TrackingResult:
    """What a new tracker makes of the detections."""
    tracker, collected = Tracker(config), ResultCollector()
    for frame in scene.frames:
        tracks = tracker.update(frame.detections, frame.time_s, camera=frame.camera, size=scene.size, frame=frame.index)
        collected.add(frame.index, tracks)
    return collected.result(one_class=True)
