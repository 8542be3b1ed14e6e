"""Euclidean distances between descriptors that are the same bytes on every machine.

A matrix product adds its terms in an order that depends on the library, the processor and the number of rows, so in
floating point the distance of a pair would depend on the other pairs. Here descriptors are first rounded to multiples
of 2^-25. Then every product and every partial sum is a whole number below 2^53, which float64 holds exactly: the
product is exact in any order, and the distance of a pair depends on nothing but the pair. The rounding moves a
distance by less than 1e-6 (`docs/decisions/0004-exact-distances.md`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["SCALE", "quantize", "squared_distances", "squared_lengths"]

SCALE = float(1 << 25)
"""Rounded descriptors are in units of 1 / SCALE. Unit vectors give sums up to 2^50, medians of three up to 2^51."""


def quantize(descriptors: NDArray[np.float32]) -> NDArray[np.float64]:
    """Descriptors (N, D) as whole numbers (N, D) in units of 1 / SCALE."""
    scaled = np.multiply(descriptors, SCALE, dtype=np.float64)
    return np.rint(scaled, out=scaled)


def squared_lengths(quantized: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) squared lengths of quantized rows, in units of 1 / SCALE²; exact."""
    lengths: NDArray[np.float64] = np.einsum("nd,nd->n", quantized, quantized)
    return lengths


def squared_distances(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    lengths_a: NDArray[np.float64],
    lengths_b: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Squared Euclidean distance of every pair of quantized rows.

    Args:
        a: (T, D) quantized.
        b: (N, D) quantized.
        lengths_a: (T,) squared lengths of ``a``.
        lengths_b: (N,) squared lengths of ``b``.

    Returns:
        (T, N) in units of 1 / SCALE².
    """
    squared: NDArray[np.float64] = a @ b.T
    squared *= -2.0
    squared += lengths_a[:, None]
    squared += lengths_b
    return squared
