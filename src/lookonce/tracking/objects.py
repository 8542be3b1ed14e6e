"""What is known of each object, and whether it is one at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.config import check_numbers
from lookonce.structures import NO_ID
from lookonce.tracking.motion import MotionConfig, Motions, squared_lengths

__all__ = ["EvidenceConfig", "MovingScores", "Objects"]

_REMEMBERED = 5000  # scores
_CONVINCING = 200  # so many scores of moving objects say what is usual
_MOST_VOTES = 10.0  # a class that has been seen for long is outvoted after so much score for another


@dataclass(frozen=True, slots=True)
class EvidenceConfig:
    """When an object is taken as real: seen with confidence, or on its way. Detectors err where nothing moves.

    Attributes:
        hits: seen at least so often.
        score: a mean score (of about the last three) that is enough, 0 to 1. It is the most that is asked: once objects
            are on their way, what stands still needs no more than the lower scores among theirs.
        least_score: but never less than this.
        score_memory_s: how long such a score is remembered, fading with this time constant, s.
        travel: one travel is a way of so many box sizes (square root of the area).
        travels: so many travels are enough, whatever the score.
        travel_memory_s: for so long after the last of them, s.
    """

    hits: int = 2
    score: float = 0.7
    least_score: float = 0.45
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


@dataclass(slots=True)
class Objects:
    """P objects that are alive, in the order in which they were first seen.

    Attributes:
        serials: (P,) int64, from 0, never used twice; for objects that have no id yet.
        ids: (P,) int64; -1 = never confirmed so far.
        slots: (P,) int64, where ``Looks`` has their descriptors.
        labels: (P,) int64, the class by vote.
        votes: (P,) float64, how much score it is ahead.
        seen_s: (P,) float64, when last seen.
        hits: (P,) int64, how often seen.
        score_mean: (P,) float64, of about the last three.
        score_peak: (P,) float64, the highest such mean, fading.
        anchor: (P, 2) float64, px, where the last travel ended.
        travels: (P,) int64.
        travel_s: (P,) float64, when the last travel ended.
        is_real: (P,) bool, whether rows are given the id now.
        motions: their filters.
    """

    serials: NDArray[np.int64]
    ids: NDArray[np.int64]
    slots: NDArray[np.int64]
    labels: NDArray[np.int64]
    votes: NDArray[np.float64]
    seen_s: NDArray[np.float64]
    hits: NDArray[np.int64]
    score_mean: NDArray[np.float64]
    score_peak: NDArray[np.float64]
    anchor: NDArray[np.float64]
    travels: NDArray[np.int64]
    travel_s: NDArray[np.float64]
    is_real: NDArray[np.bool_]
    motions: Motions

    def __len__(self) -> int:
        return len(self.ids)

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
        return cls(
            serials=serials,
            ids=np.full(count, NO_ID, np.int64),
            slots=slots,
            labels=labels.copy(),
            votes=scores.copy(),
            seen_s=np.full(count, now_s),
            hits=np.ones(count, np.int64),
            score_mean=scores.copy(),
            score_peak=np.zeros(count),
            anchor=states[:, :2].copy(),
            travels=np.zeros(count, np.int64),
            travel_s=np.full(count, -np.inf),
            is_real=np.zeros(count, np.bool_),
            motions=Motions.begin(states, config),
        )

    def part(self, chosen: NDArray[np.bool_]) -> Objects:
        """The chosen objects (P,)."""
        places = np.flatnonzero(chosen)
        return _each(lambda values: values.take(places, axis=0), self)

    def joined(self, others: Objects) -> Objects:
        """These objects, then the others."""
        return _each(lambda *values: np.concatenate(values), self, others)

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
        faded = self.score_peak[objects] * np.exp((self.seen_s[objects] - now_s) / config.score_memory_s)
        self.seen_s[objects] = now_s
        self.hits[objects] = hits = self.hits[objects] + 1
        mean = self.score_mean[objects]
        self.score_mean[objects] = mean = mean + (scores - mean) / np.minimum(hits, 3)
        has_enough = hits >= config.hits
        self.score_peak[objects] = peak = np.maximum(np.where(has_enough, mean, 0.0), faded)
        self._travel_(objects, now_s, config)
        is_moving = self.travels[objects] >= config.travels
        is_moving &= now_s - self.travel_s[objects] <= config.travel_memory_s
        moving.add(scores[is_moving])
        self.is_real[objects] = has_enough & ((peak >= moving.enough(config)) | is_moving)
        self._vote_(objects, labels, scores)

    def _travel_(self, objects: NDArray[np.int64], now_s: float, config: EvidenceConfig) -> None:
        place = self.motions.place.take(objects, axis=0)
        log_width, log_height = self.motions.log_size.take(objects, axis=0).T
        squared_way = squared_lengths(place - self.anchor.take(objects, axis=0))
        has_arrived = squared_way > config.travel**2 * np.exp(log_width + log_height)
        if has_arrived.any():
            arrived = objects[has_arrived]
            self.anchor[arrived] = place[has_arrived]
            self.travels[arrived] += 1
            self.travel_s[arrived] = now_s

    def _vote_(self, objects: NDArray[np.int64], labels: NDArray[np.int64], scores: NDArray[np.float64]) -> None:
        """Majority vote after Boyer and Moore, weighted by score: one class is ahead, others take from its lead."""
        is_same = self.labels[objects] == labels
        votes = self.votes[objects] + np.where(is_same, scores, -scores)
        is_beaten = votes < 0
        if is_beaten.any():
            self.labels[objects[is_beaten]] = labels[is_beaten]
        self.votes[objects] = np.minimum(np.abs(votes), _MOST_VOTES)


_MOTIONS = tuple(f.name for f in fields(Motions))
_OWN = tuple(f.name for f in fields(Objects) if f.name != "motions")


def _each(function: Callable[..., NDArray[Any]], *groups: Objects) -> Objects:
    """Objects made array by array from one or more others."""
    motions = Motions(*[function(*[getattr(one.motions, name) for one in groups]) for name in _MOTIONS])
    own = {name: function(*[getattr(one, name) for one in groups]) for name in _OWN}
    return Objects(**own, motions=motions)
