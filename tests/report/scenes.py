"""Small truths, results and explanations that the tests of the report share."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from lookonce.evaluation import TrackingResult, TrackingTruth
from lookonce.report.explained import Candidate, ExplainedRow, Explanation
from lookonce.report.run_lines import RunLines

SIDE = 10.0


def boxes(left: object) -> np.ndarray:
    column = np.asarray(left, np.float64)
    return np.column_stack([column, column * 0 + 1, column + SIDE, column * 0 + 1 + SIDE])


def make_truth(objects: dict[int, list[int]], frames: int, places: dict[int, float] | None = None) -> TrackingTruth:
    """Object -> frames it is in; each stands at its own place, 40 px from the next."""
    rows = [(frame, one) for one, when in objects.items() for frame in when]
    frame, ids = (np.array([row[column] for row in rows], np.int64).reshape(-1) for column in (0, 1))
    every = np.ones(len(rows), np.bool_)
    left = [(places or {}).get(one, 40.0 * one) for one in ids.tolist()]
    return TrackingTruth(np.arange(frames), frame, ids, boxes(left), ids * 0, every, ~every)


def make_result(rows: list[tuple[int, int, float]]) -> TrackingResult:
    """Rows of frame, identity, and the object at whose place the box is (or between two of them)."""
    frame, ids = (np.array([row[column] for row in rows], np.int64).reshape(-1) for column in (0, 1))
    return TrackingResult(frame, ids, boxes([40.0 * row[2] for row in rows]).reshape(-1, 4), ids * 0)


def lines_of(result: TrackingResult, size: tuple[int, int] | None = None, **others: object) -> RunLines:
    return RunLines(
        result.row_frames,
        result.xyxy,
        np.linspace(0.9, 0.3, len(result)),
        result.ids * 0,
        ("car",),
        result.ids,
        np.unique(result.row_frames),
        size=size,
        **others,
    )


def explained(frame: int, identity: int | None, decision: str, *candidates: Candidate, reason: str = "") -> Explanation:
    """One row of one frame."""
    box = (0.0, 1.0, 10.0, 11.0)
    return Explanation({frame: (ExplainedRow(identity, box, decision, reason, candidates),)})


HEADER = {"format": "lookonce-explain", "format_version": 1}
TRACKS_HEADER = {"format": "lookonce-tracks", "format_version": 1}


def write_lines(path: Path, *records: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(json.dumps(record) + "\n" for record in records), encoding="utf-8")
    return path
