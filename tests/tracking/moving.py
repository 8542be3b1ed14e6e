"""Boxes that move, for tests of the presets `default` and `iou`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import Detections
from lookonce.tracking import Tracker, TrackerConfig

STEP_S = 0.04


def seen(
    *places: tuple[float, float],
    scores: float | Sequence[float] = 0.9,
    labels: int | Sequence[int] = 0,
    looks: Sequence[Sequence[float]] | NDArray[np.float64] | None = None,
    size: tuple[float, float] = (20, 40),
) -> Detections:
    """One box of ``size`` (width, height) around each place (x, y); ``looks`` (N, D) are scaled to unit length."""
    count, half = len(places), np.array(size) / 2
    centre = np.array(places, np.float64).reshape(count, 2)
    descriptors = None
    if looks is not None:
        exact = np.array(looks, np.float64)
        length = np.linalg.norm(exact, axis=1, keepdims=True)
        descriptors = np.divide(exact, length, out=np.zeros_like(exact), where=length > 0).astype(np.float32)
    return Detections(
        np.concatenate([centre - half, centre + half], axis=1).astype(np.float32),
        np.broadcast_to(np.array(scores, np.float32), count).copy(),
        np.broadcast_to(np.array(labels, np.int64), count).copy(),
        descriptors,
    )


def ids_of(
    frames: Sequence[Detections], preset: str | TrackerConfig = "default", times: Sequence[float] | None = None
) -> list[list[int]]:
    """Ids of each frame's rows by a new tracker, frames 40 ms apart; rows that are given back have their ids too."""
    tracker = Tracker(preset)
    answers: list[list[int]] = []
    for number, frame in enumerate(frames):
        time_s = number * STEP_S if times is None else times[number]
        tracks = tracker.update(frame, time_s)
        answers.append(tracks.ids.tolist())
        back = tracks.given_back
        for earlier, row, identity in zip(back.frames.tolist(), back.rows.tolist(), back.ids.tolist(), strict=True):
            assert answers[earlier][row] == -1
            answers[earlier][row] = identity
    return answers


class CrowdFrame(NamedTuple):
    """Rows (N, 6) ``x1 y1 x2 y2 score label``, descriptors (N, D), who each row is (N,), and the time in seconds."""

    rows: NDArray[np.float64]
    looks: NDArray[np.float64]
    objects: NDArray[np.int64]
    time_s: float


def crowd(objects: int, frames: int, seed: int, area_px: float = 600.0, size: int = 16) -> Iterator[CrowdFrame]:
    """Objects that bounce about in a square, come and go, are missed and cover each other; rows in random order."""
    rng = np.random.default_rng(seed)
    place, speed = rng.uniform(0, area_px, (objects, 2)), rng.normal(0, 60, (objects, 2))
    height, looks = rng.uniform(30, 60, objects), rng.normal(size=(objects, size))
    name, time_s = np.arange(objects), 0.0
    for _ in range(frames):
        gone = rng.random(objects) < 0.005
        place[gone], looks[gone] = (
            rng.uniform(0, area_px, (int(gone.sum()), 2)),
            rng.normal(size=(int(gone.sum()), size)),
        )
        name[gone] += objects
        step_s = float(rng.uniform(0.03, 0.05))
        time_s += step_s
        place += speed * step_s
        speed = np.where(((place < 0) & (speed < 0)) | ((place > area_px) & (speed > 0)), -speed, speed)
        rows = rng.permutation(np.flatnonzero(rng.random(objects) >= 0.08))
        half = np.stack([height[rows] / 4, height[rows] / 2], axis=1)
        centre = place[rows] + rng.normal(0, 1, (len(rows), 2))
        scores = rng.uniform(0.15, 1, len(rows)) ** 0.5
        boxes = np.concatenate([centre - half, centre + half], axis=1)
        table = np.column_stack([boxes, scores, name[rows] % 3])
        yield CrowdFrame(table, looks[rows] + rng.normal(0, 0.3, (len(rows), size)), name[rows].copy(), time_s)
