"""The HOTA figures, as TrackEval has them.

J. Luiten, A. Osep, P. Dendorfer, P. Torr, A. Geiger, L. Leal-Taixe, B. Leibe, "HOTA: a higher order metric for
evaluating multi-object tracking", IJCV 129 (2021).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.tracking.matching import best_pairs
from lookonce.evaluation.tracking.overlaps import Pairs, Scene
from lookonce.evaluation.tracking.pair_counts import Meetings
from lookonce.structures import check_array

__all__ = ["ALPHAS", "HotaMatching", "HotaScores"]

ALPHAS = np.arange(0.05, 0.99, 0.05)
"""The 19 least overlaps, from 0.05 to 0.95, at which the figures are taken; rounded as TrackEval's."""
ALPHAS.flags.writeable = False

_EPS = np.finfo(np.float64).eps


@dataclass(frozen=True, slots=True)
class HotaScores:
    """The HOTA figures of one sequence or of several.

    Everything is known at each of the 19 overlaps of ``ALPHAS``: names with ``_by_alpha``, (19,) float64. The names
    without are the means of these; HOTA is a mean of roots, not a root of means.

    Attributes:
        tp_by_alpha: matches whose IoU is at least alpha.
        fn_by_alpha: true boxes without match.
        fp_by_alpha: boxes of the result without match.
        ass_a_by_alpha: association accuracy, the mean over the matches of TPA / (TPA + FNA + FPA).
        ass_re_by_alpha: association recall, the mean of TPA / (TPA + FNA).
        ass_pr_by_alpha: association precision, the mean of TPA / (TPA + FPA).
        loc_a_by_alpha: mean IoU of the matches; 1 without any.
    """

    tp_by_alpha: NDArray[np.float64]
    fn_by_alpha: NDArray[np.float64]
    fp_by_alpha: NDArray[np.float64]
    ass_a_by_alpha: NDArray[np.float64]
    ass_re_by_alpha: NDArray[np.float64]
    ass_pr_by_alpha: NDArray[np.float64]
    loc_a_by_alpha: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in self.__slots__:
            check_array(name, getattr(self, name), (len(ALPHAS),), np.float64)

    @property
    def det_a_by_alpha(self) -> NDArray[np.float64]:
        """Detection accuracy, TP / (TP + FN + FP)."""
        return self.tp_by_alpha / np.maximum(1, self.tp_by_alpha + self.fn_by_alpha + self.fp_by_alpha)

    @property
    def det_re_by_alpha(self) -> NDArray[np.float64]:
        """Detection recall, TP / (TP + FN)."""
        return self.tp_by_alpha / np.maximum(1, self.tp_by_alpha + self.fn_by_alpha)

    @property
    def det_pr_by_alpha(self) -> NDArray[np.float64]:
        """Detection precision, TP / (TP + FP)."""
        return self.tp_by_alpha / np.maximum(1, self.tp_by_alpha + self.fp_by_alpha)

    @property
    def hota_by_alpha(self) -> NDArray[np.float64]:
        """The root of detection accuracy times association accuracy."""
        return np.sqrt(self.det_a_by_alpha * self.ass_a_by_alpha)

    @property
    def owta_by_alpha(self) -> NDArray[np.float64]:
        """The root of detection recall times association accuracy: Y. Liu et al., "Opening up open world tracking"."""
        return np.sqrt(self.det_re_by_alpha * self.ass_a_by_alpha)

    @property
    def hota(self) -> float:
        """HOTA."""
        return float(self.hota_by_alpha.mean())

    @property
    def det_a(self) -> float:
        """Detection accuracy."""
        return float(self.det_a_by_alpha.mean())

    @property
    def det_re(self) -> float:
        """Detection recall."""
        return float(self.det_re_by_alpha.mean())

    @property
    def det_pr(self) -> float:
        """Detection precision."""
        return float(self.det_pr_by_alpha.mean())

    @property
    def ass_a(self) -> float:
        """Association accuracy."""
        return float(self.ass_a_by_alpha.mean())

    @property
    def ass_re(self) -> float:
        """Association recall."""
        return float(self.ass_re_by_alpha.mean())

    @property
    def ass_pr(self) -> float:
        """Association precision."""
        return float(self.ass_pr_by_alpha.mean())

    @property
    def loc_a(self) -> float:
        """Localisation accuracy."""
        return float(self.loc_a_by_alpha.mean())

    @property
    def owta(self) -> float:
        """OWTA, which forgives boxes that truth does not know."""
        return float(self.owta_by_alpha.mean())

    @property
    def hota_0(self) -> float:
        """HOTA(0): at the least alpha, 0.05."""
        return float(self.hota_by_alpha[0])

    @property
    def loc_a_0(self) -> float:
        """LocA(0): localisation accuracy at the least alpha."""
        return float(self.loc_a_by_alpha[0])

    @property
    def hota_loc_a_0(self) -> float:
        """HOTALocA(0): their product."""
        return self.hota_0 * self.loc_a_0

    @classmethod
    def sum_of(cls, scores: Sequence[HotaScores]) -> HotaScores:
        """The figures over several sequences: counts added, means weighted by the number of matches."""
        counts = {name: _total([getattr(one, name) for one in scores]) for name in cls.__slots__[:3]}
        matches = counts["tp_by_alpha"]
        means = {
            name: _total([getattr(one, name) * one.tp_by_alpha for one in scores]) / np.maximum(1.0, matches)
            for name in cls.__slots__[3:]
        }
        means["loc_a_by_alpha"] = np.where(matches > 0, means["loc_a_by_alpha"], 1.0)
        return cls(**counts, **means)


