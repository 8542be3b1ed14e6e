"""Which detection may be which object, and what speaks for it besides appearance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import iou_of_pairs
from lookonce.distances import Quantized
from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.motion import boxes_around
from lookonce.tracking.motion_config import MotionConfig
from lookonce.tracking.objects import Objects
from lookonce.tracking.overlapping import Overlaps
from lookonce.tracking.pairs import TooManyPairsError, near_pairs

__all__ = ["FARTHEST", "LARGEST_DEVIATION", "TOUCHING", "Frame", "Pairs", "find_pairs"]

LARGEST_DEVIATION = 4.0
"""Standard deviations: pairs farther apart are not looked at."""

FARTHEST = 12.0
"""Boxes, in x and in y: farther away nobody is looked for, however long ago it was seen."""

TOUCHING = 0.1
"""Overlap from which an object and a detection of another are near enough to be mistaken."""

_MOST_PAIRS = 2_000_000  # half a gigabyte
_MANY = 100  # usable rows: if they fill their picture as a crowd does, nobody looks for room in it

_TOUCHING_REACH = 0.82  # of the longest side: boxes of one size farther apart have an IoU below TOUCHING
_WORST_SIZE = -4.0  # a part of an object that is seen alone must not end it


@dataclass(slots=True)
class Frame:
    """One frame's rows as the rule needs them; N rows.

    Attributes:
        xyxy: (N, 4) float64, px; long columns.
        states: (N, 4) float64, ``box_states``.
        scores: (N,) float64.
        labels: (N,) int64.
        looks: quantized descriptors of N rows, or None.
        is_usable: (N,) bool, rows that are neither too weak nor a second box of one object.
        is_high: (N,) bool, usable rows of high score.
        overlaps: among all rows.
        border: xyxy of the picture, px, as far as it is known.
        object_of: (N,) int64, the place among the objects that was found; -1 = none.
        has_jumped: (N,) bool, whether the object turns out to be a fast one, to have turned, or to be alone.
        is_alone: (N,) bool, whether the object and the row had only each other.
        reported: (N, 4) float32, the boxes to give out.
        shares: (N,) float64 of the rows' own objects, as ``own_shares`` has them; None: all are certain.
        jolt: (2,) float64 px, how far the whole picture has jumped; None: it has not.
    """

    xyxy: NDArray[np.float64]
    states: NDArray[np.float64]
    scores: NDArray[np.float64]
    labels: NDArray[np.int64]
    looks: Quantized | None
    is_usable: NDArray[np.bool_]
    is_high: NDArray[np.bool_]
    overlaps: Overlaps
    border: tuple[float, float, float, float]
    object_of: NDArray[np.int64]
    has_jumped: NDArray[np.bool_]
    is_alone: NDArray[np.bool_]
    reported: NDArray[np.float32]
    shares: NDArray[np.float64] | None = None
    jolt: NDArray[np.float64] | None = None


@dataclass(slots=True)
class Pairs:
    """Objects and detections that are near each other, K pairs in rising order.

    Attributes:
        objects, rows: (K,) int64.
        gains: (K,) float64, without appearance.
        overlap: (K,) float64, IoU of the expected box and the detection.
        deviation: (K,) float64, distance from the expected place in standard deviations.
        is_jump: (K,) bool, likelier if the object is a fast one, seen once before, or turns.
        boxes: (4, P) float64, where the objects are expected.
        is_taken: (P,) bool, objects that have a row by now.
    """

    objects: NDArray[np.int64]
    rows: NDArray[np.int64]
    gains: NDArray[np.float64]
    overlap: NDArray[np.float64]
    deviation: NDArray[np.float64]
    is_jump: NDArray[np.bool_]
    boxes: NDArray[np.float64]
    is_taken: NDArray[np.bool_]

    def are_left(self, frame: Frame) -> NDArray[np.bool_]:
        """(K,) bool: pairs of which neither the object nor the row of ``frame`` has been taken."""
        are_left: NDArray[np.bool_] = frame.object_of[self.rows] < 0
        are_left &= ~self.is_taken[self.objects]
        return are_left


@dataclass(slots=True)
class _Belief:
    """Where P objects are believed to be, around the expected places.

    Attributes:
        variance: (P,) px² of each coordinate.
        certainty: (P,) what a detection at the expected place gains.
    """

    variance: NDArray[np.float64]
    certainty: NDArray[np.float64]

    def reach(self, best_look: float) -> NDArray[np.float64]:
        """(P,) px, how far out a pair can gain anything with the best look."""
        best = self.certainty + best_look
        return np.minimum(LARGEST_DEVIATION, np.sqrt(2.0 * np.maximum(best, 0.0))) * np.sqrt(self.variance)

    def gains(
        self, objects: NDArray[np.int64], squared: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(K,) gains, minus infinity beyond reach, and deviations of ``objects`` (K,) at ``squared`` distances, px²."""
        deviation = squared / self.variance[objects]
        np.sqrt(deviation, out=deviation)
        gains = -0.5 * deviation**2
        gains += self.certainty[objects]
        gains[deviation > LARGEST_DEVIATION] = -np.inf
        return gains, deviation


