"""The figures of one sequence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, overload

from lookonce.evaluation.tracking.clear import ClearMatching
from lookonce.evaluation.tracking.detrac.matching import evaluate_detrac
from lookonce.evaluation.tracking.detrac.scores import DetracScores
from lookonce.evaluation.tracking.hota import HotaMatching
from lookonce.evaluation.tracking.identity import identity_scores
from lookonce.evaluation.tracking.overlaps import Pairs, Scene, overlapping_pairs
from lookonce.evaluation.tracking.pair_counts import Meetings
from lookonce.evaluation.tracking.preparation import prepare
from lookonce.evaluation.tracking.scores import TrackingCounts, TrackingScores
from lookonce.evaluation.tracking.values import TrackingResult, TrackingTruth

__all__ = ["PROTOCOLS", "combine", "evaluate_tracking"]

PROTOCOLS = ("trackeval", "detrac")

_KEPT_PAIRS = 1 << 21  # overlapping pairs kept from the first pass for the second: 84 MB


@overload
def evaluate_tracking(
    truth: TrackingTruth, result: TrackingResult, protocol: Literal["trackeval"] = ...
) -> TrackingScores: ...
@overload
def evaluate_tracking(truth: TrackingTruth, result: TrackingResult, protocol: Literal["detrac"]) -> DetracScores: ...
@overload
def evaluate_tracking(truth: TrackingTruth, result: TrackingResult, protocol: str) -> TrackingScores | DetracScores: ...
def evaluate_tracking(
    truth: TrackingTruth, result: TrackingResult, protocol: str = "trackeval"
) -> TrackingScores | DetracScores:
    """The figures of a sequence by one of two protocols; a figure without the protocol's name means nothing.

    ``trackeval``: CLEAR, identity and HOTA figures equal to TrackEval's, with MOTChallenge's rules. A match needs an
    IoU of 0.5, and the matching is the best of all. Of ``truth.ignored``, which MOTChallenge does not have, TrackEval's
    rule for KITTI: left out are results without a match of which more than half lies in one region; true boxes stay.

    ``detrac``: CLEAR figures as UA-DETRAC's toolkit has them. A new match needs an IoU of 0.7 and one held from the
    frame before 0.56; held ones come first, then the largest overlap. Left out are results and parts of trajectories in
    ``truth.ignored`` and results of zero or negative size; true boxes are rounded. Distractors play no part.

    Classes count as one; see ``TrackingTruth.of_class``. The figures do not depend on how ids are numbered (under
    ``detrac``: unless overlaps are equal), nor on the order of rows, unless under ``trackeval`` several matchings of a
    frame are equally good: of these the one counts that TrackEval takes, and which that is depends on the order of the
    frame's rows.

    Raises:
        ValueError: there is no such protocol.

    >>> import numpy as np
    >>> frames, ids = np.array([0, 1, 2]), np.zeros(3, np.int64)
    >>> boxes = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [2, 0, 12, 10.0]])
    >>> every, none, label = np.ones(3, bool), np.zeros(3, bool), np.zeros(3, np.int64)
    >>> truth = TrackingTruth(frames, frames, ids, boxes, label, every, none)
    >>> result = TrackingResult(frames, np.array([7, 7, 8]), boxes, label)
    >>> scores = evaluate_tracking(truth, result)
    >>> round(scores.clear.mota, 3), round(scores.identity.idf1, 3), round(scores.hota.hota, 3)
    (0.667, 0.667, 0.745)
    """
    if protocol not in PROTOCOLS:
        raise ValueError(f"protocol: expected one of {', '.join(PROTOCOLS)}, got {protocol}")
    return evaluate_detrac(truth, result) if protocol == "detrac" else _evaluate_trackeval(truth, result)


def _evaluate_trackeval(truth: TrackingTruth, result: TrackingResult) -> TrackingScores:
    scene, left_out = prepare(truth, result)
    clear, meetings = ClearMatching(scene), Meetings(scene)
    passes = _Passes(scene)
    for pairs in passes.first():
        clear.add(pairs)
        meetings.add(pairs)
    hota = HotaMatching(scene, meetings)
    for pairs in passes.second():
        hota.add(pairs)
    counts = TrackingCounts(len(scene.truth), len(scene.result), scene.truth.count, scene.result.count, len(scene))
    return TrackingScores(clear.scores(), identity_scores(scene, meetings), hota.scores(), counts, dict(left_out))


@overload
def combine(scores: Sequence[TrackingScores]) -> TrackingScores: ...
@overload
def combine(scores: Sequence[DetracScores]) -> DetracScores: ...
def combine(scores: Sequence[TrackingScores] | Sequence[DetracScores]) -> TrackingScores | DetracScores:
    """The figures over several sequences, or over several classes weighted by their boxes.

    Counts are added and the rates made from the sums; association scores are means weighted by the number of matches.
    These are TrackEval's combined figures; the toolkit of UA-DETRAC adds up likewise.

    Args:
        scores: all of one protocol.

    Raises:
        ValueError: there are none, or they are of both protocols.
    """
    usual = [one for one in scores if isinstance(one, TrackingScores)]
    detrac = [one for one in scores if isinstance(one, DetracScores)]
    if not scores or (usual and detrac):
        raise ValueError(f"scores: expected one or more of one protocol, got {'none' if not scores else 'both'}")
    return TrackingScores.sum_of(usual) if usual else DetracScores.sum_of(detrac)


class _Passes:
    """The overlapping pairs twice: kept while they are few, found again where they are many."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._kept: list[Pairs] = []
        self._is_complete = False

    def first(self) -> Iterator[Pairs]:
        total = 0
        for pairs in overlapping_pairs(self._scene):
            total += len(pairs)
            if total <= _KEPT_PAIRS:
                self._kept.append(pairs)
            else:
                self._kept.clear()
            yield pairs
        self._is_complete = total <= _KEPT_PAIRS

    def second(self) -> Iterator[Pairs]:
        yield from self._kept if self._is_complete else overlapping_pairs(self._scene)