def _total(arrays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    total = np.zeros(len(ALPHAS))
    for array in arrays:
        total = total + array
    return total


class HotaMatching:
    """Matches truth and result in each frame by overlap times how well object and track agree over the whole sequence.

    Args:
        scene: truth and result.
        meetings: of all of its frames.
    """

    def __init__(self, scene: Scene, meetings: Meetings) -> None:
        self._scene = scene
        self._meetings = meetings
        self._object_lengths = np.bincount(scene.truth.ids, minlength=scene.truth.count)[meetings.objects]
        self._track_lengths = np.bincount(scene.result.ids, minlength=scene.result.count)[meetings.tracks]
        together = self._object_lengths + self._track_lengths
        self._alignment = meetings.shares / (together - meetings.shares)
        self._matches = np.zeros((len(meetings.keys), len(ALPHAS) + 1), np.int64)  # by how many alphas are reached
        self._overlap_sums = np.zeros(len(ALPHAS) + 1)

    def add(self, pairs: Pairs) -> None:
        """Matches the frames of ``pairs``, which come in any order."""
        places = self._meetings.places(pairs)
        chosen = best_pairs(self._scene, pairs, self._alignment[places] * pairs.overlaps)
        overlaps = pairs.overlaps[chosen]
        reached = np.searchsorted(ALPHAS - _EPS, overlaps, side="right")
        np.add.at(self._matches, (places[chosen], reached), 1)
        self._overlap_sums += np.bincount(reached, overlaps, minlength=len(ALPHAS) + 1)

    def scores(self) -> HotaScores:
        """The figures, after the last frame."""
        matches = self._matches[:, ::-1].cumsum(axis=1)[:, ::-1][:, 1:]  # (K, 19): frames matched at each alpha, TPA
        tp = matches.sum(axis=0).astype(np.float64)
        objects, tracks = self._object_lengths[:, None], self._track_lengths[:, None]

        def mean(lengths: NDArray[np.int64]) -> NDArray[np.float64]:
            quotients: NDArray[np.float64] = (matches * (matches / np.maximum(1, lengths))).sum(axis=0)
            over_matches: NDArray[np.float64] = quotients / np.maximum(1.0, tp)
            return over_matches

        overlap_sums = self._overlap_sums[::-1].cumsum()[::-1][1:]
        return HotaScores(
            tp_by_alpha=tp,
            fn_by_alpha=len(self._scene.truth) - tp,
            fp_by_alpha=len(self._scene.result) - tp,
            ass_a_by_alpha=mean(objects + tracks - matches),
            ass_re_by_alpha=mean(np.broadcast_to(objects, matches.shape)),
            ass_pr_by_alpha=mean(np.broadcast_to(tracks, matches.shape)),
            loc_a_by_alpha=np.where(tp > 0, overlap_sums / np.maximum(1.0, tp), 1.0),
        )
