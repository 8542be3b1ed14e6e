"""Results as JSON lines: a header, then one object for each frame."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.output.append_only import AppendOnlyFile
from lookonce.output.sink import Sink
from lookonce.structures import NO_ID, Filled, GivenBack, Tracks, class_name
from lookonce.video.frame import Frame

__all__ = ["JsonLinesSink"]

_LAYOUT: dict[str, object] = {
    "format": "lookonce-tracks",
    "format_version": 1,
    "coordinates": "xyxy = left, top, right, bottom in px of the original image; size = height, width; "
    "frames count from 0; id null = no identity (yet)",
}
_BOX_DECIMALS = 2
_SCORE_DECIMALS = 4
_TIME_DECIMALS = 6


class JsonLinesSink(Sink):
    """Writes everything the tracker says, a JSON object a line, UTF-8.

    Every frame has a line, with objects or without: ``frame``, ``time_s``, ``size``, ``tracks`` (``id``, ``label``,
    ``name``, ``xyxy``, ``score``) and, where there are any, ``unseen`` (``id``, ``xyxy``), ``given_back``: tracks of
    earlier frames, each with its ``frame``, whose object is confirmed only now, and ``filled``: the same of objects
    that nobody detected in those frames, with score 0. A number that is not finite becomes null, since JSON has no
    other word for it.

    Args:
        path: the file; an existing one is emptied.
        keep: go on after so many bytes of an existing file.
        header: what the first line says besides the format: versions, hashes, settings; JSON values only.
        names: the class names by label.

    Raises:
        OutputError: the file cannot be created.
        ValueError: the header holds NaN, or a key that describes the format.
        TypeError: the header holds what JSON cannot say.
    """

    def __init__(self, path: Path, header: Mapping[str, object], names: Sequence[str], keep: int | None = None) -> None:
        taken = sorted(_LAYOUT.keys() & header.keys())
        if taken:
            raise ValueError(f"header: {', '.join(taken)} is written by the sink, got it from the caller")
        first_line = _line({**_LAYOUT, **header})
        self.path = path
        self._names = tuple(names)
        self._file = AppendOnlyFile(path, keep)
        if keep is None:
            self._file.append(first_line)

    def write(self, frame: Frame, tracks: Tracks) -> None:
        """Append the frame's line."""
        record: dict[str, object] = {
            "frame": frame.index,
            "time_s": _number(frame.time_s, _TIME_DECIMALS),
            "size": list(frame.size),
            "tracks": self._rows(tracks),
        }
        if len(tracks.unseen_ids):
            record["unseen"] = [
                {"id": identity, "xyxy": box}
                for identity, box in zip(tracks.unseen_ids.tolist(), _boxes(tracks.unseen_xyxy), strict=True)
            ]
        if len(tracks.given_back):
            record["given_back"] = self._earlier(tracks.given_back, tracks.given_back.scores)
        if len(tracks.filled):
            record["filled"] = self._earlier(tracks.filled, np.zeros(len(tracks.filled)))
        self._file.append(_line(record))

    def _rows(self, tracks: Tracks) -> list[dict[str, object]]:
        columns = zip(
            tracks.ids.tolist(), tracks.labels.tolist(), _boxes(tracks.xyxy), tracks.scores.tolist(), strict=True
        )
        return [
            {
                "id": None if identity == NO_ID else identity,
                "label": label,
                "name": class_name(self._names, label),
                "xyxy": box,
                "score": _number(score, _SCORE_DECIMALS),
            }
            for identity, label, box, score in columns
        ]

    def _earlier(self, rows: GivenBack | Filled, scores: NDArray[np.floating]) -> list[dict[str, object]]:
        columns = zip(
            rows.frames.tolist(),
            rows.ids.tolist(),
            rows.labels.tolist(),
            _boxes(rows.xyxy),
            scores.tolist(),
            strict=True,
        )
        return [
            {
                "frame": index,
                "id": identity,
                "label": label,
                "name": class_name(self._names, label),
                "xyxy": box,
                "score": _number(score, _SCORE_DECIMALS),
            }
            for index, identity, label, box, score in columns
        ]

    @property
    def size(self) -> int:
        """Bytes written."""
        return self._file.size

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()


def _line(record: Mapping[str, object]) -> bytes:
    text = json.dumps(record, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    # A lone surrogate has no UTF-8; "?" keeps the line valid.
    return (text + "\n").encode("utf-8", errors="replace")


def _boxes(xyxy: NDArray[np.float32]) -> list[list[float | None]]:
    return [[_number(value, _BOX_DECIMALS) for value in row] for row in xyxy.tolist()]


def _number(value: float, decimals: int) -> float | None:
    return round(value, decimals) + 0.0 if math.isfinite(value) else None  # + 0.0 turns -0.0 into 0.0
