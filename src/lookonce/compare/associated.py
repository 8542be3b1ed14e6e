"""What a tracker makes of the detections of a sequence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.detections import DetectedSequence
from lookonce.structures import Filled

__all__ = ["Associated"]


@dataclass(frozen=True, slots=True)
class Associated:
    """The answer for R detections.

    Attributes:
        ids: (R,) int64, from 0; below 0 = none.
        xyxy: (R, 4) float32, px: the boxes to report, as detected unless the tracker makes its own.
        filled: further boxes, for frames in which nobody detected the object; frames are places in the sequence.
    """

    ids: NDArray[np.int64]
    xyxy: NDArray[np.float32]
    filled: Filled

    @classmethod
    def of(cls, sequence: DetectedSequence, answer: NDArray[np.int64] | Self) -> Self:
        """The same of an answer that may be ids alone."""
        return answer if isinstance(answer, cls) else cls(np.asarray(answer), sequence.xyxy, Filled.nothing())

    def save(self, path: Path) -> None:
        """Write it to a file."""
        filled = self.filled
        with open(path, "wb") as file:
            np.savez(file, self.ids, self.xyxy, filled.frames, filled.ids, filled.xyxy, filled.labels)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what ``save`` wrote."""
        with np.load(path, allow_pickle=False) as file:
            ids, xyxy, *filled = (file[name] for name in file.files)
        return cls(ids.astype(np.int64), xyxy, Filled(*filled))
