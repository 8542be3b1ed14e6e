"""Tracks as ``lookonce track`` keeps them: JSON lines with class names."""

from __future__ import annotations

import json
import math
from array import array
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lookonce.boxes import FARTHEST_PX
from lookonce.datasets.class_names import check_class_name
from lookonce.datasets.json_lines import read_records
from lookonce.datasets.text import LARGEST_WHOLE, MAX_ROWS, fault, quoted
from lookonce.datasets.track_rows import MAX_FRAMES, TrackRows, first_twins
from lookonce.errors import FormatError
from lookonce.structures import NO_ID

__all__ = ["NamedTrackRows", "read_jsonl_results"]

_FORMAT, _VERSION = "lookonce-tracks", 1
_NO_IDENTITY, _NO_NUMBER = "no identity (yet)", "a number that is not finite"


@dataclass(frozen=True, slots=True)
class NamedTrackRows:
    """Rows with the names of their classes.

    Attributes:
        rows: their labels are places in ``names``.
        names: class names, in the order in which they first occur.
        left_out: why -> number of rows.
    """

    rows: TrackRows
    names: tuple[str, ...]
    left_out: dict[str, int]


@dataclass(slots=True)
class _Collected:
    """What has been read so far: corners and score of each box, its frame, id, label and line, and the class names."""

    needs_identity: bool
    boxes: array[float] = field(default_factory=lambda: array("d"))
    numbers: array[int] = field(default_factory=lambda: array("q"))
    names: dict[str, int] = field(default_factory=dict)
    left_out: Counter[str] = field(default_factory=Counter)


def read_jsonl_results(path: Path, *, needs_identity: bool = True) -> NamedTrackRows:
    """The boxes of a ``tracks.jsonl``; frames count from 0 in it.

    Boxes without identity, and those with a number that was not finite, are left out and counted. What a tracker
    believes of unseen objects is no result. A header alone is a result without boxes.

    Args:
        path: the file.
        needs_identity: whether boxes without identity are left out; else their id is -1, and an id may come twice.

    Raises:
        FormatError: it breaks its format, is of another version, or a frame has an id twice.
    """
    _, records = read_records(path, _FORMAT, _VERSION)
    found = _Collected(needs_identity)
    for record in records:
        _add_frame(path, record.line, record.fields, found)
    boxes = np.array(found.boxes, np.float64).reshape(-1, 5)
    numbers = np.array(found.numbers, np.int64).reshape(-1, 4)
    frames, ids, labels = (numbers[:, column].copy() for column in range(3))
    rows = TrackRows(frames, ids, boxes[:, :4].copy(), labels, boxes[:, 4].copy())
    if needs_identity and (twins := first_twins(rows.frames, rows.ids)):
        first, second = twins
        message = f"id {rows.ids[first]} a second time in frame {rows.frames[first]}; remove one of the two"
        raise fault(path, int(numbers[second, 3]), message)
    return NamedTrackRows(rows, tuple(found.names), {why: count for why, count in found.left_out.items() if count > 0})


def _add_frame(path: Path, line: int, record: dict[str, object], found: _Collected) -> None:
    frame = _whole(record.get("frame"), MAX_FRAMES)
    tracks = record.get("tracks")
    if frame is None or not isinstance(tracks, list):
        message = f"expected frame (0 to {MAX_FRAMES:,}) and a list of tracks; mend or remove the line"
        raise fault(path, line, message)
    for track in tracks:
        _add_track(path, line, frame, track, found)
    if found.needs_identity:  # else those given back have been read before, and what is filled in was not detected
        given_back = _add_earlier(path, line, frame, record, "given_back", found)
        found.left_out[_NO_IDENTITY] -= given_back
        _add_earlier(path, line, frame, record, "filled", found)
    if len(found.numbers) > 4 * MAX_ROWS:
        raise fault(path, line, f"more than {MAX_ROWS:,} boxes; split it into sequences")


def _add_earlier(path: Path, line: int, frame: int, record: dict[str, object], what: str, found: _Collected) -> int:
    """Add the tracks of earlier frames under the key ``what``; how many."""
    tracks = record.get(what, [])
    if not isinstance(tracks, list):
        raise _bad(path, line, f"{what}: a list of tracks", tracks)
    for track in tracks:
        earlier = _whole(track.get("frame"), frame) if isinstance(track, dict) else None
        if earlier is None:
            raise _bad(path, line, f"{what}: tracks with a frame up to {frame}", track)
        _add_track(path, line, earlier, track, found)
    return len(tracks)


def _add_track(path: Path, line: int, frame: int, track: object, found: _Collected) -> None:
    if not isinstance(track, dict) or not {"id", "name", "xyxy"} <= track.keys():
        raise _bad(path, line, "a track with id, name and xyxy", track)
    if track["id"] is None and found.needs_identity:
        found.left_out[_NO_IDENTITY] += 1
        return
    identity = NO_ID if track["id"] is None else _whole(track["id"], LARGEST_WHOLE)
    name, xyxy = track["name"], track["xyxy"]
    if identity is None:
        raise _bad(path, line, "id: a whole number from 0", track["id"])
    if not isinstance(name, str):
        raise _bad(path, line, "name: a text", name)
    if not isinstance(xyxy, list) or len(xyxy) != 4:
        raise _bad(path, line, "xyxy: four numbers", xyxy)
    if None in xyxy:
        found.left_out[_NO_NUMBER] += 1
        return
    numbers = [_number(value) for value in xyxy]
    if not all(abs(value) <= FARTHEST_PX for value in numbers):  # also for NaN, which stands for no number
        raise _bad(path, line, f"xyxy: four numbers up to {FARTHEST_PX:,.0f} px", xyxy)
    if numbers[2] < numbers[0] or numbers[3] < numbers[1]:
        raise _bad(path, line, "xyxy: left <= right and top <= bottom", xyxy)
    score = _number(track.get("score"))
    label = found.names.setdefault(check_class_name(name, path, line), len(found.names))
    found.boxes.extend((*numbers, score if math.isfinite(score) else 1.0))
    found.numbers.extend((frame, identity, label, line))


def _bad(path: Path, line: int, expected: str, got: object) -> FormatError:
    return fault(path, line, f"expected {expected}, got {quoted(json.dumps(got))}; mend or remove it")


def _whole(value: object, largest: float) -> int | None:
    """A whole number from 0; None for anything else."""
    is_whole = isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= largest
    return value if is_whole and isinstance(value, int) else None


def _number(value: object) -> float:
    """NaN for what is no number, or one too large."""
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > LARGEST_WHOLE:
        return math.nan
    return float(value)