@dataclass(slots=True)
class _Surprises:
    """What P objects may do that their filters do not expect: new ones may be fast, and those just seen may turn.

    Attributes:
        variance: (P,) px², of places if they do.
        log_share: (P,) logarithm of the share that does; minus infinity: none.
    """

    variance: NDArray[np.float64]
    log_share: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        objects: Objects,
        unseen_s: NDArray[np.float64],
        was_seen: NDArray[np.bool_],
        variance: NDArray[np.float64],
        config: MotionConfig,
    ) -> _Surprises | None:
        """Those of ``objects``; None: nobody may surprise."""
        is_new = objects.hits == 1
        may_turn = was_seen & (unseen_s * config.turn_speed > config.place_noise)  # else it is lost in the noise
        if not np.count_nonzero(may_turn | is_new):
            return None
        log_share = np.where(may_turn, _logarithm(config.turn_share), -np.inf)
        log_share[is_new] = _logarithm(config.jump_share)
        return cls(variance + objects.motions.more_speed(is_new, config) * unseen_s**2, log_share)


def _logarithm(share: float) -> float:
    return math.log(share) if share > 0 else -math.inf


def find_pairs(
    objects: Objects,
    unseen_s: NDArray[np.float64],
    was_seen: NDArray[np.bool_],
    frame: Frame,
    config: DefaultConfig,
) -> Pairs:
    """Pairs within reach. Gains are logarithms of likelihood ratios: this object against one anywhere in the crowd.

    Args:
        objects: P of them, where they are expected now.
        unseen_s: (P,) since when each was not seen.
        was_seen: (P,) bool, in the frame before.
        frame: its rows.
        config: the settings.
    """
    values = objects.motions.values
    size = np.exp(values[2:4])
    side = np.maximum(size[0], size[1])
    variance = objects.motions.place_variance + (config.motion.place_noise * side) ** 2
    surprises = _Surprises.of(objects, unseen_s, was_seen, variance, config.motion)
    room = (config.crowd_box * side) ** 2
    usual, other = _beliefs(room, variance, surprises, config)
    # Farther out not even the best look makes a gain; a box that overlaps is looked at in any case.
    best_look = config.appearance_absent if frame.looks is None else config.best_look
    reach, widest = usual.reach(best_look), variance
    if other is not None:
        reach = np.maximum(reach, other.reach(best_look))
        widest = np.where(other.certainty > -np.inf, other.variance, variance)
    farthest = np.minimum(LARGEST_DEVIATION * np.sqrt(widest), FARTHEST * side)
    wide = (was_seen & (np.minimum(4 * farthest**2, _room_in(frame)) > room)).nonzero()[0]
    reach[wide] = farthest[wide]
    of_object, rows, are_all = _near_rows(objects.motions.place, np.minimum(reach, FARTHEST * side), side, frame)
    if len(wide) and are_all:
        counts = np.bincount(of_object, minlength=len(side))[wide]
        room[wide] = np.maximum(room[wide], _rooms(values[:2, wide], farthest[wide], side[wide], counts, frame.border))
        usual, other = _beliefs(room, variance, surprises, config)
    apart = frame.states.T.take(rows, axis=1)
    apart -= values[:4].take(of_object, axis=1)
    apart *= apart
    squared, resized = apart[0] + apart[1], apart[2] + apart[3]
    gains, deviation = usual.gains(of_object, squared)
    is_jump = np.zeros(len(rows), np.bool_)
    if other is not None:
        gains_if, deviation_if = other.gains(of_object, squared)
        is_jump = gains_if > gains
        gains[is_jump], deviation[is_jump] = gains_if[is_jump], deviation_if[is_jump]
    size_variance = (objects.motions.size_variance + config.motion.size_noise**2)[of_object]
    gains += np.maximum(-0.5 * resized / size_variance, _WORST_SIZE)
    others = (objects.labels[of_object] != frame.labels[rows]).nonzero()[0]
    if len(others):
        gains[others] -= config.class_penalty
    boxes = boxes_around(values[:2], size).T
    overlap = iou_of_pairs(boxes.take(of_object, axis=1).T, frame.xyxy.T.take(rows, axis=1).T)
    return Pairs(of_object, rows, gains, overlap, deviation, is_jump, boxes, np.zeros(len(side), np.bool_))


