"""PR-MOTA and its relatives: what a tracker is worth along the precision-recall curve of its detector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.tracking.detrac.scores import DetracScores
from lookonce.structures import check_array, check_finite

__all__ = ["PRScores", "pr_average", "pr_scores"]


@dataclass(frozen=True, slots=True)
class PRScores:
    """The figures that UA-DETRAC ranks by, called "PR-MOTA (trapezoid)" and so on; MOTA may be negative.

    The official program is not to be had. Of its only published example it makes 29.77 where these formulas make 29.38:
    name the formula beside the number.

    Attributes:
        mota: PR-MOTA.
        motp: PR-MOTP.
        motal: PR-MOTAL.
        mostly_tracked_share: PR-MT.
        partly_tracked_share: PR-PT.
        mostly_lost_share: PR-ML.
        false_positives: PR-FP.
        misses: PR-FN.
        id_switches: PR-IDs.
        fragmentations: PR-FM.
        recall: PR-Rcll.
        precision: PR-Prcn.
    """

    mota: float
    motp: float
    motal: float
    mostly_tracked_share: float
    partly_tracked_share: float
    mostly_lost_share: float
    false_positives: float
    misses: float
    id_switches: float
    fragmentations: float
    recall: float
    precision: float


def pr_scores(
    scores: Sequence[DetracScores], precisions: NDArray[np.float64], recalls: NDArray[np.float64]
) -> PRScores:
    """All figures, each by ``pr_average``.

    Args:
        scores: T of them, of the whole set: the tracker's figures with the detections of score 0.0 and above, then 0.1
            and above, and so on to 1.0.
        precisions: (T,) float64, the detector's precision over the whole set at these thresholds.
        recalls: (T,) float64, its recall.

    Raises:
        ValueError: the lengths differ or there is no threshold.
    """
    names = PRScores.__slots__
    return PRScores(
        *(pr_average(np.array([float(getattr(one, name)) for one in scores]), precisions, recalls) for name in names)
    )


def pr_average(values: NDArray[np.float64], precisions: NDArray[np.float64], recalls: NDArray[np.float64]) -> float:
    """Half the integral of a figure along the precision-recall curve, by the trapezoidal rule.

    L. Wen et al., "UA-DETRAC", section on evaluation: PR-MOTA = 1/2 of the curve integral of MOTA over precision and
    recall; the length of a step is that of the straight line between two thresholds.

    Args:
        values: (T,) float64, the figure at each threshold, thresholds rising or falling.
        precisions: (T,) float64.
        recalls: (T,) float64.

    Raises:
        ValueError: the lengths differ, there is no threshold, or a number is not finite.

    >>> round(pr_average(np.ones(2), np.array([0.0, 1.0]), np.array([1.0, 0.0])), 4)
    0.7071
    """
    count = len(values)
    for name, array in (("values", values), ("precisions", precisions), ("recalls", recalls)):
        check_array(name, array, (count,), np.float64)
        check_finite(name, array)
    if not count:
        raise ValueError("values: expected one or more thresholds, got none")
    steps = np.hypot(np.diff(precisions), np.diff(recalls))
    return float((steps * (values[:-1] + values[1:]) / 2).sum() / 2)
