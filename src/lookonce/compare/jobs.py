"""One task of a comparison: which rows of which detections one tracker gets."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

import numpy as np

from lookonce.compare.detections import DetectedSequence

__all__ = ["Answer", "Job", "select"]


@dataclass(frozen=True, slots=True)
class Job:
    """What a tracker is given; the same for all trackers but for ``min_score``, if they have no threshold of their own.

    Attributes:
        detections: the file.
        every: every so many-th frame.
        min_score: detections from this score on.
        labels: of these classes; none = all.
        answer: where the answer goes.
    """

    detections: str
    every: int
    min_score: float
    labels: tuple[int, ...]
    answer: str

    @classmethod
    def of_line(cls, line: str) -> Job:
        """What ``line`` gave."""
        content = json.loads(line)
        return cls(**{**content, "labels": tuple(content["labels"])})

    def line(self) -> str:
        """On one line."""
        return json.dumps(asdict(self))

    def select(self, sequence: DetectedSequence) -> DetectedSequence:
        """The rows that are meant."""
        return select(sequence, self.every, self.min_score, self.labels)


@dataclass(frozen=True, slots=True)
class Answer:
    """How a task went.

    Attributes:
        seconds: of the association, by the clock; 0 where there is none.
        cpu_s: the same in processor time.
        frames: how many there were.
        peak_mb: largest resident memory of the process so far, libraries and detections included.
        error: what went wrong; "" = nothing.
    """

    seconds: float = 0.0
    cpu_s: float = 0.0
    frames: int = 0
    peak_mb: float = 0.0
    error: str = ""


def select(sequence: DetectedSequence, every: int, min_score: float, labels: tuple[int, ...]) -> DetectedSequence:
    """Rows from a score on, of some classes (none = all), in every so many-th frame."""
    kept = sequence.every(every)
    is_kept = kept.scores >= np.float32(min_score)
    if labels:
        is_kept &= np.isin(kept.labels, labels)
    return kept.rows(is_kept)
