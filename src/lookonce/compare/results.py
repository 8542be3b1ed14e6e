"""A tracker's answer as a MOT text, from which the figures are made: whoever evaluates the file gets the same ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.associated import Associated
from lookonce.compare.detections import DetectedSequence
from lookonce.errors import OutputError
from lookonce.output.mot import MotSink
from lookonce.structures import NO_ID, Filled, Tracks
from lookonce.video import Frame
from lookonce.video.opening import one_line

__all__ = ["write_results"]

_NO_PICTURE = np.zeros((1, 1, 3), np.uint8)


def write_results(path: Path, sequence: DetectedSequence, answer: NDArray[np.int64] | Associated) -> None:
    """Writes the rows that have an identity, and those that the tracker has filled in.

    Args:
        path: the text file; its folder is made.
        sequence: R rows.
        answer: of the tracker; or ids (R,) alone, from 0; below 0 = none.

    Raises:
        OutputError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise OutputError(f"{one_line(path.parent)}: cannot be made ({exc.strerror}); choose another with -o") from exc
    answer = Associated.of(sequence, answer)
    numbers = np.where(answer.ids >= 0, answer.ids + 1, NO_ID)  # MOT text counts identities from 1
    gaps = answer.filled
    none, nowhere = np.zeros(0, np.int64), np.zeros((0, 4), np.float32)
    with MotSink(path) as sink:
        first = 0
        for frame in sequence:
            found = frame.detections
            rows = slice(first, first + len(found))
            first += len(found)
            tracks = Tracks(numbers[rows], answer.xyxy[rows], found.scores, found.labels, none, nowhere)
            sink.write(Frame(frame.index, frame.time_s, _NO_PICTURE), tracks)
        sink.write_rows(Filled(sequence.frames[gaps.frames], gaps.ids + 1, gaps.xyxy, gaps.labels))
