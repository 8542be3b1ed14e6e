"""Small sets of described objects, and slow measures of them written from their definitions."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation import DescribedObjects

GRID = 2.0**-12  # descriptors on this grid are not rounded any further, so that distances can be compared exactly


def make_objects(
    descriptors: object,
    identities: object,
    frames: object,
    sequences: object = None,
    times_s: object = None,
    heights_px: object = None,
    widths_px: object = None,
) -> DescribedObjects:
    """Objects of one sequence at 10 frames per second, 40 x 20 px, unless told otherwise."""
    count = len(np.asarray(identities))
    frames = np.asarray(frames, np.int64)
    return DescribedObjects(
        np.asarray(descriptors, np.float32),
        np.asarray(identities, np.int64),
        np.zeros(count, np.int64) if sequences is None else np.asarray(sequences, np.int64),
        frames,
        frames / 10 if times_s is None else np.asarray(times_s, np.float64),
        np.full(count, 40, np.float32) if heights_px is None else np.asarray(heights_px, np.float32),
        np.full(count, 20, np.float32) if widths_px is None else np.asarray(widths_px, np.float32),
    )


def on_circle(angles: object) -> NDArray[np.float32]:
    """(N, 2) unit vectors; those of angles a and b lie 2 sin(|a - b| / 2) apart."""
    angles = np.asarray(angles, np.float64)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1).astype(np.float32)


def random_objects(seed: int, *, ties: bool = False) -> DescribedObjects:
    """Up to 80 objects of 6 identities in 3 sequences of 12 frames; with ties only 5 different descriptors occur."""
    rng = np.random.default_rng(seed)
    cells = rng.permutation(3 * 12 * 6)[: rng.integers(40, 80)]
    sequences, frames, identities = cells // 72, cells % 72 // 6, cells % 6
    vectors = rng.normal(size=(5 if ties else len(cells), 6))
    if ties:
        vectors = vectors[rng.integers(0, 5, len(cells))]
    else:
        vectors += 1.5 * rng.normal(size=(6, 6))[identities]
    vectors = np.rint(vectors / np.linalg.norm(vectors, axis=1, keepdims=True) / GRID) * GRID
    return make_objects(
        vectors,
        identities,
        frames,
        sequences * 7 - 3,
        frames * 0.7,
        rng.uniform(5, 200, len(cells)),
        rng.uniform(5, 100, len(cells)),
    )


def distance(objects: DescribedObjects, a: int, b: int) -> float:
    difference = objects.descriptors[a].astype(np.float64) - objects.descriptors[b].astype(np.float64)
    return math.sqrt(sum(value * value for value in difference.tolist()))


def all_pairs(
    objects: DescribedObjects, min_gap_frames: int, max_gap_frames: int
) -> Iterator[tuple[int, int, float, bool]]:
    """Each pair once: rows, distance, whether the object is the same."""
    for a in range(len(objects)):
        for b in range(a):
            if objects.sequences[a] == objects.sequences[b]:
                gap = abs(int(objects.frames[a] - objects.frames[b]))
                if min_gap_frames <= gap <= max_gap_frames:
                    yield a, b, distance(objects, a, b), bool(objects.identities[a] == objects.identities[b])


def split_distances(
    objects: DescribedObjects, min_gap_frames: int, max_gap_frames: int
) -> tuple[list[float], list[float]]:
    """Distances of genuine and of impostor pairs."""
    pairs = list(all_pairs(objects, min_gap_frames, max_gap_frames))
    return [d for *_, d, same in pairs if same], [d for *_, d, same in pairs if not same]


def gallery(objects: DescribedObjects, query: int, min_gap_frames: int, max_gap_frames: int) -> list[int]:
    """The rows of a query's gallery, nearest first, equally near ones by row."""
    rows = [
        row
        for row in range(len(objects))
        if row != query
        and objects.sequences[row] == objects.sequences[query]
        and min_gap_frames <= abs(int(objects.frames[row] - objects.frames[query])) <= max_gap_frames
    ]
    return sorted(rows, key=lambda row: (distance(objects, query, row), row))


def shuffled(objects: DescribedObjects, seed: int) -> DescribedObjects:
    return objects[np.random.default_rng(seed).permutation(len(objects))]


def renamed(objects: DescribedObjects) -> DescribedObjects:
    """The same objects under other identity numbers, in another order."""
    return DescribedObjects(
        objects.descriptors,
        1000 - 3 * objects.identities,
        objects.sequences,
        objects.frames,
        objects.times_s,
        objects.heights_px,
        objects.widths_px,
    )
