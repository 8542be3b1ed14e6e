"""The paper's tracking rule (section 3.3), preset ``paper``: appearance only, against the previous frame only."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.distances import FINE, Floats, Quantized, quantize, squared_distances
from lookonce.errors import ConfigError
from lookonce.structures import NO_ID, Detections, Tracks
from lookonce.tracking.greedy import assign_greedily
from lookonce.tracking.looks import median_of_three

__all__ = ["PaperConfig", "PaperObjects", "PaperRule"]

_NO_IDS = np.zeros(0, np.int64)
_NO_BOXES = np.zeros((0, 4), np.float32)


@dataclass(frozen=True, slots=True)
class PaperConfig:
    """Settings of the preset ``paper``.

    Attributes:
        match_threshold: largest Euclidean distance, between 0 and 2, of descriptors that may belong to one object.
            The paper calls it predefined and gives no value; this one is for descriptors of kind ``native``
            (`docs/log.md`). A model file that carries a calibrated value overrides it.
    """

    match_threshold: float = 0.7

    def __post_init__(self) -> None:
        if not (math.isfinite(self.match_threshold) and 0 < self.match_threshold <= 2):
            raise ConfigError(f"match_threshold={self.match_threshold}: expected above 0, at most 2")


@dataclass(slots=True)
class PaperObjects:
    """The objects of the previous frame, P of them, in the order of its rows.

    Attributes:
        ids: (P,) int64.
        seen: (P,) int64, how many descriptors each has had, counted up to 3.
        newest, second: (P, D) in quantized units, the last two descriptors; the second is valid where ``seen`` is 2 or
            more.
        references: P rows, what the next frame is compared with.
    """

    ids: NDArray[np.int64]
    seen: NDArray[np.int64]
    newest: Floats
    second: Floats
    references: Quantized


class PaperRule:
    """Matches each frame's descriptors with the objects of the frame before.

    The object's reference is the element-wise median of its last three descriptors once there are three, before that
    the newest one. Pairs above the threshold are dropped, then the smallest distance is taken first, each object and
    detection once. Detections that are left are new objects; objects that are left are forgotten.
    """

    def __init__(self, config: PaperConfig) -> None:
        self.config = config
        self.next_id = 1
        self.objects: PaperObjects | None = None
        self._limit = (config.match_threshold * FINE.scale) ** 2

    def update(self, detections: Detections) -> Tracks:
        """Identities for the rows of one frame; a row whose descriptor is zero gets none.

        Raises:
            ValueError: the detections have no descriptors, or of another length than before.
        """
        if detections.descriptors is None:
            raise ValueError("preset 'paper' matches descriptors; these detections have none (descriptors=None)")
        quantized = quantize(detections.descriptors)
        has_descriptor = quantized.squared_lengths > 0
        if has_descriptor.all():
            ids = self._identify(quantized)
        else:
            ids = np.full(len(detections), NO_ID, np.int64)
            ids[has_descriptor] = self._identify(quantized.part(has_descriptor))
        return Tracks(ids, detections.xyxy, detections.scores, detections.labels, _NO_IDS, _NO_BOXES)

    def _identify(self, descriptors: Quantized) -> NDArray[np.int64]:
        """Ids (N,) of N descriptors; they become the previous frame."""
        before = self.objects
        units = descriptors.units
        count = len(units)
        if before is None or not (count and len(before.ids)):
            first = self._new_ids(count)
            self.objects = PaperObjects(first, np.ones(count, np.int64), units, units, descriptors)
            return first
        size = before.newest.shape[1]
        if units.shape[1] != size:
            raise ValueError(f"descriptors: expected {size} values as before, got {units.shape[1]}")
        squared = squared_distances(before.references, descriptors)
        by_id = before.ids.argsort()  # of equal distances the lowest id wins
        object_of = assign_greedily(squared[by_id], self._limit)
        is_known = object_of >= 0
        object_of = by_id[object_of]  # of new rows: some object, whose values are never read
        ids: NDArray[np.int64] = np.where(is_known, before.ids[object_of], NO_ID)
        new = count - int(np.count_nonzero(is_known))
        if new:
            ids[~is_known] = self._new_ids(new)
        seen = np.where(is_known, np.minimum(before.seen[object_of] + 1, 3), 1)
        second, third = before.newest[object_of], before.second[object_of]
        self.objects = PaperObjects(ids, seen, units, second, _references(seen, descriptors, second, third))
        return ids

    def _new_ids(self, count: int) -> NDArray[np.int64]:
        first = self.next_id
        self.next_id += count
        return np.arange(first, self.next_id)


def _references(
    seen: NDArray[np.int64],
    newest: Quantized,
    second: Floats,
    third: Floats,
) -> Quantized:
    """What the next frame is compared with, P rows: the median of three, or the newest."""
    has_three = seen == 3
    count = np.count_nonzero(has_three)
    if count == 0:
        return newest
    if count == len(seen):
        return Quantized.of(median_of_three(newest.units, second, third))
    units = newest.units.copy()
    units[has_three] = median_of_three(units[has_three], second[has_three], third[has_three])
    return Quantized.of(units)
