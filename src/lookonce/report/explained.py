"""Why a tracker decided as it did: the file ``explain.jsonl`` of a run."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets.json_lines import Record, read_records
from lookonce.datasets.text import fault

__all__ = ["DECISIONS", "Candidate", "Ending", "ExplainedRow", "Explanation", "read_explanation"]

_FORMAT, _VERSION = "lookonce-explain", 1
_MOST_ROWS = 2_000_000
_SAME_BOX_PX = 0.1  # boxes are written with two decimals, as corners or as left and width

DECISIONS = {
    "kept": "goes on with an object of the frame before",
    "refound": "goes on with an object that was unseen for a while",
    "new": "begins an object",
    "waiting": "waits for more evidence before it gets an identity",
    "confirmed": "gets its identity after waiting",
    "duplicate": "is a second box of an object",
    "weak": "is too unsure to begin an object",
    "bad": "cannot be a box",
}
"""What a detection can be, in words."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """An object that was considered for a detection; None = the tracker does not say.

    Attributes:
        id: its identity.
        cost: lower is better.
        overlap: with where the object was expected, 0 to 1.
        distance: of the descriptors, 0 to 2.
        motion: how far it is from where the object was expected, in the tracker's own measure.
        unseen_s: for how long the object had not been seen.
        refused: which rule refused it; "" = none.
    """

    id: int
    cost: float | None = None
    overlap: float | None = None
    distance: float | None = None
    motion: float | None = None
    unseen_s: float | None = None
    refused: str = ""


@dataclass(frozen=True, slots=True)
class ExplainedRow:
    """What was decided for one detection.

    Attributes:
        id: the identity that it got; None = none.
        xyxy: its box in px, where stated.
        decision: usually one of ``DECISIONS``.
        reason: one sentence.
        candidates: the chosen one first.
    """

    id: int | None
    xyxy: tuple[float, float, float, float] | None
    decision: str
    reason: str
    candidates: tuple[Candidate, ...]


@dataclass(frozen=True, slots=True)
class Ending:
    """When an identity was given up, and why."""

    frame: int
    why: str


@dataclass(frozen=True, slots=True)
class Explanation:
    """All decisions of a run.

    Attributes:
        rows: frame -> what was decided for its detections.
        times_s: frame -> time.
        endings: identity -> when it was given up, in order.
        given_back: (frame, identity) -> earlier frames whose detections became its in that frame.
        begun: identity -> the first of these frames, and what was decided there.
        filled: (frame, identity) -> earlier frames in which it was missed, and which were filled in that frame.
    """

    rows: Mapping[int, tuple[ExplainedRow, ...]]
    times_s: Mapping[int, float] = field(default_factory=dict)
    endings: Mapping[int, tuple[Ending, ...]] = field(default_factory=dict)
    given_back: Mapping[tuple[int, int], tuple[int, ...]] = field(default_factory=dict)
    filled: Mapping[tuple[int, int], tuple[int, ...]] = field(default_factory=dict)
    begun: Mapping[int, tuple[int, ExplainedRow]] = field(default_factory=dict)

    def of(self, frame: int, identity: int) -> ExplainedRow | None:
        """The row of an identity in a frame."""
        return next((row for row in self.rows.get(frame, ()) if row.id == identity), None)

    def without_identity(self, frame: int, xyxy: NDArray[np.float64]) -> ExplainedRow | None:
        """The row of a detection, given by its box ``xyxy (4,)``, that had no identity when its frame was decided."""
        for row in self.rows.get(frame, ()):
            if row.id is None and row.xyxy is not None and np.abs(np.array(row.xyxy) - xyxy).max() < _SAME_BOX_PX:
                return row
        return None

    def ending(self, identity: int, first: int, last: int) -> Ending | None:
        """When the identity was given up between two frames, both included."""
        found = [one for one in self.endings.get(identity, ()) if first <= one.frame <= last]
        return found[-1] if found else None

    def counts(self) -> dict[str, int]:
        """Decision -> how often, known ones in their order first."""
        found = Counter(row.decision for rows in self.rows.values() for row in rows)
        order = [one for one in DECISIONS if one in found] + sorted(found.keys() - DECISIONS.keys())
        return {one: found[one] for one in order}


def read_explanation(path: Path) -> Explanation:
    """What a tracker explained.

    Raises:
        FormatError: it breaks its format.
    """
    _, records = read_records(path, _FORMAT, _VERSION)
    rows: dict[int, tuple[ExplainedRow, ...]] = {}
    times_s: dict[int, float] = {}
    endings: defaultdict[int, list[Ending]] = defaultdict(list)
    given_back: dict[tuple[int, int], tuple[int, ...]] = {}
    filled: dict[tuple[int, int], tuple[int, ...]] = {}
    begun: dict[int, tuple[int, ExplainedRow]] = {}
    total = 0
    for record in records:
        frame = record.frame()
        if frame in rows:
            raise fault(path, record.line, f"frame {frame} a second time; remove one of the two lines")
        rows[frame] = tuple(_row(one) for one in record.records("rows"))
        _note_beginnings(begun, record.records("given_back"), rows)
        for found, name in ((given_back, "given_back"), (filled, "filled")):
            of_identity = _earlier(record.records(name))
            found |= {(frame, identity): frames for identity, frames in of_identity.items()}
            total += sum(map(len, of_identity.values()))
        total += len(rows[frame]) + sum(len(row.candidates) for row in rows[frame])
        if total > _MOST_ROWS:
            raise fault(path, record.line, f"more than {_MOST_ROWS:,} rows and candidates; explain a part of the video")
        if (time_s := record.number("time_s")) is not None:
            times_s[frame] = time_s
        for one in record.records("ended"):
            if (identity := one.whole("id")) is not None:
                endings[identity].append(Ending(frame, one.text("why") or ""))
    ended = {identity: tuple(found) for identity, found in endings.items()}
    return Explanation(rows, times_s, ended, given_back, filled, begun)


def _note_beginnings(
    begun: dict[int, tuple[int, ExplainedRow]],
    given_back: Iterable[Record],
    rows: Mapping[int, tuple[ExplainedRow, ...]],
) -> None:
    """Changes identity -> its first frame and row, where rows given back are earlier."""
    for one in given_back:
        identity, row, frame = one.whole("id"), one.whole("row"), one.frame()
        if identity is None or row is None or row >= len(rows.get(frame, ())):
            continue
        if identity not in begun or frame < begun[identity][0]:
            begun[identity] = frame, rows[frame][row]


def _earlier(records: Iterable[Record]) -> dict[int, tuple[int, ...]]:
    """Identity -> frames, rising."""
    frames: defaultdict[int, set[int]] = defaultdict(set)
    for one in records:
        if (identity := one.whole("id")) is not None:
            frames[identity].add(one.frame())
    return {identity: tuple(sorted(found)) for identity, found in frames.items()}


def _row(record: Record) -> ExplainedRow:
    return ExplainedRow(
        record.whole("id"),
        record.box(),
        record.text("decision") or "not said",
        record.text("reason") or "",
        tuple(_candidate(one) for one in record.records("candidates") if one.whole("id") is not None),
    )


def _candidate(record: Record) -> Candidate:
    return Candidate(
        id=record.whole("id") or 0,
        cost=record.number("cost"),
        overlap=record.number("overlap"),
        distance=record.number("distance"),
        motion=record.number("motion"),
        unseen_s=record.number("unseen_s"),
        refused=record.text("refused") or "",
    )
