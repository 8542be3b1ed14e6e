"""Anchors fitted to the objects that there are to learn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from lookonce.make.darknet.layers import DarknetConfig

__all__ = ["fit_anchors", "mean_best_overlap"]

_ROUNDS = 100
_MOST_OBJECTS = 20_000
_SIZES = (0.5, 0.7, 1.0, 1.4)  # the views that are trained on show objects larger and smaller than the pictures do
_LEAST_SIDE_PX = 4.0

_Floats = NDArray[np.float64]
_Shape = tuple[float, float]


def fit_anchors(extents: _Floats, network: DarknetConfig, rng: Generator) -> list[list[_Shape]]:
    """Anchors of each output: k-means by overlap (Redmon and Farhadi 2017), small ones for fine grids.

    Args:
        extents: (N, 2), widths and heights of objects in px of the network's input, N >= 1.
        network: how many anchors each output has.
        rng: for the choice of objects and first centres.

    Returns:
        (width, height) in px for each output in the order of the network's outputs.
    """
    counts = [len(network.output_spec(layer).anchors) for layer in network.outputs]
    if len(extents) > _MOST_OBJECTS:
        extents = extents[rng.choice(len(extents), _MOST_OBJECTS, replace=False)]
    limit = np.array(network.size[::-1], np.float64)
    extents = np.concatenate([np.clip(extents * size, _LEAST_SIDE_PX, limit) for size in _SIZES])
    centres = _k_means(extents, sum(counts), rng)
    order = np.argsort([network.stride(layer) for layer in network.outputs], kind="stable")
    found: list[list[_Shape]] = [[] for _ in counts]
    start = 0
    for number in order:
        own = centres[start : start + counts[number]]
        found[number] = [(round(float(w), 1), round(float(h), 1)) for w, h in own]
        start += counts[number]
    return found


def mean_best_overlap(extents: _Floats, anchors: Sequence[_Shape]) -> float:
    """How well the best anchor of each object fits it by shape, mean IoU over ``extents`` (N, 2)."""
    return float(_overlap(extents, np.array(anchors, np.float64)).max(axis=1).mean())


def _k_means(extents: _Floats, count: int, rng: Generator) -> _Floats:
    """``count`` sizes by rising area; each is the median of the objects that it fits best."""
    areas = np.sort(extents.prod(axis=1))
    sides = np.sqrt(np.quantile(areas, (np.arange(count) + 0.5) / count))
    centres = sides[:, None] * np.exp(rng.normal(0, 0.1, (count, 2)))
    for _ in range(_ROUNDS):
        nearest = _overlap(extents, centres).argmax(axis=1)
        moved = np.array(
            [np.median(extents[nearest == n], axis=0) if (nearest == n).any() else c for n, c in enumerate(centres)]
        )
        if np.allclose(moved, centres):
            break
        centres = moved
    ordered: _Floats = centres[np.argsort(centres.prod(axis=1), kind="stable")]
    return ordered


def _overlap(a: _Floats, b: _Floats) -> _Floats:
    common = np.minimum(a[:, None], b[None]).prod(axis=2)
    overlap: _Floats = common / (a.prod(axis=1)[:, None] + b.prod(axis=1)[None] - common)
    return overlap
