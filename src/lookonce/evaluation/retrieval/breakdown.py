"""The same measures for parts of the pairs: by time apart, by change of size, by size, by change of grid."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.retrieval.objects import GRID_STEP, UNKNOWN_GRID, DescribedObjects
from lookonce.evaluation.retrieval.pairs import MOST_PAIRS, count_pairs
from lookonce.evaluation.retrieval.rates import equal_error_rate, rates_at, roc_auc

__all__ = ["Aspect", "BreakdownBin", "break_down"]

Aspect = Literal["time_gap", "size_change", "height", "grid_change"]
"""What pairs are sorted by.

Seconds apart; ratio of sqrt(area), the larger over the smaller; the lower height in px; where the detector finds the
two: at the same anchor of the same grid (0), at another anchor of it (1), in another grid (2).
"""

_EDGES: dict[Aspect, tuple[float, ...]] = {
    "time_gap": (1, 2, 5, 10, 30),
    "size_change": (1.1, 1.25, 1.5, 2),
    "height": (16, 32, 64, 128),
    "grid_change": (1, 2),
}
_UNITS: dict[Aspect, str] = {"time_gap": " s", "size_change": " x", "height": " px"}
_GRID_CHANGES = ("same grid and anchor", "same grid, other anchor", "other grid")
_TICKS_PER_S = 1e6  # 3.0 - 2.0000000001 is a second: containers count in microseconds at the finest


@dataclass(frozen=True, slots=True)
class BreakdownBin:
    """The pairs of one part and how well descriptors tell them apart.

    Attributes:
        name: for people: ``1 to 2 s``.
        lower: the part begins here, included.
        upper: and ends here, not included; infinity for the last one.
        genuine: compared pairs of one object.
        impostor: compared pairs of two objects.
        identities: how many objects have a genuine pair here.
        equal_error_rate: see ``equal_error_rate``; NaN where a kind of pair is missing.
        roc_auc: see ``roc_auc``; NaN likewise.
        genuine_within: of the genuine pairs, those nearer than the match threshold; NaN without any.
        impostor_within: of the impostor pairs, those nearer than it; NaN without any.
    """

    name: str
    lower: float
    upper: float
    genuine: int
    impostor: int
    identities: int
    equal_error_rate: float
    roc_auc: float
    genuine_within: float
    impostor_within: float


def break_down(
    objects: DescribedObjects,
    min_gap_frames: int,
    max_gap_frames: int,
    by: Aspect,
    match_threshold: float,
    most_pairs: int = MOST_PAIRS,
) -> tuple[BreakdownBin, ...]:
    """The pairs of ``pair_distances`` in parts, each with its own error rates.

    Args:
        objects: N rows.
        min_gap_frames: as for ``pair_distances``.
        max_gap_frames: the same.
        by: ``time_gap`` (limits at 1, 2, 5, 10, 30 s), ``size_change`` (1.1, 1.25, 1.5, 2) or ``height``, that of the
            lower box of the pair (16, 32, 64, 128 px), or ``grid_change``, which needs the column ``grids``.
        match_threshold: distance below which a tracker takes two boxes for one object.
        most_pairs: as for ``pair_distances``, for all parts together.

    Returns:
        All parts, from the smallest, also those without pairs.
    """
    if by not in _EDGES:
        raise ValueError(f"by: expected one of {', '.join(_EDGES)}, got {by}")
    if by == "grid_change" and (objects.grids == UNKNOWN_GRID).any():
        raise ValueError("grids: expected all to be known, got rows that are not")
    limits = np.array(_EDGES[by], np.float64)
    value_of = _VALUES[by]

    def group_of(queries: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.searchsorted(limits, value_of(objects, queries, others), side="right").astype(np.int64)

    groups = count_pairs(objects, min_gap_frames, max_gap_frames, group_of, len(limits) + 1, most_pairs)
    parts = []
    for pairs, (lower, upper) in zip(groups, _ranges(by), strict=True):
        impostor_within, genuine_beyond = rates_at(pairs, match_threshold)
        parts.append(
            BreakdownBin(
                name=_name(by, lower, upper),
                lower=lower,
                upper=upper,
                genuine=pairs.genuine_count,
                impostor=pairs.impostor_count,
                identities=pairs.identities,
                equal_error_rate=equal_error_rate(pairs)[0],
                roc_auc=roc_auc(pairs),
                genuine_within=1 - genuine_beyond,
                impostor_within=impostor_within,
            )
        )
    return tuple(parts)


def _ranges(by: Aspect) -> list[tuple[float, float]]:
    lowest = 1.0 if by == "size_change" else 0.0
    limits = [lowest, *_EDGES[by], math.inf]
    return list(itertools.pairwise(limits))


def _name(by: Aspect, lower: float, upper: float) -> str:
    if by == "grid_change":
        return _GRID_CHANGES[int(lower)]
    unit = _UNITS[by]
    if upper == math.inf:
        return f"{lower:g}{unit} and more"
    if by != "size_change" and lower == 0:
        return f"under {upper:g}{unit}"
    return f"{lower:g} to {upper:g}{unit}"


def _seconds_apart(
    objects: DescribedObjects, queries: NDArray[np.int64], others: NDArray[np.int64]
) -> NDArray[np.float64]:
    apart = np.abs(objects.times_s[queries] - objects.times_s[others])
    rounded: NDArray[np.float64] = np.rint(apart * _TICKS_PER_S) / _TICKS_PER_S
    return rounded


def _change_of_size(
    objects: DescribedObjects, queries: NDArray[np.int64], others: NDArray[np.int64]
) -> NDArray[np.float64]:
    sizes = np.sqrt(objects.heights_px.astype(np.float64) * objects.widths_px)
    change: NDArray[np.float64] = np.maximum(sizes[queries], sizes[others]) / np.minimum(sizes[queries], sizes[others])
    return change


def _lower_height(
    objects: DescribedObjects, queries: NDArray[np.int64], others: NDArray[np.int64]
) -> NDArray[np.float64]:
    return np.minimum(objects.heights_px[queries], objects.heights_px[others]).astype(np.float64)


def _change_of_grid(
    objects: DescribedObjects, queries: NDArray[np.int64], others: NDArray[np.int64]
) -> NDArray[np.float64]:
    before, after = objects.grids[queries], objects.grids[others]
    change = np.where(before // GRID_STEP != after // GRID_STEP, 2, before != after)
    return change.astype(np.float64)


_VALUES: dict[Aspect, Callable[[DescribedObjects, NDArray[np.int64], NDArray[np.int64]], NDArray[np.float64]]] = {
    "time_gap": _seconds_apart,
    "size_change": _change_of_size,
    "height": _lower_height,
    "grid_change": _change_of_grid,
}
