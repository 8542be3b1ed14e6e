"""Where a tracker may have gone wrong, as far as that can be told without truth."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import iou_of_pairs
from lookonce.evaluation import TrackingResult
from lookonce.report.explained import Candidate, ExplainedRow, Explanation
from lookonce.report.spans import Clock
from lookonce.report.switches import measured

__all__ = ["Doubt", "breaks_of", "doubts_of"]

_MOST_DOUBTS = 200
_APART_FRAMES = 25  # two doubts about the same two objects
_LONGEST_BREAK_S, _LONGEST_BREAK_FRAMES = 1.0, 25  # the second where nobody knows the time
_LEAST_OVERLAP = 0.3  # IoU of the last box and the first; less is as likely another object


@dataclass(frozen=True, slots=True)
class Doubt:
    """A decision that could well have been another one.

    Attributes:
        frame: of the decision.
        id: the identity that was given.
        other: the identity that it might have been.
        text: why it is doubtful.
        margin: lower is more doubtful.
        xyxy: (4,) float64, the detection's box; None = not stated.
        is_new: whether a new identity was begun.
    """

    frame: int
    id: int
    other: int
    text: str
    margin: float
    xyxy: NDArray[np.float64] | None
    is_new: bool


def doubts_of(explanation: Explanation) -> tuple[Doubt, ...]:
    """The most doubtful decisions: objects chosen with little ahead of the next, and new ones that might be old.

    By rising margin, at most 200, the same two objects only once in 25 frames. A new object counts where at least one
    old one was considered that no other detection got; its margin is that one's cost.
    """
    doubts = []
    for frame, rows in explanation.rows.items():
        given = {row.id for row in rows if row.id is not None}
        for row in rows:
            if row.id is not None and (doubt := _doubt(frame, row, row.id, given)) is not None:
                doubts.append(doubt)
    chosen: dict[frozenset[int], list[Doubt]] = {}
    for one in sorted(doubts, key=lambda one: (one.margin, one.frame, one.id)):
        alike = chosen.setdefault(frozenset((one.id, one.other)), [])
        if all(abs(one.frame - other.frame) >= _APART_FRAMES for other in alike):
            alike.append(one)
    kept = [one for alike in chosen.values() for one in alike]
    return tuple(sorted(kept, key=lambda one: (one.margin, one.frame, one.id))[:_MOST_DOUBTS])


def _doubt(frame: int, row: ExplainedRow, identity: int, given: Set[int]) -> Doubt | None:
    chosen = next((one for one in row.candidates if one.id == identity and not one.refused), None)
    others = [one for one in row.candidates if one.id != identity and one.cost is not None]
    is_new = row.decision in ("new", "confirmed") and chosen is None
    others = [one for one in others if (one.id not in given if is_new else not one.refused)]
    if not others or not (is_new or (chosen is not None and chosen.cost is not None)):
        return None
    nearest = min(others, key=lambda one: (_cost(one), one.id))
    ahead = 0.0 if is_new or chosen is None else _cost(chosen)
    box = None if row.xyxy is None else np.array(row.xyxy, np.float64)
    text = _sentence(row, identity, chosen, nearest)
    return Doubt(frame, identity, nearest.id, text, _cost(nearest) - ahead, box, is_new)


def _cost(one: Candidate) -> float:
    return float("inf") if one.cost is None else one.cost


def _sentence(row: ExplainedRow, identity: int, chosen: Candidate | None, other: Candidate) -> str:
    parts: Sequence[str] = (
        row.reason or row.decision,
        f"identity {identity}{measured(chosen)}" if chosen is not None else "",
        f"identity {other.id}{measured(other)}{f', refused: {other.refused}' if other.refused else ''}",
    )
    return "; ".join(filter(None, parts))


def breaks_of(result: TrackingResult, clock: Clock) -> tuple[Doubt, ...]:
    """Identities that begin where another one has just ended: perhaps one object. The largest overlaps; at most 200."""
    order = np.lexsort((result.row_frames, result.ids))
    if not len(order):
        return ()
    starts = np.flatnonzero(np.diff(result.ids[order], prepend=result.ids[order[0]] - 1))
    first, last = order[starts], order[np.append(starts[1:], len(order)) - 1]
    ended = last[np.argsort(result.row_frames[last], kind="stable")]
    end_frames = result.row_frames[ended]
    doubts = []
    for row in first.tolist():
        frame = int(result.row_frames[row])
        earliest = int(np.searchsorted(end_frames, frame - _LONGEST_BREAK_FRAMES))
        near = ended[earliest : np.searchsorted(end_frames, frame)]
        near = near[[_is_soon(clock, int(result.row_frames[one]), frame) for one in near.tolist()]]
        overlaps = iou_of_pairs(result.xyxy[near], np.repeat(result.xyxy[[row]], len(near), axis=0))
        if not len(near) or (most := float(overlaps.max())) < _LEAST_OVERLAP:
            continue
        before = int(near[overlaps.argmax()])
        gone = frame - int(result.row_frames[before])
        text = (
            f"Identity {result.ids[before]} was last seen {gone} frame{'s' if gone > 1 else ''} earlier in the same "
            f"place (overlap {most:.2f})."
        )
        doubts.append(
            Doubt(frame, int(result.ids[row]), int(result.ids[before]), text, 1 - most, result.xyxy[row], True)
        )
    return tuple(sorted(doubts, key=lambda one: (one.margin, one.frame, one.id))[:_MOST_DOUBTS])


def _is_soon(clock: Clock, before: int, frame: int) -> bool:
    earlier, now = clock.seconds(before), clock.seconds(frame)
    return earlier is None or now is None or now - earlier <= _LONGEST_BREAK_S
