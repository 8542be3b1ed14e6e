"""Euclidean distances between descriptors that are the same bytes on every machine.

A matrix product adds its terms in an order that depends on the library, the processor and the number of rows, so in
floating point the distance of a pair would depend on the other pairs. Here descriptors are first rounded to multiples
of 2^-25. Then every product and every partial sum is a whole number below 2^53, which float64 holds exactly: the
product is exact in any order, and the distance of a pair depends on nothing but the pair. The rounding moves a
distance by less than 1e-6 (`docs/decisions/0004-exact-distances.md`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["SCALE", "Quantized", "distances", "quantize", "squared_distances"]

SCALE = float(1 << 25)
"""Quantized descriptors are in units of 1 / SCALE. Unit vectors give sums up to 2^50, medians of three up to 2^51."""


class Quantized(NamedTuple):
    """Descriptors as whole numbers.

    Attributes:
        units: (N, D) float64, whole numbers in units of 1 / SCALE.
        squared_lengths: (N,) float64, in units of 1 / SCALE²; exact.
    """

    units: NDArray[np.float64]
    squared_lengths: NDArray[np.float64]

    @classmethod
    def of(cls, units: NDArray[np.float64]) -> Quantized:
        """Whole numbers (N, D) with their squared lengths."""
        return cls(units, (units[:, None] @ units[:, :, None])[:, 0, 0])

    def part(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Quantized:
        """The chosen rows (a mask, indices or a slice)."""
        return Quantized(self.units[rows], self.squared_lengths[rows])


def quantize(descriptors: NDArray[np.float32]) -> Quantized:
    """Descriptors (N, D), rounded to multiples of 1 / SCALE."""
    units = descriptors * np.float32(SCALE)  # a power of 2: exact
    return Quantized.of(np.rint(units, out=units).astype(np.float64))


def squared_distances(a: Quantized, b: Quantized) -> NDArray[np.float64]:
    """(A, B) float64, squared Euclidean distance of every pair of rows, in units of 1 / SCALE²; exact."""
    squared: NDArray[np.float64] = a.units @ b.units.T  # (A, D) x (D, B) -> (A, B)
    squared *= -2.0
    squared += a.squared_lengths[:, None]
    squared += b.squared_lengths
    return squared


def distances(a: Quantized, b: Quantized) -> NDArray[np.float64]:
    """(A, B) float64, Euclidean distance of every pair, about 0 to 2; equal descriptors are at exactly 0."""
    apart = squared_distances(a, b)
    np.sqrt(apart, out=apart)
    apart /= SCALE
    return apart