def _beliefs(
    room: NDArray[np.float64], variance: NDArray[np.float64], surprises: _Surprises | None, config: DefaultConfig
) -> tuple[_Belief, _Belief | None]:
    """What is believed of objects as they are expected, and if they surprise; ``room`` (P,) px² for each detection.

    Where they surprise, the place speaks without a limit: else every new object would.
    """
    area = room / (2 * math.pi)
    usual = _Belief(variance, np.maximum(np.log(area / variance), -config.place_limit))
    if surprises is None:
        return usual, None
    return usual, _Belief(surprises.variance, np.log(area / surprises.variance) + surprises.log_share)


def _room_in(frame: Frame) -> float:
    """px² of the picture for each usable row; without end for few, of which nobody knows how large their picture is."""
    count = np.count_nonzero(frame.is_usable)
    left, top, right, bottom = frame.border
    return (right - left) * (bottom - top) / count if count > _MANY else math.inf


def _rooms(
    place: NDArray[np.float64],
    reach: NDArray[np.float64],
    side: NDArray[np.float64],
    counts: NDArray[np.int64],
    border: tuple[float, float, float, float],
) -> NDArray[np.float64]:
    """(M,) px², the area that each detection has for itself where objects may be: one other in all that is looked at.

    To others besides the one that may be the object only what is seen of the square counts.

    Args:
        place: (2, M) px.
        reach: (M,) px, half the side of the square.
        side: (M,) px, of the boxes.
        counts: (M,) detections in the square.
        border: xyxy of the picture.
    """
    left, top, right, bottom = border
    (x, y), whole = place, (2 * reach) ** 2
    width = np.maximum(np.minimum(x + reach, right) - np.maximum(x - reach, left), side)
    height = np.maximum(np.minimum(y + reach, bottom) - np.maximum(y - reach, top), side)
    rooms: NDArray[np.float64] = 1 / (np.maximum(counts - 1, 0) / (width * height) + 1 / whole)
    return rooms


def _near_rows(
    place: NDArray[np.float64], reach: NDArray[np.float64], side: NDArray[np.float64], frame: Frame
) -> tuple[NDArray[np.intp], NDArray[np.intp], bool]:
    """Objects and usable rows (K,) that are within reach or may overlap; of too many only those that may overlap.

    The last answer says whether these are all.
    ``place`` (P, 2), ``reach`` (P,) and longer ``side`` (P,) of the objects.
    """
    usable = frame.is_usable.nonzero()[0]
    is_all = len(usable) == len(frame.scores)
    columns = frame.states.T[:2]
    points = columns.T if is_all else columns.take(usable, axis=1).T
    touching, are_all = _TOUCHING_REACH * side, True
    try:
        of_object, rows = near_pairs(place, np.maximum(reach, touching), points, _MOST_PAIRS)
    except TooManyPairsError:
        (of_object, rows), are_all = near_pairs(place, touching, points), False
    return of_object, rows if is_all else usable[rows], are_all
