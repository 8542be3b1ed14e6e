"""All measures of one set of described objects."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lookonce.evaluation import (
    DescribedObjects,
    PairDistances,
    RankOne,
    Retrieval,
    equal_error_rate,
    mean_average_precision,
    pair_distances,
    rank_one,
    rates_at,
    roc_auc,
)
from lookonce.make.probing.gaps import GapLimits

__all__ = ["Measures", "identity_count", "measure"]


@dataclass(frozen=True, slots=True)
class Measures:
    """How far descriptors tell objects apart; a rate is NaN where what it counts does not occur.

    Attributes:
        objects: described boxes.
        identities: different objects among them; those of different sequences are different.
        pairs: the distances; their gaps are in ticks of the limits' clock.
        rank_one: of the limits' gap for it; the mean over all queries of all sequences.
        retrieval: mean average precision within the limits.
        roc_auc: probability that a pair of one object is nearer than a pair of two.
        equal_error_rate: where false accepts equal false rejects.
        equal_error_threshold: the distance where that is.
        false_accept_rate: of pairs of two objects, those nearer than the match threshold.
        false_reject_rate: of pairs of one object, those that are not.
    """

    objects: int
    identities: int
    pairs: PairDistances
    rank_one: RankOne
    retrieval: Retrieval
    roc_auc: float
    equal_error_rate: float
    equal_error_threshold: float
    false_accept_rate: float
    false_reject_rate: float


def measure(objects: DescribedObjects, limits: GapLimits, match_threshold: float | None = None) -> Measures:
    """All measures.

    Args:
        objects: N rows of any number of sequences, ``frames`` being frames.
        limits: which boxes are compared.
        match_threshold: distance below which a tracker takes two boxes for one object; None = that of the equal error
            rate.
    """
    window = limits.window(objects)
    pairs = pair_distances(window.objects, window.least, window.most)
    rate, where = equal_error_rate(pairs)
    threshold = where if match_threshold is None else match_threshold
    accepts, rejects = (math.nan, math.nan) if math.isnan(threshold) else rates_at(pairs, threshold)
    return Measures(
        objects=len(objects),
        identities=identity_count(objects),
        pairs=pairs,
        rank_one=_rank_one(objects, limits),
        retrieval=mean_average_precision(window.objects, window.least, window.most),
        roc_auc=roc_auc(pairs),
        equal_error_rate=rate,
        equal_error_threshold=where,
        false_accept_rate=accepts,
        false_reject_rate=rejects,
    )


def identity_count(objects: DescribedObjects) -> int:
    """How many different objects, sequence by sequence."""
    return len(np.unique(np.stack([objects.sequences, objects.identities]), axis=1).T)


def _rank_one(objects: DescribedObjects, limits: GapLimits) -> RankOne:
    """Over all sequences, each with the gap that fits its frame rate."""
    parts = []
    for sequence in np.unique(objects.sequences):
        own = objects[objects.sequences == sequence]
        found = rank_one(own, limits.rank_frames(own))
        if found.queries:
            parts.append(found)
    queries = sum(part.queries for part in parts)
    if not queries:
        return RankOne(math.nan, 0, math.nan)
    rate = sum(part.rate * part.queries for part in parts) / queries
    return RankOne(rate, queries, sum(part.chance * part.queries for part in parts) / queries)
