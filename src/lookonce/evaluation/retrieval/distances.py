"""Distances between descriptors that are the same on every machine and in every block.

The descriptors are rounded to multiples of 2^-25, so that float64 holds every product and every sum of the matrix
product exactly, whatever their order; the rounding moves a distance by less than 1e-6. Trackers measure the same way
(`docs/decisions/0004-exact-distances.md`), and nothing here may depend on a tracker.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Rounded", "distances", "rounded"]

_SCALE = float(1 << 25)


class Rounded(NamedTuple):
    """Descriptors as whole numbers.

    Attributes:
        units: (N, D) float64, whole numbers in units of 2^-25.
        squared_lengths: (N,) float64, in units of 2^-50.
    """

    units: NDArray[np.float64]
    squared_lengths: NDArray[np.float64]

    def part(self, rows: NDArray[np.int64] | slice) -> Rounded:
        """The chosen rows."""
        return Rounded(self.units[rows], self.squared_lengths[rows])


def rounded(descriptors: NDArray[np.float32]) -> Rounded:
    """Descriptors (N, D), rows of unit length, ready for ``distances``."""
    units = np.multiply(descriptors, _SCALE, dtype=np.float64)
    np.rint(units, out=units)
    return Rounded(units, np.einsum("nd,nd->n", units, units))


def distances(a: Rounded, b: Rounded) -> NDArray[np.float64]:
    """(A, B) float64, Euclidean distance of every pair, about 0 to 2; equal descriptors are at exactly 0."""
    squared: NDArray[np.float64] = a.units @ b.units.T  # (A, D) x (D, B) -> (A, B)
    squared *= -2.0
    squared += a.squared_lengths[:, None]
    squared += b.squared_lengths
    np.sqrt(squared, out=squared)
    squared /= _SCALE
    return squared
