"""JPDA and MHT on the parts of Stone Soup (MIT): Kalman filters on box centres, gated, with bounded hypotheses."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.contenders.online import frame_by_frame
from lookonce.compare.detections import DetectedFrame, DetectedSequence

__all__ = ["associate_jpda", "associate_mht"]

# Distances in units of the median box height of the sequence, so that one set of numbers serves all.
_MEASURED = 0.1  # standard deviation of a detection's centre
_FIRST_SPEED = 1.0  # ... of a new object's speed, heights a second
_DRIFT = 1.0  # power of the noise of the speed
_PROBABILITY = 0.9  # that an object is detected
_GATE = 0.99  # probability that an object's detection lies in its gate
_CLUTTER = 1.0  # false detections a frame
_MEMORY_S = 1.0  # a track without detection for longer ends, as in the package `trackers`
_MIN_LENGTH = 3  # shorter tracks are not told, as with SORT
_WINDOW = 3  # frames over which MHT keeps alternatives
_MOST_HYPOTHESES = 5  # of one track, beside those that keep the assignment possible
_REACH = 4.0  # heights: what is farther from the prediction is not looked at; beyond the gate

_START = datetime(2000, 1, 1)


def associate_jpda(sequence: DetectedSequence) -> NDArray[np.int64]:
    """Ids of all rows: each track's state is a mean over its gated detections, weighted by their joint probability.

    A detection gets the id of the track that it most probably belongs to, if that is more probable than a miss.
    """
    tracker = _Jpda(_Models(sequence))
    return frame_by_frame(sequence, tracker.update)


def associate_mht(sequence: DetectedSequence) -> NDArray[np.int64]:
    """Ids of all rows: multi-frame assignment over a sliding window, the form of MHT that Stone Soup has.

    A row's id is settled when the window has passed it.
    """
    tracker = _Mht(_Models(sequence))
    for frame in sequence:
        tracker.update(frame)
    return tracker.ids(sequence)


class _Models:
    """Motion, measurement and hypotheses in units of the median box height."""

    def __init__(self, sequence: DetectedSequence) -> None:
        from stonesoup.hypothesiser.probability import PDAHypothesiser
        from stonesoup.models.measurement.linear import LinearGaussian
        from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
        from stonesoup.predictor.kalman import KalmanPredictor
        from stonesoup.updater.kalman import KalmanUpdater

        boxes = sequence.xyxy
        self.unit = float(np.median(boxes[:, 3] - boxes[:, 1])) if len(boxes) else 1.0
        extent = np.ptp(boxes.reshape(-1, 2), axis=0) / self.unit if len(boxes) else np.ones(2)
        self.area = float(np.prod(np.maximum(extent, 1.0)))
        self.measurement = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=np.eye(2) * _MEASURED**2)
        motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(_DRIFT), ConstantVelocity(_DRIFT)])
        self.predictor = KalmanPredictor(motion)
        self.updater = KalmanUpdater(self.measurement)
        self.hypothesiser = PDAHypothesiser(
            self.predictor,
            self.updater,
            clutter_spatial_density=_CLUTTER / self.area,
            prob_detect=_PROBABILITY,
            prob_gate=_GATE,
        )
        self.covariance = np.diag([_MEASURED**2, _FIRST_SPEED**2] * 2)

    def detections(self, frame: DetectedFrame) -> tuple[list[Any], datetime]:
        """Measurements of the box centres, in the order of the rows; each carries its row."""
        from stonesoup.types.detection import Detection

        when = _START + timedelta(seconds=frame.time_s)
        xyxy = frame.detections.xyxy.astype(np.float64) / self.unit
        centres = (xyxy[:, :2] + xyxy[:, 2:]) / 2
        made = [
            Detection(centre.reshape(2, 1), timestamp=when, measurement_model=self.measurement, metadata={"row": row})
            for row, centre in enumerate(centres)
        ]
        return made, when

    def near(self, hypothesiser: Any) -> Any:
        """The hypothesiser, asked only about detections within reach: what is far away has no weight."""
        return _Near(hypothesiser, self.predictor)

    def first_state(self, detection: Any) -> NDArray[np.float64]:
        """Where a new track starts: at the detection, at rest."""
        x, y = detection.state_vector.ravel().tolist()
        return np.array([[x], [0.0], [y], [0.0]])


@dataclass(slots=True)
class _Near:
    """Looks at the nearest detections only; for the rest as the hypothesiser that it stands before."""

    hypothesiser: Any
    predictor: Any

    def hypothesise(self, track: Any, detections: Any, timestamp: datetime, **more: Any) -> Any:
        state = self.predictor.predict(track, timestamp=timestamp).state_vector
        x, y = float(state[0, 0]), float(state[2, 0])
        close = [
            one
            for one in detections
            if abs(float(one.state_vector[0, 0]) - x) <= _REACH and abs(float(one.state_vector[1, 0]) - y) <= _REACH
        ]
        return self.hypothesiser.hypothesise(track, close, timestamp, **more)


class _Jpda:
    """Tracks of one sequence."""

    def __init__(self, models: _Models) -> None:
        from stonesoup.dataassociator.probability import JPDAwithEHM2
        from stonesoup.updater.probability import PDAUpdater

        self._models = models
        self._associator = JPDAwithEHM2(models.near(models.hypothesiser))
        self._updater = PDAUpdater(models.measurement)
        self._tracks: dict[Any, int] = {}  # track -> id
        self._seen_s: dict[int, float] = {}
        self._length: defaultdict[int, int] = defaultdict(int)
        self._made = 0

    def update(self, frame: DetectedFrame) -> NDArray[np.int64]:
        from stonesoup.types.state import GaussianState
        from stonesoup.types.track import Track

        detections, when = self._models.detections(frame)
        ids = np.full(len(detections), -1, np.int64)
        best = np.zeros(len(detections))
        is_claimed = np.zeros(len(detections), np.bool_)
        hypotheses = self._associator.associate(set(self._tracks), set(detections), when) if self._tracks else {}
        for track, hypothesis in sorted(hypotheses.items(), key=lambda pair: self._tracks[pair[0]]):
            number = self._tracks[track]
            track.append(self._updater.update(hypothesis))
            likely = max(hypothesis, key=lambda one: float(one.probability))
            for one in hypothesis:
                if one:
                    is_claimed[one.measurement.metadata["row"]] |= float(one.probability) > 1 - _GATE
            if likely:
                row, probability = likely.measurement.metadata["row"], float(likely.probability)
                self._seen_s[number] = frame.time_s
                self._length[number] += 1
                if probability > best[row] and self._length[number] >= _MIN_LENGTH:
                    ids[row], best[row] = number, probability
        self._tracks = {
            track: number for track, number in self._tracks.items() if frame.time_s - self._seen_s[number] <= _MEMORY_S
        }
        for row in np.flatnonzero(~is_claimed).tolist():
            self._made += 1
            state = GaussianState(self._models.first_state(detections[row]), self._models.covariance, timestamp=when)
            self._tracks[Track([state])] = self._made
            self._seen_s[self._made], self._length[self._made] = frame.time_s, 1
        return ids


@dataclass(slots=True)
class _Hypotheses:
    """A track of MHT: the frame and time of its start, when it was last found, and its best hypothesis.

    Of the latter the tags, one a frame: the row from 1, 0 = missed.
    """

    first_frame: int
    last_s: float
    tags: list[int]


class _Mht:
    """Tracks of one sequence, each a mixture of hypotheses whose tags are the rows of every frame (0 = missed)."""

    def __init__(self, models: _Models) -> None:
        from stonesoup.dataassociator.mfa import MFADataAssociator
        from stonesoup.hypothesiser.mfa import MFAHypothesiser

        self._models = models
        self._associator = MFADataAssociator(MFAHypothesiser(models.near(models.hypothesiser)), slide_window=_WINDOW)
        self._tracks: dict[Any, _Hypotheses] = {}
        self._ended: list[_Hypotheses] = []
        self._frame = -1

    def update(self, frame: DetectedFrame) -> None:
        from stonesoup.types.update import GaussianMixtureUpdate

        self._frame += 1
        detections, when = self._models.detections(frame)
        is_claimed = np.zeros(len(detections), np.bool_)
        hypotheses = self._associator.associate(list(self._tracks), detections, when) if self._tracks else {}
        for track, found in hypotheses.items():
            likely = _bounded(found)
            components = [self._models.updater.update(one) if one else one.prediction for one in likely]
            for one in likely:
                if one:
                    is_claimed[one.measurement.metadata["row"]] = True
            track.append(GaussianMixtureUpdate(components=components, hypothesis=found))
        self._end(frame.time_s)
        for row in np.flatnonzero(~is_claimed).tolist():
            self._start(detections[row], row, when, frame.time_s)

    def _start(self, detection: Any, row: int, when: datetime, time_s: float) -> None:
        from stonesoup.types.mixture import GaussianMixture
        from stonesoup.types.numeric import Probability
        from stonesoup.types.state import TaggedWeightedGaussianState
        from stonesoup.types.track import Track

        state = TaggedWeightedGaussianState(
            self._models.first_state(detection),
            self._models.covariance,
            timestamp=when,
            weight=Probability(1),
            tag=[row + 1],
        )
        self._tracks[Track([GaussianMixture([state])])] = _Hypotheses(self._frame, time_s, [row + 1])

    def _end(self, time_s: float) -> None:
        """Takes tracks away whose best hypothesis has missed for too long, and keeps what they were."""
        for track, one in list(self._tracks.items()):
            best = max(track.state.components, key=lambda component: float(component.weight))
            one.tags = list(best.tag)
            if one.tags[-1]:
                one.last_s = time_s
            if time_s - one.last_s > _MEMORY_S:
                del self._tracks[track]
                self._ended.append(one)

    def ids(self, sequence: DetectedSequence) -> NDArray[np.int64]:
        """Ids of all rows, tracks that are too short left out."""
        ids = np.full(len(sequence), -1, np.int64)
        number = 0
        for one in sorted([*self._ended, *self._tracks.values()], key=lambda track: track.first_frame):
            rows = [int(sequence.starts[one.first_frame + step]) + tag - 1 for step, tag in enumerate(one.tags) if tag]
            if len(rows) >= _MIN_LENGTH:
                number += 1
                ids[rows] = number
        return ids


def _bounded(found: Any) -> list[Any]:
    """The most likely hypotheses of a track, and those that give up their last detections.

    Whatever the window settles on, each track then has a hypothesis that contradicts no other track's.
    """
    by_tag = {tuple(one.prediction.tag): one for one in found}
    likely = sorted(by_tag, key=lambda tag: -float(by_tag[tag].prediction.weight))[:_MOST_HYPOTHESES]
    kept = dict.fromkeys(likely)
    for tag in likely:
        for missed in range(1, min(_WINDOW + 1, len(tag))):
            kept.setdefault((*tag[:-missed], *((0,) * missed)))
    return [by_tag[tag] for tag in kept if tag in by_tag]
