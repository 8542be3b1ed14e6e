"""The figures of the UA-DETRAC protocol."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from lookonce.evaluation.tracking.clear import share

__all__ = ["DetracScores"]


@dataclass(frozen=True, slots=True)
class DetracScores:
    """What ``evaluate_tracking`` says under the protocol ``detrac``. A rate of nothing is 0.

    Attributes:
        true_positives: matches.
        misses: true boxes not found.
        false_positives: boxes of the result that found nothing.
        id_switches: matches of an object that was there in the frame before, too, and whose last match was with
            another track.
        mostly_tracked: objects that are found in more than 80 % of their frames.
        partly_tracked: the others found in 20 % or more.
        mostly_lost: the rest.
        fragmentations: how often an object that is found later again is lost, also where nobody could have found it.
        overlap_sum: sum of the IoU of the matches of 0.7 or more; matches that are only held are not in it.
        frames: that were looked at.
        left_out: what of truth and result did not count: why -> number of rows.
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
    left_out: Mapping[str, int] = field(default_factory=dict)

    @property
    def mota(self) -> float:
        """1 - (misses + false positives + ID switches) / true boxes; 1 at most, may be negative."""
        truth = self.true_positives + self.misses
        return share(self.true_positives - self.false_positives - self.id_switches, truth)

    @property
    def motal(self) -> float:
        """1 - (misses + false positives + log10(ID switches + 1)) / true boxes."""
        truth = self.true_positives + self.misses
        return share(self.true_positives - self.false_positives - math.log10(self.id_switches + 1), truth)

    @property
    def motp(self) -> float:
        """The sum of the IoU of matches of 0.7 or more over the number of all matches."""
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
        """The toolkit's false alarm rate."""
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

    @classmethod
    def sum_of(cls, scores: Sequence[DetracScores]) -> DetracScores:
        """The figures over several sequences: their counts added, the rates from the sums."""
        left_out: Counter[str] = Counter()
        for one in scores:
            left_out.update(one.left_out)
        counts = {name: sum(getattr(one, name) for one in scores) for name in cls.__slots__ if name != "left_out"}
        return cls(**counts, left_out=dict(left_out))
