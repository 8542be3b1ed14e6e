"""Why each detection got its identity, as JSON lines."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from lookonce.output.append_only import AppendOnlyFile
from lookonce.output.sink import Sink
from lookonce.stories import Candidate
from lookonce.structures import NO_ID, Tracks
from lookonce.video.frame import Frame

__all__ = ["ExplainSink"]

_LAYOUT: dict[str, object] = {
    "format": "lookonce-explain",
    "format_version": 1,
    "about": "frames count from 0; cost = minus the logarithm of the likelihood ratio, below 0 it may be taken; "
    "motion = standard deviations from the expected place; distance = of the descriptors, 0 to 2",
}
_DECIMALS = 4


class ExplainSink(Sink):
    """Writes a line a frame: every detection with its decision and the objects that it was held against.

    Where an identity gets detections of earlier frames, or boxes for frames in which it was missed, ``given_back`` and
    ``filled`` say which (``frame``, ``id``, and the ``row`` of the detection).

    Args:
        path: the file; an existing one is emptied.
        keep: go on after so many bytes of an existing file.
        header: what the first line says besides the format; JSON values only.

    Raises:
        OutputError: the file cannot be created.
    """

    def __init__(self, path: Path, header: Mapping[str, object], keep: int | None = None) -> None:
        self.path = path
        self._file = AppendOnlyFile(path, keep)
        if keep is None:
            self._append({**_LAYOUT, **header})

    def write(self, frame: Frame, tracks: Tracks) -> None:
        """Append the frame's line; a frame whose tracker was not asked to explain has rows without reasons."""
        record: dict[str, object] = {"frame": frame.index, "time_s": round(frame.time_s, 6), "rows": []}
        if tracks.story is not None:
            record["rows"] = [
                {
                    "row": row.row,
                    "id": None if tracks.ids[row.row] == NO_ID else int(tracks.ids[row.row]),
                    "xyxy": [round(value, 2) for value in tracks.xyxy[row.row].tolist()],
                    "score": round(float(tracks.scores[row.row]), _DECIMALS),
                    "label": int(tracks.labels[row.row]),
                    "decision": row.decision,
                    "reason": row.reason,
                    "candidates": [_fields(one) for one in row.candidates],
                }
                for row in tracks.story.rows
            ]
            record["ended"] = [{"id": one.id, "why": one.why} for one in tracks.story.ended]
        if len(back := tracks.given_back):
            columns = (back.frames.tolist(), back.rows.tolist(), back.ids.tolist())
            record["given_back"] = [
                {"frame": index, "row": row, "id": identity} for index, row, identity in zip(*columns, strict=True)
            ]
        if len(filled := tracks.filled):
            pairs = zip(filled.frames.tolist(), filled.ids.tolist(), strict=True)
            record["filled"] = [{"frame": index, "id": identity} for index, identity in pairs]
        self._append(record)

    def _append(self, record: Mapping[str, object]) -> None:
        self._file.append((json.dumps(record, allow_nan=False, separators=(",", ":")) + "\n").encode("utf-8"))

    @property
    def size(self) -> int:
        """Bytes written."""
        return self._file.size

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()


def _fields(one: Candidate) -> dict[str, object]:
    return {
        "id": one.id,
        "cost": None if one.gain is None else round(-one.gain, _DECIMALS) + 0.0,
        "overlap": round(one.overlap, _DECIMALS),
        "distance": None if one.distance is None else round(one.distance, _DECIMALS),
        "motion": round(one.deviation, _DECIMALS),
        "unseen_s": round(one.unseen_s, 6),
        "refused": one.refused or None,
    }
