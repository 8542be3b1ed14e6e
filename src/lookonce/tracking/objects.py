"""What is known of each object, and whether it is one at all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.config import check_numbers
from lookonce.structures import NO_ID
from lookonce.tracking.motion import Motions, boxes_around, moved, squared_lengths
from lookonce.tracking.motion_config import MotionConfig

__all__ = ["EvidenceConfig", "MovingScores", "Objects"]

_REMEMBERED = 5000  # scores
_CONVINCING = 200  # so many scores of moving objects say what is usual
_LABELS, _SURPRISE = 3, 11  # where these rows begin
_SAME_WAY = 0.5  # cosine of the angle between two travels
_FEWEST_SCORES = 3.0  # in a mean
_LEAST_S = 1e-3
_CLEAR = 1.0  # score, as much as one detection can have
_MOST_VOTES = 10.0  # a class that has been seen for long is outvoted after so much score for another


@dataclass(frozen=True, slots=True)
class EvidenceConfig:
    """When an object is taken as real: seen with confidence, or on its way. Detectors err where nothing moves.

    Attributes:
        hits: seen at least so often.
        score: a mean score that is enough, 0 to 1. It is the most that is asked: once objects are on their way, what
            stands still needs no more than the lower scores among theirs.
        least_score: but never less than this.
        score_mean_s: the mean is of about so long, s, and of three scores at least.
        score_memory_s: how long such a score is remembered, fading with this time constant, s.
        travel: one travel is a way of so many box sizes (square root of the area).
        travels: so many travels, each within 60 degrees of the one before, are enough, whatever the score.
        travel_memory_s: for so long after the last of them, s.
    """

    hits: int = 2
    score: float = 0.7
    least_score: float = 0.45
    score_mean_s: float = 1.0
    score_memory_s: float = 3.0
    travel: float = 0.5
    travels: int = 2
    travel_memory_s: float = 3.0

    def __post_init__(self) -> None:
        check_numbers(self, above_zero=("hits", "score_memory_s"))


class MovingScores:
    """Running mean and deviation of the scores of objects on their way, which are real whatever their score.

    Detectors differ in how sure they are. What stands still is compared with what moves in the same picture.
    """

    def __init__(self) -> None:
        self.count = self.mean = self.squares = 0.0  # squares: mean of squared differences

    def add(self, scores: NDArray[np.float64]) -> None:
        """More scores (M,); old ones fade after some thousands."""
        if not len(scores):
            return
        self.count = min(self.count + len(scores), _REMEMBERED)
        weight = min(1.0, len(scores) / self.count)
        mean = float(np.add.reduce(scores)) / len(scores)
        change, apart = mean - self.mean, scores - mean
        spread = float(np.add.reduce(apart * apart)) / len(scores) + (1 - weight) * change**2
        self.mean += weight * change
        self.squares += weight * (spread - self.squares)

    def enough(self, config: EvidenceConfig) -> float:
        """The score from which on an object is believed that does not move."""
        usual = min(config.score, max(config.least_score, self.mean - math.sqrt(max(self.squares, 0.0))))
        trust = min(1.0, self.count / _CONVINCING)
        return config.score + trust * (usual - config.score)


class Objects:
    """P objects that are alive, in the order in which they were first seen.

    The numbers lie in two matrices, a row for each kind, so that taking some objects is two operations; the attributes
    are views of the rows, to be changed in place.

    Args:
        whole: (6, P) int64, ``serials`` to ``travels``.
        values: (20, P) float64, ``votes`` to ``left_behind``.
        is_real: (P,) bool.
        motions: their filters.

    Attributes:
        serials: (P,) int64, from 0, never used twice; for objects that have no id yet.
        ids: (P,) int64; -1 = never confirmed so far.
        slots: (P,) int64, where ``Looks`` has their descriptors.
        labels: (P,) int64, the class by vote.
        hits: (P,) int64, how often seen.
        travels: (P,) int64.
        votes: (P,) float64, how much score the class is ahead; below 0 where another is, not clearly yet.
        seen_s: (P,) float64, when last seen.
        score_mean: (P,) float64, of the last ones.
        score_peak: (P,) float64, the highest such mean, fading.
        travel_s: (P,) float64, when the last travel ended.
        anchor: (P, 2) float64, px, where it ended.
        heading: (P, 2) float64, px, where it went.
        carried: (P, 2) float64, px, how far the camera's motion has moved each since it was last seen.
        surprise: (P, 4) float64, how far off the last detection was, as ``Steadying`` has it; infinite where that says
            nothing.
        box: (P, 4) float64, xyxy as given out when last seen, px.
        left_behind: (P,) float64, 1 where the camera has taken it out of the picture since then, else 0.
        last: (9, P) float64, these three as rows.
        is_real: (P,) bool, whether rows are given the id now.
    """

    def __init__(
        self,
        whole: NDArray[np.int64],
        values: NDArray[np.float64],
        is_real: NDArray[np.bool_],
        motions: Motions,
    ) -> None:
        self._whole, self._values, self.is_real, self.motions = whole, values, is_real, motions
        self.serials, self.ids, self.slots = whole[0], whole[1], whole[2]  # unpacking an array is slow
        self.labels, self.hits, self.travels = whole[3], whole[4], whole[5]
        self.votes, self.seen_s, self.score_mean = values[0], values[1], values[2]
        self.score_peak, self.travel_s = values[3], values[4]
        self.anchor: NDArray[np.float64] = values[5:7].T
        self.heading: NDArray[np.float64] = values[7:9].T
        self.carried: NDArray[np.float64] = values[9:11].T
        self.last: NDArray[np.float64] = values[_SURPRISE:]
        self.surprise: NDArray[np.float64] = values[11:15].T
        self.box: NDArray[np.float64] = values[15:19].T
        self.left_behind = values[19]

    def __len__(self) -> int:
        return len(self.is_real)

    @classmethod
    def begin(
        cls,
        serials: NDArray[np.int64],
        slots: NDArray[np.int64],
        labels: NDArray[np.int64],
        scores: NDArray[np.float64],
        states: NDArray[np.float64],
        now_s: float,
        config: MotionConfig,
    ) -> Objects:
        """Objects seen for the first time, P of them; ``states`` (P, 4) are ``box_states``."""
        count = len(serials)
        new = cls(
            np.zeros((6, count), np.int64),
            np.zeros((20, count)),
            np.zeros(count, np.bool_),
            Motions.begin(states, config),
        )
        new.serials[:], new.ids[:], new.slots[:], new.labels[:], new.hits[:] = serials, NO_ID, slots, labels, 1
        new.votes[:], new.seen_s[:], new.score_mean[:], new.travel_s[:] = scores, now_s, scores, -np.inf
        new.anchor[:] = states[:, :2]
        new.surprise[:] = np.inf
        new.box[:] = boxes_around(states.T[:2], np.exp(states.T[2:]))
        return new

    @classmethod
    def nobody(cls, config: MotionConfig) -> Objects:
        """No objects."""
        none, numbers = np.zeros(0, np.int64), np.zeros(0)
        return cls.begin(none, none, none, numbers, np.zeros((0, 4)), 0.0, config)

    def part(self, chosen: NDArray[np.bool_]) -> Objects:
        """The chosen objects (P,)."""
        places = chosen.nonzero()[0]
        whole, values = self._whole.take(places, axis=1), self._values.take(places, axis=1)
        return Objects(whole, values, self.is_real[places], self.motions.part(places))

    def joined(self, others: Objects) -> Objects:
        """These objects, then the others."""
        return Objects(
            np.concatenate([self._whole, others._whole], axis=1),
            np.concatenate([self._values, others._values], axis=1),
            np.concatenate([self.is_real, others.is_real]),
            self.motions.joined(others.motions),
        )

    def move_camera_(self, affine: NDArray[np.float64]) -> None:
        """Changes all places by an affine map (2, 3) of the picture before onto this one."""
        before = self.motions.place.copy()
        self.motions.move_camera_(affine)
        self.carried[:] += self.motions.place - before
        self.anchor[:] = moved(self.anchor, affine)
        self.heading[:] = np.ascontiguousarray(self.heading) @ affine[:, :2].T

    def are_carried(self) -> NDArray[np.bool_]:
        """(P,) bool: whom the camera has moved farther since they were last seen than they have gone themselves."""
        own = self.motions.place - 0.5 * (self.box[:, :2] + self.box[:, 2:]) - self.carried
        are_carried: NDArray[np.bool_] = squared_lengths(self.carried) > squared_lengths(own)
        return are_carried

    def see_(
        self,
        objects: NDArray[np.int64],
        labels: NDArray[np.int64],
        scores: NDArray[np.float64],
        now_s: float,
        config: EvidenceConfig,
        moving: MovingScores,
    ) -> None:
        """Changes ``objects`` (M,) and ``moving`` by what was seen of them; places are corrected before."""
        whole, values = self._whole[_LABELS:].take(objects, axis=1), self._values[:_SURPRISE].take(objects, axis=1)
        hits, travels = whole[1], whole[2]
        seen_s, mean, score_peak, travel_s = values[1], values[2], values[3], values[4]
        unseen_s = now_s - seen_s
        faded = score_peak * np.exp(unseen_s / -config.score_memory_s)
        seen_s[:] = now_s
        values[9:11] = 0.0
        hits += 1
        mean += (scores - mean) / np.minimum(
            hits, np.maximum(_FEWEST_SCORES, config.score_mean_s / np.maximum(unseen_s, _LEAST_S))
        )
        has_enough = hits >= config.hits
        np.maximum(np.where(has_enough, mean, 0.0), faded, out=score_peak)
        self._travel_(objects, whole, values, now_s, config)
        is_moving = travels >= config.travels
        is_moving &= now_s - travel_s <= config.travel_memory_s
        moving.add(scores[is_moving])
        self.is_real[objects] = has_enough & ((score_peak >= moving.enough(config)) | is_moving)
        _vote_(whole[0], values[0], labels, scores)
        self._whole[_LABELS:, objects], self._values[:_SURPRISE, objects] = whole, values

    def _travel_(
        self,
        objects: NDArray[np.int64],
        whole: NDArray[np.int64],
        values: NDArray[np.float64],
        now_s: float,
        config: EvidenceConfig,
    ) -> None:
        """Changes the numbers of those of ``objects`` (M,) that have come far from where they were."""
        state, anchor = self.motions.values[:4].take(objects, axis=1), values[5:7]
        way = state[:2] - anchor
        squared = way * way
        arrived = (squared[0] + squared[1] > config.travel**2 * np.exp(state[2] + state[3])).nonzero()[0]
        if not len(arrived):
            return
        heading, way = values[7:9], way.take(arrived, axis=1)
        before = heading.take(arrived, axis=1)
        along = way[0] * before[0] + way[1] * before[1]
        lengths = (way[0] * way[0] + way[1] * way[1]) * (before[0] * before[0] + before[1] * before[1])
        is_same_way = along >= _SAME_WAY * np.sqrt(lengths)
        whole[2][arrived] = np.where(is_same_way, whole[2][arrived] + 1, 1)
        values[4][arrived] = now_s
        for axis in (0, 1):
            anchor[axis][arrived] = state[axis][arrived]
            heading[axis][arrived] = way[axis]


def _vote_(
    mine: NDArray[np.int64], votes: NDArray[np.float64], labels: NDArray[np.int64], scores: NDArray[np.float64]
) -> None:
    """Majority vote after Boyer and Moore, weighted by score: one class is ahead, others take from its lead.

    Another takes over only when it is ahead by ``_CLEAR``, and then has that lead: classes that come in turn do not.

    Changes the class (M,) of objects and by how much it is ahead (M,), where ``labels`` (M,) were seen.
    """
    is_other = mine != labels
    if np.count_nonzero(is_other):
        scores = np.where(is_other, -scores, scores)
    votes += scores
    beaten = (votes < -_CLEAR).nonzero()[0]
    if len(beaten):
        mine[beaten], votes[beaten] = labels[beaten], _CLEAR
    np.minimum(votes, _MOST_VOTES, out=votes)
