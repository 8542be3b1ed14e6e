"""What a run's ``tracks.jsonl`` says beside identities: how it was made, when each frame was, and every detection."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets import read_mot_results
from lookonce.datasets.json_lines import Record, read_records
from lookonce.datasets.text import MAX_ROWS, fault

__all__ = ["RunLines", "read_mot_lines", "read_run_lines"]

_FORMAT, _VERSION = "lookonce-tracks", 1
_NO_FRAMES = np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True)
class RunLines:
    """What a file of results says; N detections, with identity or without.

    Attributes:
        row_frames: (N,) int64, from 0.
        xyxy: (N, 4) float64, px; left < right and top < bottom.
        scores: (N,) float64; 1 where the file says nothing.
        labels: (N,) int64, places in ``names``.
        names: class names; empty for MOT text.
        ids: (N,) int64; -1 = without identity when its frame was written.
        frames: (F,) int64, all frames of which the file tells, rising.
        times_s: frame -> time, where stated.
        size: (height, width) of the picture in px; None = not stated.
        facts: how the run was made: what -> value.
        source: what was tracked, as its user named it; "" = not stated.
        given_back: how many of the rows without identity got one later.
    """

    row_frames: NDArray[np.int64]
    xyxy: NDArray[np.float64]
    scores: NDArray[np.float64]
    labels: NDArray[np.int64]
    names: tuple[str, ...]
    ids: NDArray[np.int64]
    frames: NDArray[np.int64]
    times_s: Mapping[int, float] = field(default_factory=dict)
    size: tuple[int, int] | None = None
    facts: Mapping[str, str] = field(default_factory=dict)
    source: str = ""
    given_back: int = 0


@dataclass(slots=True)
class _Collected:
    boxes: array[float] = field(default_factory=lambda: array("d"))
    numbers: array[int] = field(default_factory=lambda: array("q"))
    names: dict[str, int] = field(default_factory=dict)
    frames: set[int] = field(default_factory=set)
    times_s: dict[int, float] = field(default_factory=dict)
    size: tuple[int, int] | None = None
    given_back: int = 0


def read_mot_lines(path: Path) -> RunLines:
    """The same of a MOT text, which says less.

    Raises:
        FormatError: it breaks its format.
    """
    rows = read_mot_results(path)
    has_area = (rows.xyxy[:, 2:] > rows.xyxy[:, :2]).all(axis=1)
    kept = np.flatnonzero(has_area & (rows.flags != 0))  # score 0: filled in, nobody detected it
    none = np.zeros(len(kept), np.int64)
    frames = np.unique(rows.frames)
    return RunLines(rows.frames[kept], rows.xyxy[kept], rows.flags[kept], none, (), rows.ids[kept], frames)


def read_run_lines(path: Path) -> RunLines:
    """All of a ``tracks.jsonl``; boxes without area, and those with a number that was not finite, are left out.

    Raises:
        FormatError: it breaks its format.
    """
    header, records = read_records(path, _FORMAT, _VERSION)
    found = _Collected()
    for record in records:
        _add_frame_(found, record)
    boxes = np.array(found.boxes, np.float64).reshape(-1, 5)
    numbers = np.array(found.numbers, np.int64).reshape(-1, 3)
    settings = header.record("settings")
    return RunLines(
        row_frames=numbers[:, 0].copy(),
        xyxy=boxes[:, :4].copy(),
        scores=boxes[:, 4].copy(),
        labels=numbers[:, 2].copy(),
        names=tuple(found.names),
        ids=numbers[:, 1].copy(),
        frames=np.array(sorted(found.frames), np.int64) if found.frames else _NO_FRAMES,
        times_s=found.times_s,
        size=found.size,
        facts=_facts(header, settings),
        source=settings.text("source") or "",
        given_back=found.given_back,
    )


def _add_frame_(found: _Collected, record: Record) -> None:
    """Add the detections of one frame to ``found``."""
    frame = record.frame()
    found.frames.add(frame)
    if (time_s := record.number("time_s")) is not None:
        found.times_s[frame] = time_s
    if found.size is None:
        found.size = _size(record)
    found.given_back += len(record.records("given_back"))
    for track in record.records("tracks"):
        box, score = track.box(), track.number("score")
        if box is None or box[2] <= box[0] or box[3] <= box[1]:
            continue
        identity, name = track.whole("id"), track.text("name") or ""
        label = found.names.setdefault(name, len(found.names))
        found.boxes.extend((*box, 1.0 if score is None or not math.isfinite(score) else score))
        found.numbers.extend((frame, -1 if identity is None else identity, label))
    if len(found.numbers) > 3 * MAX_ROWS:
        raise fault(record.path, record.line, f"more than {MAX_ROWS:,} boxes; split it into sequences")


def _size(record: Record) -> tuple[int, int] | None:
    value = record.fields.get("size")
    if value is None:
        return None
    if not (isinstance(value, list) and len(value) == 2 and all(type(one) is int and 0 < one < 1e6 for one in value)):
        raise record.bad("size", "height and width in px")
    return value[0], value[1]


def _facts(header: Record, settings: Record) -> dict[str, str]:
    """How the run was made, as far as its header tells; each value a short text."""
    model, versions = header.record("model"), header.record("versions")
    found = {
        "source": settings.text("source"),
        "detections": header.record("detections").text("file"),
        "model": model.text("file"),
        "model SHA-256": model.text("sha256"),
        "tracker": settings.text("tracker"),
        "lookonce": versions.text("lookonce"),
    }
    for name, unit in (("score", ""), ("match_threshold", ""), ("every", ""), ("fps", "")):
        if (value := settings.number(name)) is not None:
            found[name.replace("_", " ")] = f"{value:g}{unit}"
    return {name: value for name, value in found.items() if value}
