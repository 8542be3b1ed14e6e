"""Every identity switch that the figures count: when, from which identity to which, and what that means."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation import TrackingResult, TrackingTruth
from lookonce.evaluation.tracking.following import Following
from lookonce.report.explained import Candidate, Explanation

__all__ = ["KINDS", "Switch", "find_switches", "measured", "reasons_of"]

KINDS = {
    "new": "a new identity began",
    "back": "an earlier identity of the object came back",
    "taken": "the identity of another object",
    "swapped": "two objects changed their identities",
    "stray": "an identity that had been on a false box",
}
"""Where the identity after a switch came from."""


@dataclass(frozen=True, slots=True)
class Switch:
    """An object whose match has another identity than its last match.

    Attributes:
        object: its number in the truth.
        frame_before: of its last match with the old identity.
        frame: of the first match with the new one.
        old_id: identity before.
        new_id: identity after.
        kind: one of ``KINDS``.
        other: the object that the new identity was on before; None = none.
        missed: in how many frames between the two the object was there and not found.
        absent: in how many frames between the two truth does not have it.
        xyxy_before: (4,) float64, its true box before.
        xyxy: (4,) float64, its true box after.
        xyxy_found: (4,) float64, the box of the result that is matched with it.
    """

    object: int
    frame_before: int
    frame: int
    old_id: int
    new_id: int
    kind: str
    other: int | None
    missed: int
    absent: int
    xyxy_before: NDArray[np.float64]
    xyxy: NDArray[np.float64]
    xyxy_found: NDArray[np.float64]


def find_switches(truth: TrackingTruth, result: TrackingResult, following: Following) -> tuple[Switch, ...]:
    """All of them, by frame; as many as the figures count."""
    rows, partners = following.truth_rows, following.partners
    earlier = _earlier_matches(truth, result, following)
    lives, first_frame = _lives(truth, result, following), _first_frames(result)
    switches = []
    for old, new in following.switches.tolist():
        frame_before, frame = (int(truth.row_frames[rows[place]]) for place in (old, new))
        old_id, new_id = (int(result.ids[partners[place]]) for place in (old, new))
        who = int(truth.ids[rows[new]])
        other = int(truth.ids[rows[earlier[new]]]) if earlier[new] >= 0 else None
        kind = "back" if other == who else "taken"
        if other is None:
            kind = "new" if first_frame[new_id] == frame else "stray"
        elif other != who and lives[other].identity(frame) == old_id:
            kind = "swapped"
        missed = lives[who].rows_between(frame_before, frame)
        total = int(np.searchsorted(truth.frames, frame) - np.searchsorted(truth.frames, frame_before, side="right"))
        switches.append(
            Switch(
                object=who,
                frame_before=frame_before,
                frame=frame,
                old_id=old_id,
                new_id=new_id,
                kind=kind,
                other=None if other == who else other,
                missed=missed,
                absent=total - missed,
                xyxy_before=truth.xyxy[rows[old]],
                xyxy=truth.xyxy[rows[new]],
                xyxy_found=result.xyxy[partners[new]],
            )
        )
    return tuple(switches)


@dataclass(frozen=True, slots=True)
class _Life:
    """The frames in which an object is there, rising, and the identity that it has in each; -1 = missed."""

    frames: NDArray[np.int64]
    ids: NDArray[np.int64]

    def identity(self, frame: int) -> int:
        place = int(np.searchsorted(self.frames, frame))
        return int(self.ids[place]) if place < len(self.frames) and self.frames[place] == frame else -1

    def rows_between(self, first: int, last: int) -> int:
        return int(np.searchsorted(self.frames, last) - np.searchsorted(self.frames, first, side="right"))


def _lives(truth: TrackingTruth, result: TrackingResult, following: Following) -> dict[int, _Life]:
    rows, partners = following.truth_rows, following.partners
    ids = np.full(len(rows), -1, np.int64)
    ids[partners >= 0] = result.ids[partners[partners >= 0]]
    order = np.lexsort((truth.row_frames[rows], truth.ids[rows]))
    objects, starts = np.unique(truth.ids[rows][order], return_index=True)
    parts = np.split(order, starts[1:])
    return {
        one: _Life(truth.row_frames[rows[part]], ids[part]) for one, part in zip(objects.tolist(), parts, strict=False)
    }


def _earlier_matches(truth: TrackingTruth, result: TrackingResult, following: Following) -> NDArray[np.int64]:
    """(T,) int64: for each match the place of the one before with the same identity, on whatever object; -1 = none."""
    found = np.flatnonzero(following.partners >= 0)
    before = _previous_of_identity(result.ids[following.partners[found]], truth.row_frames[following.truth_rows[found]])
    earlier = np.full(len(following.partners), -1, np.int64)
    earlier[found[before >= 0]] = found[before[before >= 0]]
    return earlier


def _first_frames(result: TrackingResult) -> dict[int, int]:
    """Identity -> the frame of its first box."""
    order = np.lexsort((result.row_frames, result.ids))
    ids, first = np.unique(result.ids[order], return_index=True)
    return dict(zip(ids.tolist(), result.row_frames[order][first].tolist(), strict=True))


def _previous_of_identity(ids: NDArray[np.int64], frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) int64: of N matches the one before with the same identity, -1 = none."""
    order = np.lexsort((frames, ids))
    previous = np.full(len(ids), -1, np.int64)
    same = ids[order][1:] == ids[order][:-1]
    previous[order[1:][same]] = order[:-1][same]
    return previous


def reasons_of(switch: Switch, explanation: Explanation) -> tuple[str, ...]:
    """What the tracker itself says about a switch, a sentence each."""
    said = []
    row = explanation.of(switch.frame, switch.new_id)
    later = explanation.without_identity(switch.frame, switch.xyxy_found) if row is None else None
    if (told := row or later) is not None:
        said.append(f"{told.decision}: {told.reason}" if told.reason else told.decision)
        if later is not None:
            said.append(f"It got identity {switch.new_id} only later.")
        old = next((one for one in told.candidates if one.id == switch.old_id), None)
        chosen = next((one for one in told.candidates if one.id == switch.new_id), None)
        if chosen is not None and not told.reason:
            said.append(f"Identity {switch.new_id} was chosen{measured(chosen)}.")
        if old is not None:
            why = f" and refused: {old.refused}" if old.refused else " and not chosen"
            said.append(f"Identity {switch.old_id} was considered{measured(old)}{why}.")
        else:
            said.append(f"Identity {switch.old_id} was not considered for it.")
    ending = explanation.ending(switch.old_id, switch.frame_before, switch.frame)
    if ending is not None:
        said.append(f"Identity {switch.old_id} had ended at frame {ending.frame}: {ending.why or 'no reason given'}.")
    return tuple(said)


def measured(one: Candidate) -> str:
    """What was measured for a candidate, in brackets; "" for nothing."""
    named = (
        ("cost", one.cost, ""),
        ("overlap", one.overlap, ""),
        ("descriptor distance", one.distance, ""),
        ("motion", one.motion, ""),
        ("unseen", one.unseen_s or None, " s"),
    )
    parts = [f"{name} {value:.3g}{unit}" for name, value, unit in named if value is not None]
    return f" ({', '.join(parts)})" if parts else ""
