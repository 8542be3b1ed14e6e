"""Who is nearest: rank one from frame to frame, mean average precision, the gallery of one query."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lookonce.distances import distances, quantize
from lookonce.evaluation.retrieval.objects import DescribedObjects
from lookonce.evaluation.retrieval.timeline import Timeline, check_gaps, spread_evenly

__all__ = [
    "MOST_QUERIES",
    "RankOne",
    "Retrieval",
    "mean_average_precision",
    "nearest_distances",
    "rank_gallery",
    "rank_one",
]

MOST_QUERIES = 2000
"""Queries per sequence at which they are thinned: the rate then stands to about 0.01."""


@dataclass(frozen=True, slots=True)
class RankOne:
    """How often the nearest object of a later frame is the right one.

    Attributes:
        rate: of the queries, those whose nearest is right, in [0, 1]; NaN without queries.
        queries: how many counted.
        chance: the rate that blind guessing would have; NaN without queries.
    """

    rate: float
    queries: int
    chance: float


@dataclass(frozen=True, slots=True)
class Retrieval:
    """How well all boxes of an object are found among the boxes of others.

    Attributes:
        mean_average_precision: in [0, 1]; NaN without queries.
        rank_one: of the queries, those whose nearest is right, in [0, 1]; NaN without queries.
        queries: how many counted.
    """

    mean_average_precision: float
    rank_one: float
    queries: int


def rank_one(objects: DescribedObjects, gap_frames: int) -> RankOne:
    """Each object looks for itself among all objects ``gap_frames`` later in the same sequence.

    A query counts only where its identity is there, also where nothing else is there (then it is right of necessity,
    and so is chance, which is the mean of 1 / objects in the later frame). Right means that the nearest object is of
    its identity; of several equally near the one of the lowest row decides.

    Args:
        objects: N rows.
        gap_frames: 1 or more.
    """
    if gap_frames < 1:
        raise ValueError(f"gap_frames: expected 1 or more, got {gap_frames}")
    timeline = Timeline.of(objects)
    places = np.arange(len(timeline))
    right: list[bool] = []
    chances: list[float] = []
    for pairs in timeline.pairs(places, timeline.later(places, gap_frames, gap_frames)):
        is_same = objects.identities[pairs.queries] == objects.identities[pairs.others]
        for part in _runs(pairs.queries):
            if is_same[part].any():
                right.append(bool(is_same[part][_nearest(pairs.distances[part], pairs.others[part])]))
                chances.append(1 / (part.stop - part.start))
    return RankOne(_mean(right), len(right), _mean(chances))


def mean_average_precision(
    objects: DescribedObjects, min_gap_frames: int, max_gap_frames: int, most_queries: int = MOST_QUERIES
) -> Retrieval:
    """The mean over queries of how early the other boxes of the same object come, nearest first.

    The gallery of a query is every other box of its sequence that lies ``min_gap_frames`` to ``max_gap_frames`` away,
    earlier or later. The average precision of a query is the mean of the precision at each box of its object, in
    order of distance; equal distances in order of rows. Queries whose object is not in the gallery do not count.

    Args:
        objects: N rows.
        min_gap_frames: 0 or more.
        max_gap_frames: ``min_gap_frames`` or more.
        most_queries: per sequence; of more, so many are taken, evenly spread and the same in every run.
    """
    precisions: list[float] = []
    right: list[bool] = []
    timeline = Timeline.of(objects)
    places = _some_places(objects, timeline, most_queries)
    for query, others, apart in _galleries(objects, timeline, places, min_gap_frames, max_gap_frames):
        is_same = objects.identities[others] == objects.identities[query]
        if is_same.any():
            is_same = is_same[np.lexsort((others, apart))]
            ranks = np.flatnonzero(is_same) + 1
            precisions.append(float(np.mean(np.arange(1, len(ranks) + 1) / ranks)))
            right.append(bool(is_same[0]))
    return Retrieval(_mean(precisions), _mean(right), len(right))


def nearest_distances(
    objects: DescribedObjects, min_gap_frames: int, max_gap_frames: int, most_queries: int = MOST_QUERIES
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """For each query how near the nearest box of its own object is, and the nearest one of another.

    Args:
        objects: N rows.
        min_gap_frames: as for ``mean_average_precision``, earlier or later.
        max_gap_frames: the same.
        most_queries: the same.

    Returns:
        Rows of the queries (Q,) int64 in order of sequence, frame and identity; distance to the nearest genuine box
        (Q,) float64 and to the nearest impostor (Q,) float64; infinity where there is none.
    """
    timeline = Timeline.of(objects)
    places = _some_places(objects, timeline, most_queries)
    genuine = np.full(len(objects), np.inf)
    impostor = np.full(len(objects), np.inf)
    for query, others, apart in _galleries(objects, timeline, places, min_gap_frames, max_gap_frames):
        is_same = objects.identities[others] == objects.identities[query]
        genuine[query] = apart[is_same].min(initial=np.inf)
        impostor[query] = apart[~is_same].min(initial=np.inf)
    queries = timeline.rows[places]
    return queries, genuine[queries], impostor[queries]


def rank_gallery(
    objects: DescribedObjects, query_row: int, min_gap_frames: int, max_gap_frames: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The gallery of one query, nearest first: rows (G,) int64 and distances (G,) float64, equal ones by row.

    The gallery is every other box of its sequence ``min_gap_frames`` to ``max_gap_frames`` away, earlier or later.
    """
    if not 0 <= query_row < len(objects):
        raise ValueError(f"query_row: expected a row of {len(objects)}, got {query_row}")
    check_gaps(min_gap_frames, max_gap_frames)
    gaps = np.abs(objects.frames - objects.frames[query_row])
    is_in = (objects.sequences == objects.sequences[query_row]) & (gaps >= min_gap_frames) & (gaps <= max_gap_frames)
    is_in[query_row] = False
    others = np.flatnonzero(is_in)
    apart = distances(quantize(objects.descriptors[[query_row]]), quantize(objects.descriptors[others]))[0]
    order = np.argsort(apart, kind="stable")
    return others[order], apart[order]


