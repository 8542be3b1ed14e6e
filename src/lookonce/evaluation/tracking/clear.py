"""The CLEAR figures, as TrackEval has them.

K. Bernardin, R. Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics", EURASIP JIVP
2008; objects tracked and lost and fragmentations: Y. Li, C. Huang, R. Nevatia, "Learning to associate", CVPR 2009.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lookonce.assignment import components, is_single
from lookonce.evaluation.tracking.counts import ClearCounts, share
from lookonce.evaluation.tracking.matching import best_pairs, solve_part
from lookonce.evaluation.tracking.overlaps import Pairs, Scene, by_id

__all__ = ["ClearMatching", "ClearScores"]

_MIN_IOU = 0.5 - np.finfo(np.float64).eps  # TrackEval's
_KEPT = 1000.0  # what TrackEval adds to the overlap of a pair that the frame before had too
_MOSTLY_TRACKED, _MOSTLY_LOST = 0.8, 0.2


@dataclass(frozen=True, slots=True)
class ClearScores(ClearCounts):
    """The CLEAR figures of one sequence or of several: counts, and rates made from them.

    A rate of nothing is 0. TrackEval says the same but for sequences without any true box: there its share of objects
    mostly lost is 1, and its MOTA of several such sequences together is minus the number of boxes.

    Attributes:
        true_positives: matches: true boxes found, with an IoU of 0.5 or more.
        misses: true boxes not found.
        false_positives: boxes of the result that found nothing.
        id_switches: matches of an object whose last match, however long ago, was with another track.
        mostly_tracked: objects that are found in more than 80 % of their frames.
        partly_tracked: of the others those found in 20 % or more.
        mostly_lost: the other objects.
        fragmentations: how often the tracking of an object is taken up again.
        overlap_sum: sum of the IoU of all matches.
        frames: of the sequences that have both true boxes and results; 0 of the others, as in TrackEval.
    """

    @property
    def moda(self) -> float:
        """1 - (misses + false positives) / true boxes."""
        return share(self.true_positives - self.false_positives, self.true_positives + self.misses)

    @property
    def smota(self) -> float:
        """(sum of IoU - false positives - ID switches) / true boxes: P. Voigtlaender et al., "MOTS", CVPR 2019."""
        return share(self.overlap_sum - self.false_positives - self.id_switches, self.true_positives + self.misses)

    @property
    def motal(self) -> float:
        """1 - (misses + false positives + log10(ID switches)) / true boxes."""
        switches = math.log10(self.id_switches) if self.id_switches else 0.0
        return share(self.true_positives - self.false_positives - switches, self.true_positives + self.misses)

    @property
    def f1(self) -> float:
        """The harmonic mean of precision and recall: TP / (TP + misses / 2 + false positives / 2)."""
        return share(self.true_positives, self.true_positives + 0.5 * self.misses + 0.5 * self.false_positives)

    @classmethod
    def sum_of(cls, scores: Sequence[ClearScores]) -> ClearScores:
        """The figures over several sequences: their counts added, the rates from the sums."""
        return cls(*(sum(getattr(one, item.name) for one in scores) for item in fields(cls)))


class ClearMatching:
    """Matches truth and result frame by frame: a pair of the frame before stays, then the largest sum of IoU.

    The frame before is the last one that has both true boxes and results; an object missing there has no pair to keep.

    Args:
        scene: truth and result.

    Attributes:
        tracks: (N,) int64, the id that each true box is matched with; -1 = none.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._before = rows_before(scene)
        self.tracks = np.full(len(scene.truth), -1, np.int64)
        self._overlap = np.zeros(len(scene.truth))

    def add(self, pairs: Pairs) -> None:
        """Matches the next frames; ``pairs`` come in the order of frames."""
        near = pairs[pairs.overlaps >= _MIN_IOU]
        is_alone = is_single(near.truths) & is_single(near.results)
        self._match(near[is_alone])
        hard = near[~is_alone]
        tracks = self._scene.result.ids[hard.results].tolist()
        truths, results, overlaps = hard.truths.tolist(), hard.results.tolist(), hard.overlaps.tolist()
        before = self._before[hard.truths].tolist()
        for places in components(hard.truths, hard.results):
            part = places.tolist()
            weights = [
                overlaps[place] + (_KEPT if before[place] >= 0 and self.tracks[before[place]] == tracks[place] else 0.0)
                for place in part
            ]
            best, is_only = solve_part([truths[place] for place in part], [results[place] for place in part], weights)
            if not is_only:
                self._match_frame(near, int(hard.frames[part[0]]))
                continue
            for place in (part[number] for number in best):
                self.tracks[truths[place]], self._overlap[truths[place]] = tracks[place], overlaps[place]

    def _weights(self, pairs: Pairs) -> NDArray[np.float64]:
        before = self._before[pairs.truths]
        last = np.where(before >= 0, self.tracks[before], -1)
        is_kept: NDArray[np.float64] = _KEPT * (last == self._scene.result.ids[pairs.results])
        return is_kept + pairs.overlaps

    def _match(self, pairs: Pairs) -> None:
        self.tracks[pairs.truths] = self._scene.result.ids[pairs.results]
        self._overlap[pairs.truths] = pairs.overlaps

    def _match_frame(self, near: Pairs, frame: int) -> None:
        """Matches a frame anew as a whole, where several choices are best."""
        first, last = np.searchsorted(near.frames, [frame, frame + 1])
        pairs = near[first:last]
        self.tracks[pairs.truths] = -1
        self._match(pairs[best_pairs(self._scene, pairs, self._weights(pairs))])

    def scores(self) -> ClearScores:
        """The figures, after the last frame."""
        truth, result = self._scene.truth, self._scene.result
        found = self.tracks >= 0
        tp = int(found.sum())
        rows = np.flatnonzero(found)[by_id(truth.ids[found])]  # by object, then by frame
        is_same_object = np.diff(truth.ids[rows]) == 0
        switches = int((is_same_object & (np.diff(self.tracks[rows]) != 0)).sum())
        starts = found & ~((self._before >= 0) & found[self._before])
        restarts = np.maximum(np.bincount(truth.ids[starts], minlength=truth.count) - 1, 0)
        lengths = np.bincount(truth.ids, minlength=truth.count)
        tracked = np.bincount(truth.ids[found], minlength=truth.count) / np.maximum(1, lengths)
        mostly, partly = int((tracked > _MOSTLY_TRACKED).sum()), int((tracked >= _MOSTLY_LOST).sum())
        return ClearScores(
            true_positives=tp,
            misses=len(truth) - tp,
            false_positives=len(result) - tp,
            id_switches=switches,
            mostly_tracked=mostly,
            partly_tracked=partly - mostly,
            mostly_lost=truth.count - partly,
            fragmentations=int(restarts.sum()),
            overlap_sum=float(self._overlap[found].sum()),
            frames=len(self._scene) if len(truth) and len(result) else 0,
        )


def rows_before(scene: Scene) -> NDArray[np.int64]:
    """(N,) int64: for each true box the row of the same object in the frame before, -1 = none."""
    is_used = (np.diff(scene.truth.starts) > 0) & (np.diff(scene.result.starts) > 0)
    number = np.cumsum(is_used)[scene.truth.frames]
    rows = np.flatnonzero(is_used[scene.truth.frames])
    rows = rows[by_id(scene.truth.ids[rows])]
    follows = (np.diff(scene.truth.ids[rows]) == 0) & (np.diff(number[rows]) == 1)
    before = np.full(len(scene.truth), -1, np.int64)
    before[rows[1:][follows]] = rows[:-1][follows]
    return before
