"""All figures of the usual protocol, of a sequence, of several, and of several classes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lookonce.evaluation.tracking.clear import ClearScores
from lookonce.evaluation.tracking.hota import HotaScores
from lookonce.evaluation.tracking.identity import IdentityScores

__all__ = ["TrackingCounts", "TrackingScores"]


@dataclass(frozen=True, slots=True)
class TrackingCounts:
    """What was compared, after everything that does not count was left out.

    Attributes:
        truth_boxes: true boxes.
        result_boxes: boxes of the result.
        objects: identities of the truth, summed over sequences.
        tracks: identities of the result, summed over sequences.
        frames: that were looked at.
    """

    truth_boxes: int
    result_boxes: int
    objects: int
    tracks: int
    frames: int

    @classmethod
    def sum_of(cls, counts: Sequence[TrackingCounts]) -> TrackingCounts:
        """The sums over several sequences."""
        return cls(*(sum(getattr(one, name) for one in counts) for name in cls.__slots__))


@dataclass(frozen=True, slots=True)
class TrackingScores:
    """What ``evaluate_tracking`` says under the protocol ``trackeval``: every figure equals TrackEval's.

    Attributes:
        clear: MOTA and what belongs to it, at IoU 0.5.
        identity: IDF1 and what belongs to it, at IoU 0.5.
        hota: HOTA and what belongs to it, at IoU 0.05 to 0.95.
        counts: how much was compared.
        left_out: what of truth and result did not count: why -> number of rows. Nothing is left out that is not here.
    """

    clear: ClearScores
    identity: IdentityScores
    hota: HotaScores
    counts: TrackingCounts
    left_out: Mapping[str, int]

    @classmethod
    def sum_of(cls, scores: Sequence[TrackingScores]) -> TrackingScores:
        """The figures over several sequences."""
        left_out: Counter[str] = Counter()
        for one in scores:
            left_out.update(one.left_out)
        return cls(
            clear=ClearScores.sum_of([one.clear for one in scores]),
            identity=IdentityScores.sum_of([one.identity for one in scores]),
            hota=HotaScores.sum_of([one.hota for one in scores]),
            counts=TrackingCounts.sum_of([one.counts for one in scores]),
            left_out=dict(left_out),
        )
