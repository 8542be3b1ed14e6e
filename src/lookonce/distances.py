"""Euclidean distances between descriptors that are the same bytes on every machine.

A matrix product adds its terms in an order that depends on the library, the processor and the number of rows, so in
floating point the distance of a pair would depend on the other pairs. Here descriptors are first rounded to multiples
of 2^-25. Then every product and every partial sum is a whole number below 2^53, which float64 holds exactly: the
product is exact in any order, and the distance of a pair depends on nothing but the pair. The rounding moves a
distance by less than 1e-6 (`docs/decisions/0004-exact-distances.md`).

Rounded to multiples of 2^-11 the sums of products stay below 2^24, which float32 holds exactly: half the memory, and
less than half the time. That moves the distance of descriptors of 128 values by about 2e-4, far below what tells
objects apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["COARSE", "FINE", "Floats", "Precision", "Quantized", "distances", "quantize", "squared_distances"]

Floats = NDArray[np.float64] | NDArray[np.float32]


class Precision(NamedTuple):
    """How finely descriptors are rounded.

    Attributes:
        scale: they become whole numbers in units of 1 / scale, a power of 2.
        dtype: what holds the sums of products of unit vectors, up to scale², and of medians of three, 1.5 times that.
    """

    scale: float
    dtype: type[np.float64] | type[np.float32]


FINE = Precision(float(1 << 25), np.float64)
COARSE = Precision(float(1 << 11), np.float32)


class Quantized(NamedTuple):
    """Descriptors as whole numbers.

    Attributes:
        units: (N, D) float64 or float32, whole numbers in units of 1 / scale of a ``Precision``.
        squared_lengths: (N,) of the same dtype, in units of 1 / scale²; exact.
    """

    units: Floats
    squared_lengths: Floats

    @classmethod
    def of(cls, units: Floats) -> Quantized:
        """Whole numbers (N, D) with their squared lengths."""
        return cls(units, (units[:, None] @ units[:, :, None])[:, 0, 0])

    def part(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Quantized:
        """The chosen rows (a mask, indices or a slice)."""
        return Quantized(self.units[rows], self.squared_lengths[rows])


def quantize(descriptors: NDArray[np.float32], precision: Precision = FINE) -> Quantized:
    """Descriptors (N, D), rounded."""
    units = descriptors * np.float32(precision.scale)  # a power of 2: exact
    return Quantized.of(np.rint(units, out=units).astype(precision.dtype, copy=False))


def squared_distances(a: Quantized, b: Quantized) -> Floats:
    """(A, B) squared Euclidean distance of every pair of rows of one precision, in units of 1 / scale².

    Exact; of coarse medians that are opposite, rounded to an even number.
    """
    squared: Floats = a.units @ b.units.T  # (A, D) x (D, B) -> (A, B)
    squared *= -2.0
    squared += a.squared_lengths[:, None]
    squared += b.squared_lengths
    return squared


def distances(a: Quantized, b: Quantized) -> NDArray[np.float64]:
    """(A, B) float64, Euclidean distance of every pair, about 0 to 2; equal descriptors are at exactly 0."""
    apart = squared_distances(a, b).astype(np.float64, copy=False)
    np.sqrt(apart, out=apart)
    apart /= FINE.scale if a.units.dtype == FINE.dtype else COARSE.scale
    return apart
