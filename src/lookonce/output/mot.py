"""Results as MOTChallenge text: the only place where frames count from 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lookonce.boxes import xyxy_to_ltwh
from lookonce.output.append_only import AppendOnlyFile
from lookonce.output.sink import Sink
from lookonce.structures import Filled, GivenBack, Tracks
from lookonce.video.frame import Frame

__all__ = ["MotSink"]

_FIRST_ID = 1
_LINE = "{},{},{:.2f},{:.2f},{:.2f},{:.2f},{:.4f},-1,-1,-1\n"


class MotSink(Sink):
    """Writes ``frame,id,left,top,width,height,score,-1,-1,-1``, a line a box, frames from 1.

    Rows without identity, and rows with a number that is not finite, have no place in this format and are left out.
    Boxes for frames in which nobody detected the object have score 0.

    Args:
        path: the text file; an existing one is emptied.
        keep: go on after so many bytes of an existing file.

    Raises:
        OutputError: the file cannot be created.
    """

    def __init__(self, path: Path, keep: int | None = None) -> None:
        self.path = path
        self._file = AppendOnlyFile(path, keep)

    def write(self, frame: Frame, tracks: Tracks) -> None:
        """Append the frame's lines in one piece; a frame without identities adds none.

        Rows of earlier frames, given back or filled in, follow those of the frame.
        """
        finite = np.isfinite(tracks.xyxy).all(axis=1) & np.isfinite(tracks.scores)
        rows = np.flatnonzero((tracks.ids >= _FIRST_ID) & finite)
        boxes = xyxy_to_ltwh(tracks.xyxy[rows]).tolist()
        ids, scores = tracks.ids[rows].tolist(), tracks.scores[rows].tolist()
        lines = [
            _LINE.format(frame.index + 1, identity, *ltwh, score)
            for identity, ltwh, score in zip(ids, boxes, scores, strict=True)
        ]
        later = _lines(tracks.given_back) + _lines(tracks.filled)
        self._file.append("".join(lines + later).encode("ascii"))

    def write_rows(self, rows: GivenBack | Filled) -> None:
        """Append rows of any frames in one piece."""
        self._file.append("".join(_lines(rows)).encode("ascii"))

    @property
    def size(self) -> int:
        """Bytes written."""
        return self._file.size

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()


def _lines(rows: GivenBack | Filled) -> list[str]:
    if not len(rows):
        return []
    scores = rows.scores.tolist() if isinstance(rows, GivenBack) else [0.0] * len(rows)
    columns = rows.frames.tolist(), rows.ids.tolist(), xyxy_to_ltwh(rows.xyxy).tolist(), scores
    return [
        _LINE.format(index + 1, identity, *ltwh, score) for index, identity, ltwh, score in zip(*columns, strict=True)
    ]
