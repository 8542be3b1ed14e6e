"""Error rates of the rule "the same object where the distance is below a threshold"."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.retrieval.pairs import LARGEST_DISTANCE, PairDistances

__all__ = ["equal_error_rate", "rates_at", "roc_auc", "threshold_at"]


def equal_error_rate(pairs: PairDistances) -> tuple[float, float]:
    """The rate at which false accepts equal false rejects, and the threshold where that happens.

    At an edge between two bins the false accept rate is the share of impostor pairs in the bins below it, the false
    reject rate the share of genuine pairs in the bins above it; between two edges both are straight lines. Where the
    two rates are equal over a whole stretch of thresholds (as for perfectly separated distances), the threshold is
    its middle.

    Returns:
        Rate in [0, 1] (0 = perfect, 0.5 = chance) and threshold in [0, 2]; NaN both without genuine or without
        impostor pairs.

    >>> import numpy as np
    >>> equal_error_rate(PairDistances(np.array([3, 1, 0, 0]), np.array([0, 1, 0, 3]), 1, 1, 1))
    (0.125, 0.75)
    """
    genuine, impostor = pairs.genuine_count, pairs.impostor_count
    if not genuine or not impostor:
        return math.nan, math.nan
    # false accept rate minus false reject rate, times genuine times impostor: whole numbers, so that 0 is exact
    accepted = _below_edges(pairs.impostor)
    balance = accepted * genuine - (genuine - _below_edges(pairs.genuine)) * impostor
    equal = np.flatnonzero(balance == 0)
    if len(equal):
        return int(accepted[equal[0]]) / impostor, float((equal[0] + equal[-1]) / 2 * pairs.bin_width)
    low = int(np.flatnonzero(balance < 0)[-1])
    part = float(-balance[low] / (balance[low + 1] - balance[low]))
    rate = float(accepted[low] + part * (accepted[low + 1] - accepted[low])) / impostor
    return rate, (low + part) * pairs.bin_width


def roc_auc(pairs: PairDistances) -> float:
    """The probability that a random genuine pair is nearer than a random impostor pair; in the same bin counts half.

    Returns:
        In [0, 1], 0.5 = chance; NaN without genuine or without impostor pairs.
    """
    genuine, impostor = pairs.genuine_count, pairs.impostor_count
    if not genuine or not impostor:
        return math.nan
    nearer = _below_edges(pairs.impostor)
    twice_farther = 2 * impostor - nearer[:-1] - nearer[1:]
    return int(pairs.genuine @ twice_farther) / (2 * genuine * impostor)


def threshold_at(pairs: PairDistances, false_accept_rate: float) -> float:
    """The largest threshold whose false accept rate is not above the one given; NaN without impostor pairs.

    Args:
        pairs: the distances.
        false_accept_rate: in [0, 1].

    Returns:
        In [0, 2]; within a bin the pairs are taken as evenly spread.
    """
    if not 0 <= false_accept_rate <= 1:
        raise ValueError(f"false_accept_rate: expected 0 to 1, got {false_accept_rate}")
    if not pairs.impostor_count:
        return math.nan
    accepted = _below_edges(pairs.impostor)
    wanted = false_accept_rate * pairs.impostor_count
    low = int(np.searchsorted(accepted, wanted, "right")) - 1
    if low == len(pairs.impostor):
        return LARGEST_DISTANCE
    part = (wanted - float(accepted[low])) / float(accepted[low + 1] - accepted[low])
    return (low + part) * pairs.bin_width


def rates_at(pairs: PairDistances, threshold: float) -> tuple[float, float]:
    """False accept rate and false reject rate where pairs nearer than ``threshold`` count as the same object.

    Returns:
        Both in [0, 1]; within a bin the pairs are taken as evenly spread. NaN for the first without impostor pairs,
        for the second without genuine ones.
    """
    if math.isnan(threshold):
        raise ValueError("threshold: expected a number, got NaN")
    return _share_below(pairs.impostor, pairs, threshold), 1 - _share_below(pairs.genuine, pairs, threshold)


def _share_below(counts: NDArray[np.int64], pairs: PairDistances, threshold: float) -> float:
    total = int(counts.sum())
    if not total:
        return math.nan
    edges = np.arange(len(counts) + 1) * pairs.bin_width
    return float(np.interp(threshold, edges, _below_edges(counts))) / total


def _below_edges(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """(B + 1,) int64: the pairs in the bins below each edge."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
