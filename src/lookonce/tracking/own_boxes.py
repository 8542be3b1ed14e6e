"""The boxes that a preset gives out where it makes them itself: steadier ones, and those of gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import Filled
from lookonce.tracking.candidates import Frame
from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.filling import PassedFrames
from lookonce.tracking.motion import Correction, log_sides
from lookonce.tracking.objects import Objects
from lookonce.tracking.steadying import CHANGED_S, Steadying, in_boxes

__all__ = ["OwnBoxes", "Sightings"]

_F = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sightings:
    """M objects that have a row of the frame.

    Attributes:
        rows: (M,) int64, of the frame.
        objects: (M,) int64, places among the objects.
        states: (M, 4) float64, ``box_states`` of the rows.
        seen_s: (M,) float64, when each was seen before.
        before: (9, M) float64, the surprise then, the box that was given out, and 1 where the camera has taken it out
            of the picture since.
    """

    rows: NDArray[np.intp]
    objects: NDArray[np.int64]
    states: _F
    seen_s: _F
    before: _F


class OwnBoxes:
    """Makes them for one stream.

    Args:
        config: the settings.
    """

    def __init__(self, config: DefaultConfig) -> None:
        self.is_steady = config.steady
        self.steadying = Steadying()
        self.passed = PassedFrames(config.fill_s)
        self.last_s = 0.0  # the time of the frame before

    def give_out(self, frame: Frame, objects: Objects, seen: Sightings, correction: Correction, now_s: float) -> _F:
        """The boxes (M, 4) of what is seen, by which filters were corrected; the frame and the objects get them."""
        surprise = in_boxes(correction.surprise, np.exp(log_sides(seen.states.T)))
        is_early = now_s - seen.seen_s <= max(CHANGED_S, 1.01 * (now_s - self.last_s))
        if not self.is_steady:
            boxes = frame.xyxy[seen.rows]
        else:
            boxes = self.steadying.boxes(correction, seen.states, now_s - seen.seen_s)
            frame.reported = frame.reported.copy()
            frame.reported[seen.rows] = boxes
            again = (is_early & objects.is_real[seen.objects] & (seen.before[0] < np.inf)).nonzero()[0]
            self.steadying.learn(seen.before[:4].take(again, axis=1), surprise.take(again, axis=1))
        surprise[:, ~is_early] = np.inf  # after a gap it says little of the detector
        objects.last[:, seen.objects] = np.concatenate([surprise, boxes.T, np.zeros((1, len(boxes)))])
        return boxes

    def end_frame(self, number: int, now_s: float) -> None:
        """The frame is done; it is called ``number``."""
        self.passed.add(number, now_s)
        self.last_s = now_s

    def fill(self, objects: Objects, seen: Sightings, boxes: _F, now_s: float) -> Filled:
        """Boxes for the frames in which real objects were missed in the picture; ``boxes`` (M, 4) are given out now."""
        missed = self.passed.have_missed(seen.seen_s, now_s)
        if len(missed):
            missed = missed[objects.is_real[seen.objects[missed]] & (seen.before[8][missed] == 0)]
        if not len(missed):
            return Filled.nothing()
        whose, before = seen.objects[missed], seen.before[4:8].T[missed]
        ids, labels = objects.ids[whose], objects.labels[whose]
        return self.passed.fill(ids, labels, seen.seen_s[missed], before, now_s, boxes[missed])
