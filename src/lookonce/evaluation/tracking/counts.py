"""Counts of the CLEAR figures and what protocols agree on how to make of them."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ClearCounts", "share"]


def share(part: float, whole: float) -> float:
    """``part / whole``; 0 where ``whole`` is 0."""
    return part / whole if whole else 0.0


@dataclass(frozen=True, slots=True)
class ClearCounts:
    """What is counted, and the rates that all protocols make of it in the same way. A rate of nothing is 0.

    Attributes:
        true_positives: matches: true boxes found.
        misses: true boxes not found.
        false_positives: boxes of the result that found nothing.
        id_switches: matches of an object whose last match was with another track.
        mostly_tracked: objects that are found in more than 80 % of their frames.
        partly_tracked: of the others those found in 20 % or more.
        mostly_lost: the other objects.
        fragmentations: how often the tracking of an object is interrupted.
        overlap_sum: sum of the IoU of the matches.
        frames: that count.
    """

    true_positives: int
    misses: int
    false_positives: int
    id_switches: int
    mostly_tracked: int
    partly_tracked: int
    mostly_lost: int
    fragmentations: int
    overlap_sum: float
    frames: int

    @property
    def mota(self) -> float:
        """1 - (misses + false positives + ID switches) / true boxes; 1 at most, may be negative."""
        return share(self.true_positives - self.false_positives - self.id_switches, self.true_positives + self.misses)

    @property
    def motp(self) -> float:
        """Mean IoU of the matches."""
        return share(self.overlap_sum, self.true_positives)

    @property
    def recall(self) -> float:
        """Of the true boxes those found."""
        return share(self.true_positives, self.true_positives + self.misses)

    @property
    def precision(self) -> float:
        """Of the result's boxes those that found something."""
        return share(self.true_positives, self.true_positives + self.false_positives)

    @property
    def false_positives_per_frame(self) -> float:
        """False positives / frames."""
        return share(self.false_positives, self.frames)

    @property
    def mostly_tracked_share(self) -> float:
        """Of the objects those mostly tracked."""
        return share(self.mostly_tracked, self._objects)

    @property
    def partly_tracked_share(self) -> float:
        """Of the objects those partly tracked."""
        return share(self.partly_tracked, self._objects)

    @property
    def mostly_lost_share(self) -> float:
        """Of the objects those mostly lost."""
        return share(self.mostly_lost, self._objects)

    @property
    def _objects(self) -> int:
        return self.mostly_tracked + self.partly_tracked + self.mostly_lost