def _some_places(objects: DescribedObjects, timeline: Timeline, most: int) -> NDArray[np.int64]:
    """Places on the timeline, rising, at most that many of each sequence."""
    if most < 1:
        raise ValueError(f"most_queries: expected 1 or more, got {most}")
    _, starts = np.unique(objects.sequences[timeline.rows], return_index=True)
    limits = pairwise([*starts.tolist(), len(timeline)])
    parts = [start + spread_evenly(end - start, most) for start, end in limits]
    return np.concatenate([np.zeros(0, np.int64), *parts])


def _galleries(
    objects: DescribedObjects,
    timeline: Timeline,
    places: NDArray[np.int64],
    min_gap_frames: int,
    max_gap_frames: int,
) -> Iterator[tuple[int, NDArray[np.int64], NDArray[np.float64]]]:
    """Query row, rows of its gallery (earlier or later) and their distances, for each query that has a gallery."""
    check_gaps(min_gap_frames, max_gap_frames)
    for queries, others, apart in timeline.pairs(places, timeline.around(places, max_gap_frames)):
        is_far = np.abs(objects.frames[queries] - objects.frames[others]) >= min_gap_frames
        kept = is_far & (queries != others)
        queries, others, apart = queries[kept], others[kept], apart[kept]
        for part in _runs(queries):
            yield int(queries[part.start]), others[part], apart[part]


def _runs(values: NDArray[np.int64]) -> Iterator[slice]:
    """The runs of equal neighbours; no values give none."""
    if len(values):
        cuts = (np.flatnonzero(np.diff(values)) + 1).tolist()
        yield from (slice(start, end) for start, end in zip([0, *cuts], [*cuts, len(values)], strict=True))


def _nearest(apart: NDArray[np.float64], rows: NDArray[np.int64]) -> int:
    """The index of the smallest distance; of several the one of the lowest row."""
    equal = np.flatnonzero(apart == apart.min())
    return int(equal[np.argmin(rows[equal])])


def _mean(values: list[bool] | list[float]) -> float:
    return float(np.mean(values)) if values else math.nan
