"""The identity figures, as TrackEval has them.

E. Ristani, F. Solera, R. Zou, R. Cucchiara, C. Tomasi, "Performance measures and a data set for multi-target,
multi-camera tracking", ECCV workshops 2016.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lookonce.evaluation.tracking.counts import share
from lookonce.evaluation.tracking.matching import best_sum
from lookonce.evaluation.tracking.overlaps import Scene
from lookonce.evaluation.tracking.pair_counts import Meetings

__all__ = ["IdentityScores", "identity_scores"]


@dataclass(frozen=True, slots=True)
class IdentityScores:
    """Figures of one choice for the whole sequence which track belongs to which object; a rate of nothing is 0.

    Attributes:
        idtp: true boxes found, with an IoU of 0.5 or more, by the track that belongs to their object.
        idfn: the other true boxes.
        idfp: the other boxes of the result.
    """

    idtp: int
    idfn: int
    idfp: int

    @property
    def idf1(self) -> float:
        """IDF1 = IDTP / (IDTP + IDFN / 2 + IDFP / 2)."""
        return share(self.idtp, self.idtp + 0.5 * self.idfn + 0.5 * self.idfp)

    @property
    def idp(self) -> float:
        """IDP = IDTP / (IDTP + IDFP)."""
        return share(self.idtp, self.idtp + self.idfp)

    @property
    def idr(self) -> float:
        """IDR = IDTP / (IDTP + IDFN)."""
        return share(self.idtp, self.idtp + self.idfn)

    @classmethod
    def sum_of(cls, scores: Sequence[IdentityScores]) -> IdentityScores:
        """The figures over several sequences: their counts added, the rates from the sums."""
        return cls(*(sum(getattr(one, name) for one in scores) for name in cls.__slots__))


def identity_scores(scene: Scene, meetings: Meetings) -> IdentityScores:
    """The figures of a sequence; ``meetings`` has all of its frames.

    To make IDFN + IDFP smallest is to make IDTP largest: each object and track without the other adds its whole length,
    each pair that belongs together its frames less. Which of several best choices is taken changes no figure.
    """
    places = np.flatnonzero(meetings.near)
    objects = meetings.objects[places]
    order = np.argsort(objects, kind="stable")
    near = meetings.near[places][order].astype(np.float64)
    tp = int(best_sum(objects[order], meetings.tracks[places][order], near))
    return IdentityScores(tp, len(scene.truth) - tp, len(scene.result) - tp)
