"""Misses and false boxes: how large they are, and where in the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation import TrackingResult, TrackingTruth
from lookonce.evaluation.tracking.following import Following

__all__ = ["SizeClass", "add_sizes", "by_place", "by_size"]

_EDGES_PX = (0.0, 16.0, 32.0, 64.0, 128.0, math.inf)  # of a box's height: twice as high each
_COLUMNS = 48  # of the grid over a picture


@dataclass(frozen=True, slots=True)
class SizeClass:
    """Boxes from ``least_px`` to below ``most_px`` high: true ones, missed ones and wrong ones of the result."""

    least_px: float
    most_px: float
    true: int
    missed: int
    wrong: int

    @property
    def name(self) -> str:
        """For people."""
        if math.isinf(self.most_px):
            return f"{self.least_px:g} px and more"
        return f"{self.least_px:g} to {self.most_px:g} px" if self.least_px else f"below {self.most_px:g} px"


def by_size(truth: TrackingTruth, result: TrackingResult, following: Following) -> tuple[SizeClass, ...]:
    """A row for each class of height; the last one's upper end is infinite."""
    parts = (truth.xyxy[following.truth_rows], truth.xyxy[following.missed], result.xyxy[following.wrong])
    counts = [np.histogram(xyxy[:, 3] - xyxy[:, 1], np.array(_EDGES_PX))[0].tolist() for xyxy in parts]
    edges = pairwise(_EDGES_PX)
    return tuple(SizeClass(*ends, *numbers) for ends, *numbers in zip(edges, *counts, strict=True))


def add_sizes(parts: Sequence[Sequence[SizeClass]]) -> tuple[SizeClass, ...]:
    """The same classes over several sequences."""
    return tuple(
        SizeClass(
            rows[0].least_px,
            rows[0].most_px,
            sum(one.true for one in rows),
            sum(one.missed for one in rows),
            sum(one.wrong for one in rows),
        )
        for rows in zip(*parts, strict=True)
    )


def by_place(xyxy: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.int64]:
    """How many boxes have their middle in each cell of a grid over the picture; those outside count at its border.

    Args:
        xyxy: (N, 4) float64.
        size: (height, width) of the picture in px.

    Returns:
        (rows, 48) int64; cells are about square.

    >>> by_place(np.array([[0, 0, 2, 2.0]]), (90, 160)).sum()
    np.int64(1)
    """
    height, width = size
    rows = min(4 * _COLUMNS, max(1, round(_COLUMNS * height / width)))
    x = np.clip(((xyxy[:, 0] + xyxy[:, 2]) / 2 * _COLUMNS / width).astype(np.int64), 0, _COLUMNS - 1)
    y = np.clip(((xyxy[:, 1] + xyxy[:, 3]) / 2 * rows / height).astype(np.int64), 0, rows - 1)
    return np.bincount(y * _COLUMNS + x, minlength=rows * _COLUMNS).reshape(rows, _COLUMNS).astype(np.int64)
