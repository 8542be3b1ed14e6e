"""How far apart a model's descriptors put boxes of one object and of two, seen at its own detections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lookonce.errors import ModelError
from lookonce.evaluation import (
    DescribedObjects,
    PairDistances,
    TrackingResult,
    TrackingTruth,
    equal_error_rate,
    pair_distances,
    rates_at,
    roc_auc,
)
from lookonce.evaluation.tracking.following import follow
from lookonce.model import Model
from lookonce.report.pictures import frames_of
from lookonce.report.spans import Clock
from lookonce.structures import Detections

__all__ = ["DescribedSequence", "Descriptors", "describe"]

_MOST_FRAMES = 200  # of a sequence: some seconds of one core
_TICKS_PER_S = 1000
_LEAST_S, _MOST_S = 0.5, 30.0  # as `lookonce probe` has it: before, nothing changes; after, few are still in view
_DRAWN_BINS = 64
_USUAL_RATE = 25.0


@dataclass(frozen=True, slots=True)
class DescribedSequence:
    """A sequence with truth whose pictures can be found."""

    name: str
    truth: TrackingTruth
    pictures: Path
    clock: Clock


@dataclass(frozen=True, slots=True)
class Descriptors:
    """What was measured.

    Attributes:
        model: name of the file.
        frames: that were looked at.
        boxes: true boxes that the model found and described.
        identities: different objects among them.
        genuine: (64,) pairs of one object by distance, from 0 to 2.
        impostor: (64,) pairs of two objects.
        equal_error_rate: NaN without pairs of both kinds.
        equal_error_distance: where that is.
        roc_auc: probability that a pair of one object is nearer than one of two.
        threshold: distance below which the model file lets a tracker match; None = it does not say.
        accepted: at this threshold, share of the pairs of two objects that are nearer.
        rejected: and of the pairs of one object that are not.
    """

    model: str
    frames: int
    boxes: int
    identities: int
    genuine: tuple[int, ...]
    impostor: tuple[int, ...]
    equal_error_rate: float
    equal_error_distance: float
    roc_auc: float
    threshold: float | None
    accepted: float
    rejected: float


def describe(
    model: Model, sequences: Sequence[DescribedSequence], on_frame: Callable[[str, int, int], None]
) -> Descriptors:
    """Runs the model on at most 200 frames of each sequence, evenly spread.

    A detection stands for the true object that it is matched with, as the figures match them (IoU of 0.5).

    Raises:
        ModelError: the model has no descriptors.
        VideoError: pictures cannot be read.
    """
    info = model.metadata.descriptor
    if info is None:
        raise ModelError(f"{model.path}: has no descriptors; train some with 'lookonce fit', or leave --model away")
    parts = [_describe_sequence(model, number, one, on_frame) for number, one in enumerate(sequences)]
    objects = _together([part for part, _ in parts], info.size)
    pairs = pair_distances(objects, round(_LEAST_S * _TICKS_PER_S), round(_MOST_S * _TICKS_PER_S) - 1)
    rate, distance = equal_error_rate(pairs)
    accepted, rejected = rates_at(pairs, info.match_threshold) if info.match_threshold else (np.nan, np.nan)
    return Descriptors(
        model=model.path.name,
        frames=sum(frames for _, frames in parts),
        boxes=len(objects),
        identities=len(set(zip(objects.sequences.tolist(), objects.identities.tolist(), strict=True))),
        genuine=_drawn(pairs, "genuine"),
        impostor=_drawn(pairs, "impostor"),
        equal_error_rate=rate,
        equal_error_distance=distance,
        roc_auc=roc_auc(pairs),
        threshold=info.match_threshold,
        accepted=float(accepted),
        rejected=float(rejected),
    )


def _drawn(pairs: PairDistances, kind: str) -> tuple[int, ...]:
    counts = pairs.genuine if kind == "genuine" else pairs.impostor
    return tuple(counts.reshape(_DRAWN_BINS, -1).sum(axis=1).tolist())


def _describe_sequence(
    model: Model, number: int, sequence: DescribedSequence, on_frame: Callable[[str, int, int], None]
) -> tuple[list[DescribedObjects], int]:
    """Of each frame its described objects on a clock of milliseconds, and how many frames were read."""
    truth = sequence.truth
    frames = np.unique(truth.row_frames[truth.is_counted])
    chosen = frames[np.unique(np.linspace(0, len(frames) - 1, min(len(frames), _MOST_FRAMES)).astype(np.int64))]
    found: list[tuple[int, float, Detections]] = []
    for frame in frames_of(sequence.pictures, set(chosen.tolist())):
        seconds = sequence.clock.seconds(frame.index)
        time_s = frame.index / _USUAL_RATE if seconds is None else seconds
        found.append((frame.index, time_s, model.detect(frame)))
        on_frame(sequence.name, len(found), len(chosen))
    return _match(number, truth, found), len(found)


def _match(number: int, truth: TrackingTruth, found: Sequence[tuple[int, float, Detections]]) -> list[DescribedObjects]:
    """The detections that are matched with true objects, frame by frame."""
    counts = [len(detections) for _, _, detections in found]
    total = sum(counts)
    every = np.arange(total)
    frames = np.repeat(np.array([frame for frame, _, _ in found], np.int64), counts)
    xyxy = np.concatenate([np.zeros((0, 4)), *(detections.xyxy.astype(np.float64) for _, _, detections in found)])
    following = follow(truth, TrackingResult(frames, every, xyxy, every * 0))
    identity_of = np.full(total, -1, np.int64)
    hit = following.partners >= 0
    identity_of[following.partners[hit]] = truth.ids[following.truth_rows[hit]]
    parts, first = [], 0
    for (_, time_s, detections), count in zip(found, counts, strict=True):
        identities = identity_of[first : first + count]
        first += count
        vectors = detections.descriptors
        assert vectors is not None  # the model has some
        rows = np.flatnonzero((identities >= 0) & (np.einsum("nd,nd->n", vectors, vectors) > 0.5))
        size = detections.xyxy[rows, 2:] - detections.xyxy[rows, :2]
        same = np.ones(len(rows), np.int64)
        ticks = round(time_s * _TICKS_PER_S)
        parts.append(
            DescribedObjects(
                vectors[rows],
                identities[rows],
                same * number,
                same * ticks,
                np.full(len(rows), time_s),
                size[:, 1].copy(),
                size[:, 0].copy(),
            )
        )
    return parts


def _together(parts: Sequence[Sequence[DescribedObjects]], size: int) -> DescribedObjects:
    """All rows of all sequences."""
    every = [one for part in parts for one in part if len(one)]
    if not every:
        none, zero = np.zeros(0, np.int64), np.zeros(0, np.float32)
        return DescribedObjects(np.zeros((0, size), np.float32), none, none, none, np.zeros(0), zero, zero)
    return DescribedObjects(
        np.concatenate([one.descriptors for one in every]),
        np.concatenate([one.identities for one in every]),
        np.concatenate([one.sequences for one in every]),
        np.concatenate([one.frames for one in every]),
        np.concatenate([one.times_s for one in every]),
        np.concatenate([one.heights_px for one in every]),
        np.concatenate([one.widths_px for one in every]),
    )
