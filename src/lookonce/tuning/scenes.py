"""What is tuned on: sequences with truth and detections, thinned and cut in time."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.detections import DetectedSequence
from lookonce.evaluation import TrackingTruth

__all__ = ["TuningScene"]


@dataclass(frozen=True, slots=True)
class TuningScene:
    """A sequence, or a part of one.

    Attributes:
        name: of the sequence.
        truth: what is to be found.
        detections: what the detector found, from the lowest score on that any settings may ask for.
    """

    name: str
    truth: TrackingTruth
    detections: DetectedSequence

    @property
    def has_objects(self) -> bool:
        """Whether there is anything to be found."""
        return bool(self.truth.is_counted.any())

    def every(self, step: int) -> TuningScene:
        """The frames whose number is a multiple of ``step``."""
        truth = self.truth.in_frames(self.truth.frames % step == 0)
        return replace(self, truth=truth, detections=self.detections.every(step))

    def cut(self, parts: int) -> list[TuningScene]:
        """Consecutive parts of equally many frames; none is without a frame."""
        frames = self.truth.frames
        parts = max(1, min(parts, len(frames)))
        firsts = [0, *(int(frames[len(frames) * number // parts]) for number in range(1, parts))]
        lasts = [*firsts[1:], np.iinfo(np.int64).max]
        return [self._between(first, last) for first, last in zip(firsts, lasts, strict=True)]

    def _between(self, first: int, end: int) -> TuningScene:
        """The frames from ``first`` to before ``end``."""
        truth = self.truth.in_frames((self.truth.frames >= first) & (self.truth.frames < end))
        found = self.detections
        chosen = (found.frames >= first) & (found.frames < end)
        kept = found.rows(np.repeat(chosen, np.diff(found.starts)))
        starts = np.concatenate([[0], np.cumsum(np.diff(found.starts)[chosen])]).astype(np.int64)
        kept = replace(kept, frames=found.frames[chosen], times=found.times[chosen], starts=starts)
        return replace(self, truth=truth, detections=kept)

    def digest(self) -> str:
        """A number for all that scores depend on: another one, other truth or detections."""
        truth, found = self.truth, self.detections
        total = hashlib.sha256(self.name.encode("utf-8", "surrogateescape"))
        total.update(f"{found.size}".encode())
        arrays: tuple[NDArray[Any], ...] = (
            truth.frames,
            truth.row_frames,
            truth.ids,
            truth.xyxy,
            truth.is_counted,
            truth.is_distractor,
        )
        arrays += (truth.ignored,) if len(truth.ignored) else ()
        arrays += (found.frames, found.times, found.starts, found.xyxy, found.scores, found.labels)
        for array in (*arrays, *(() if found.descriptors is None else (found.descriptors,))):
            total.update(f"{array.shape} {array.dtype}".encode())
            total.update(np.ascontiguousarray(array).data)
        for step, maps in sorted(found.cameras.items()):
            for frame in np.intersect1d(np.array(sorted(maps), np.int64), found.frames).tolist():
                total.update(f"{step} {frame} {maps[frame].tolist()}".encode())
        return total.hexdigest()
