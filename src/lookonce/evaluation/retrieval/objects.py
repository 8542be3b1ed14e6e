"""Boxes whose identity is known, with their descriptors: what every measure here starts from."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import check_array

__all__ = ["GRID_STEP", "UNKNOWN_GRID", "DescribedObjects"]

GRID_STEP = 1000
"""Distance of two grids in the column ``grids``; anchors of a grid are fewer."""

UNKNOWN_GRID = -1
"""In the column ``grids``: nobody said which."""

_UNIT_LENGTH_TOLERANCE = 1e-3  # float16 storage of a unit vector stays within this
_LAST_FRAME = 2**31 - 1  # clocks of many sequences laid end to end stay below 2^63


@dataclass(frozen=True, slots=True)
class DescribedObjects:
    """One row for each box whose identity is known, of any number of sequences, checked on construction.

    Attributes:
        descriptors: (N, D) float32, rows of unit length.
        identities: (N,) int64, who it is; unique within a sequence, so the same number in two sequences says nothing.
        sequences: (N,) int64, which sequence.
        frames: (N,) int64, frame index within the sequence, 0 to 2^31 - 1.
        times_s: (N,) float64, time of the frame within the sequence.
        heights_px: (N,) float32, box height in px of the picture, above 0.
        widths_px: (N,) float32, box width in px of the picture, above 0.
        grids: (N,) int64, where the detector finds it: ``GRID_STEP`` times the output grid, plus the anchor;
            ``UNKNOWN_GRID`` = not known, which is what all rows become where the column is left out.

    Raises:
        ValueError: a field has another shape, dtype, row count or range, or is not finite.
    """

    descriptors: NDArray[np.float32]
    identities: NDArray[np.int64]
    sequences: NDArray[np.int64]
    frames: NDArray[np.int64]
    times_s: NDArray[np.float64]
    heights_px: NDArray[np.float32]
    widths_px: NDArray[np.float32]
    grids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        check_array("descriptors", self.descriptors, (None, None), np.float32)
        count = len(self.descriptors)
        if not len(self.grids):
            object.__setattr__(self, "grids", np.full(count, UNKNOWN_GRID, np.int64))
        for name, dtype in (
            ("identities", np.int64),
            ("sequences", np.int64),
            ("frames", np.int64),
            ("times_s", np.float64),
            ("heights_px", np.float32),
            ("widths_px", np.float32),
            ("grids", np.int64),
        ):
            check_array(name, getattr(self, name), (count,), dtype)
        squared = np.einsum("nd,nd->n", self.descriptors, self.descriptors)
        # One comparison also refuses NaN and infinity; the same holds for the sizes below.
        if not (np.abs(squared - 1) <= 2 * _UNIT_LENGTH_TOLERANCE).all():
            raise ValueError("descriptors: expected rows of unit length, got another length")
        if ((self.frames < 0) | (self.frames > _LAST_FRAME)).any():
            raise ValueError(f"frames: expected 0 to {_LAST_FRAME}, got {self.frames.min()} to {self.frames.max()}")
        if not np.isfinite(self.times_s).all():
            raise ValueError("times_s: expected finite numbers, got NaN or infinity")
        for name, sizes in (("heights_px", self.heights_px), ("widths_px", self.widths_px)):
            if not ((sizes > 0) & (sizes < np.inf)).all():
                raise ValueError(f"{name}: expected finite numbers above 0, got another")

    def __len__(self) -> int:
        return len(self.descriptors)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice) -> DescribedObjects:
        """The chosen rows (a mask, indices or a slice), all fields kept aligned."""
        return DescribedObjects(
            self.descriptors[rows],
            self.identities[rows],
            self.sequences[rows],
            self.frames[rows],
            self.times_s[rows],
            self.heights_px[rows],
            self.widths_px[rows],
            self.grids[rows],
        )
