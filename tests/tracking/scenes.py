"""Detections for tracker tests: boxes that do not matter, descriptors that do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lookonce.structures import Detections


def make_detections(descriptors: Sequence[Sequence[float]] | np.ndarray) -> Detections:
    """One box for each descriptor (N, D); descriptors are scaled to unit length, rows of zeros stay."""
    looks = np.array(descriptors, np.float64)
    lengths = np.linalg.norm(looks, axis=1, keepdims=True)
    looks = np.divide(looks, lengths, out=np.zeros_like(looks), where=lengths > 0).astype(np.float32)
    left = np.arange(len(looks), dtype=np.float32) * 20
    xyxy = np.stack([left, left * 0, left + 10, left * 0 + 30], axis=1)
    return Detections(xyxy, np.full(len(looks), 0.9, np.float32), np.arange(len(looks)), looks)


def at_angle(*degrees: float) -> np.ndarray:
    """Unit vectors (N, 2) at these angles; two of them are 2 sin(half their angle) apart."""
    radians = np.radians(degrees)
    return np.stack([np.cos(radians), np.sin(radians)], axis=1)


def apart(degrees: float) -> float:
    """The Euclidean distance of unit vectors that are so many degrees apart."""
    return float(2 * np.sin(np.radians(degrees) / 2))
