"""The figures of the UA-DETRAC protocol."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

from lookonce.evaluation.tracking.counts import ClearCounts, share

__all__ = ["DetracScores"]


@dataclass(frozen=True, slots=True)
class DetracScores(ClearCounts):
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

    left_out: Mapping[str, int] = field(default_factory=dict)

    @property
    def motal(self) -> float:
        """1 - (misses + false positives + log10(ID switches + 1)) / true boxes."""
        truth = self.true_positives + self.misses
        return share(self.true_positives - self.false_positives - math.log10(self.id_switches + 1), truth)

    @classmethod
    def sum_of(cls, scores: Sequence[DetracScores]) -> DetracScores:
        """The figures over several sequences: their counts added, the rates from the sums."""
        left_out: Counter[str] = Counter()
        for one in scores:
            left_out.update(one.left_out)
        counts = {item.name: sum(getattr(one, item.name) for one in scores) for item in fields(ClearCounts)}
        return cls(**counts, left_out=dict(left_out))
