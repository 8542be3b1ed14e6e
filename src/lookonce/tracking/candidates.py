"""Which detection may be which object, and what speaks for it besides appearance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import iou_of_pairs
from lookonce.distances import Quantized
from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.motion import squared_lengths
from lookonce.tracking.objects import Objects
from lookonce.tracking.overlapping import Overlaps
from lookonce.tracking.pairs import near_pairs

__all__ = ["LARGEST_DEVIATION", "Frame", "Pairs", "find_pairs"]

LARGEST_DEVIATION = 4.0
"""Standard deviations: pairs farther apart are not looked at."""

_TOUCHING_REACH = 0.82  # of the longest side: boxes of one size farther apart have an IoU below 0.1
_WORST_SIZE = -4.0  # a part of an object that is seen alone must not end it


@dataclass(slots=True)
class Frame:
    """One frame's rows as the rule needs them; N rows.

    Attributes:
        xyxy: (N, 4) float64, px.
        states: (N, 4) float64, ``box_states``.
        scores: (N,) float64.
        labels: (N,) int64.
        looks: quantized descriptors of N rows, or None.
        is_usable: (N,) bool, rows that are neither too weak nor a second box of one object.
        is_high: (N,) bool, usable rows of high score.
        overlaps: among all rows.
        object_of: (N,) int64, the place among the objects that was found; -1 = none.
        has_jumped: (N,) bool, whether the object turns out to be a fast one.
        order: (N,) int64, all rows, best first.
    """

    xyxy: NDArray[np.float64]
    states: NDArray[np.float64]
    scores: NDArray[np.float64]
    labels: NDArray[np.int64]
    looks: Quantized | None
    is_usable: NDArray[np.bool_]
    is_high: NDArray[np.bool_]
    overlaps: Overlaps
    object_of: NDArray[np.int64]
    has_jumped: NDArray[np.bool_]
    order: NDArray[np.int64]


@dataclass(slots=True)
class Pairs:
    """Objects and detections that are near each other, K pairs in rising order.

    Attributes:
        objects, rows: (K,) int64.
        gains: (K,) float64, without appearance.
        overlap: (K,) float64, IoU of the expected box and the detection.
        deviation: (K,) float64, distance from the expected place in standard deviations.
        is_jump: (K,) bool, likelier if the object is a fast one, seen once before.
        distance: (K,) float64, of the descriptors; NaN where it was not looked at, infinite where there is none.
    """

    objects: NDArray[np.int64]
    rows: NDArray[np.int64]
    gains: NDArray[np.float64]
    overlap: NDArray[np.float64]
    deviation: NDArray[np.float64]
    is_jump: NDArray[np.bool_]
    distance: NDArray[np.float64]


def find_pairs(objects: Objects, frame: Frame, now_s: float, config: DefaultConfig) -> Pairs:
    """Pairs within reach. Gains are logarithms of likelihood ratios: this object against one anywhere in the crowd."""
    motions = objects.motions
    width, height = np.exp(motions.log_size).T
    noise = (config.motion.place_noise * height) ** 2
    variance = motions.place_variance + noise
    may_jump = (objects.hits == 1) & (config.motion.jump_share > 0)
    fast_variance = variance
    if may_jump.any():
        fast_variance = np.where(may_jump, motions.widened(now_s - objects.seen_s, config.motion) + noise, variance)
    area = (config.crowd_box * height) ** 2 / (2 * math.pi)
    # Farther out not even the best look makes a gain; a box that overlaps is looked at in any case.
    best = np.maximum(np.log(area / fast_variance) + config.appearance_limit, 0)
    reach = np.minimum(LARGEST_DEVIATION, np.sqrt(2 * best)) * np.sqrt(fast_variance)
    reach = np.maximum(reach, _TOUCHING_REACH * np.maximum(width, height))
    usable = np.flatnonzero(frame.is_usable)
    of_object, rows = near_pairs(motions.place, reach, frame.states[usable, :2])
    rows = usable[rows]
    states = frame.states.take(rows, axis=0)
    squared = squared_lengths(states[:, :2] - motions.place.take(of_object, axis=0))
    gains, deviation = _place_gains(squared, area, variance, of_object)
    is_jump = may_jump[of_object]
    if is_jump.any():
        fast_gains, fast_deviation = _place_gains(squared, area, fast_variance, of_object)
        fast_gains += math.log(config.motion.jump_share)
        is_jump &= fast_gains > gains
        gains, deviation = np.where(is_jump, fast_gains, gains), np.where(is_jump, fast_deviation, deviation)
    resized = squared_lengths(states[:, 2:] - motions.log_size.take(of_object, axis=0))
    size_variance = (motions.size_variance + config.motion.size_noise**2)[of_object]
    gains += np.maximum(-0.5 * resized / size_variance, _WORST_SIZE)
    gains -= config.class_penalty * (objects.labels[of_object] != frame.labels[rows])
    overlap = iou_of_pairs(motions.boxes().take(of_object, axis=0), frame.xyxy.take(rows, axis=0))
    return Pairs(of_object, rows, gains, overlap, deviation, is_jump, np.full(len(rows), np.nan))


def _place_gains(
    squared: NDArray[np.float64], area: NDArray[np.float64], variance: NDArray[np.float64], of_object: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(K,) gains, minus infinity beyond reach, and (K,) deviations of pairs that are ``squared`` px² apart."""
    deviation = np.sqrt(squared / variance[of_object])
    gains = np.log(area / variance)[of_object] - 0.5 * deviation**2
    gains[deviation > LARGEST_DEVIATION] = -np.inf
    return gains, deviation
