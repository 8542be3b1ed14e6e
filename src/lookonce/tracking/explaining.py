"""The decisions of one frame in words; costs time, so only on request."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.stories import Candidate, Ended, FrameStory, RowStory
from lookonce.structures import NO_ID
from lookonce.tracking.candidates import LARGEST_DEVIATION, Frame, Pairs
from lookonce.tracking.default_config import DefaultConfig

__all__ = ["Notes", "tell"]

_MOST_CANDIDATES = 8  # of a row
_SURE = 0.9  # share of the own object from which nothing is said


@dataclass(frozen=True, slots=True)
class Notes:
    """What was known when the frame's rows had been matched and nothing else had changed.

    Attributes:
        frame, pairs: of the matching.
        distances: (K,) float64, of the descriptors; infinite where one has none, NaN without appearance.
        gains: (K,) float64, of the pairs, with appearance.
        ids: (P,) int64, of the objects before the frame.
        unseen_s: (P,) float64, since when each had not been seen.
        was_seen: (P,) bool, in the frame before.
        is_recent: (P,) bool, then or lately.
    """

    frame: Frame
    pairs: Pairs
    distances: NDArray[np.float64]
    gains: NDArray[np.float64]
    ids: NDArray[np.int64]
    unseen_s: NDArray[np.float64]
    was_seen: NDArray[np.bool_]
    is_recent: NDArray[np.bool_]


def tell(
    notes: Notes, ids: NDArray[np.int64], new: NDArray[np.intp], ended: tuple[Ended, ...], config: DefaultConfig
) -> FrameStory:
    """The story of a frame.

    Args:
        notes: taken between matching and everything else.
        ids: (N,) the answer for the rows.
        new: (B,) rows that became new objects.
        ended: identities that ended.
        config: the settings.
    """
    begun = set(new.tolist())
    order = np.argsort(notes.pairs.rows, kind="stable")
    begins = np.searchsorted(notes.pairs.rows[order], np.arange(len(ids) + 1))
    rows = [
        _row(notes, row, order[begins[row] : begins[row + 1]], int(ids[row]), row in begun, config)
        for row in range(len(ids))
    ]
    return FrameStory(tuple(rows), ended)


def _row(
    notes: Notes, row: int, pairs: NDArray[np.intp], identity: int, is_new: bool, config: DefaultConfig
) -> RowStory:
    taken = int(notes.frame.object_of[row])
    by_gain = sorted(
        pairs.tolist(),
        key=lambda pair: (notes.pairs.objects[pair] != taken, -notes.gains[pair], notes.pairs.objects[pair]),
    )
    candidates = tuple(_candidate(notes, pair, taken, config) for pair in by_gain[:_MOST_CANDIDATES])
    decision, reason = _decision(notes, row, taken, identity, is_new, config)
    if taken >= 0 and notes.frame.is_alone[row]:
        reason = f"{reason}: far from where it was expected, but nobody else is near"
    elif taken >= 0:
        reason = f"{reason}: {_why(candidates, notes.gains[by_gain[0]], config)}"
        shares = notes.frame.shares
        if shares is not None and shares[row] < _SURE:
            reason += f", by its place only {shares[row]:.0%} sure, so it moves the object less"
        if notes.pairs.is_jump[by_gain[0]]:
            reason += ", at another speed than was believed"
        if notes.frame.jolt is not None:
            x, y = notes.frame.jolt.tolist()
            reason += f", after the whole picture has jumped by {x:.0f}, {y:.0f} px"
    return RowStory(row, decision, reason, candidates)


def _decision(
    notes: Notes, row: int, taken: int, identity: int, is_new: bool, config: DefaultConfig
) -> tuple[str, str]:
    score = float(notes.frame.scores[row])
    if taken >= 0:
        unseen_s = float(notes.unseen_s[taken])
        if identity == NO_ID and notes.ids[taken] == NO_ID:
            return "waiting", "continues an object that is not confirmed yet"
        if identity == NO_ID:
            return "waiting", f"continues id {notes.ids[taken]}, which is not believed any more: its scores have fallen"
        if notes.ids[taken] == NO_ID:
            return "confirmed", f"the object is confirmed and gets id {identity}"
        if not notes.was_seen[taken]:
            return "refound", f"id {identity} again after {unseen_s:.2f} s"
        return "kept", f"id {identity} as in the frame before"
    if is_new:
        return "new", "no known object fits; a new one, to be confirmed"
    if score < config.low_score:
        return "weak", f"score {score:.2f} is below {config.low_score:g}"
    if not notes.frame.is_usable[row]:
        return "duplicate", f"overlaps a detection of higher score by more than {config.same_overlap:g}"
    if score < config.birth_score:
        return "weak", f"score {score:.2f} is below {config.birth_score:g}, too low for a new object"
    return "duplicate", f"overlaps a known or new object by more than {config.duplicate_overlap:g}"


def _why(candidates: tuple[Candidate, ...], gain: float, config: DefaultConfig) -> str:
    """What spoke for the first candidate, and who was next."""
    first = candidates[0]
    parts = [f"overlap {first.overlap:.2f}"]
    if first.overlap < config.safe_overlap:
        parts = [f"{first.deviation:.1f} standard deviations from where it was expected", *parts]
    if first.distance is not None:
        parts.append(f"look {first.distance:.2f} apart")
    others = [one for one in candidates[1:] if not one.refused and one.id is not None]  # waiting ones come later
    if others and others[0].gain is not None:
        lead = gain - others[0].gain
        of = f"id {others[0].id}"
        parts.append(
            f"ahead of {of} by {lead:.1f}" if lead >= 0 else f"{-lead:.1f} behind {of}, but best for the frame"
        )
    return ", ".join(parts)


def _candidate(notes: Notes, pair: int, taken: int, config: DefaultConfig) -> Candidate:
    pairs, place = notes.pairs, int(notes.pairs.objects[pair])
    gain, distance = float(notes.gains[pair]), float(notes.distances[pair])
    return Candidate(
        id=int(notes.ids[place]) if notes.ids[place] != NO_ID else None,
        gain=gain if math.isfinite(gain) else None,
        overlap=float(pairs.overlap[pair]),
        deviation=float(pairs.deviation[pair]),
        distance=distance if math.isfinite(distance) else None,
        unseen_s=float(notes.unseen_s[place]),
        refused="" if place == taken else _refused(notes, pair, config),
    )


def _refused(notes: Notes, pair: int, config: DefaultConfig) -> str:
    """Which gate the pair did not pass; empty if it passed all and another was likelier."""
    pairs, frame = notes.pairs, notes.frame
    row, place = int(pairs.rows[pair]), int(pairs.objects[pair])
    if not frame.is_high[row] and pairs.overlap[pair] < config.low_overlap:
        return f"a score of {frame.scores[row]:.2f} has to overlap by {config.low_overlap:g}"
    if not frame.is_high[row] and notes.ids[place] != NO_ID and not notes.is_recent[place]:
        return f"a score of {frame.scores[row]:.2f} is too weak for whom nobody has seen for {config.recent_s:g} s"
    if pairs.deviation[pair] > LARGEST_DEVIATION:
        return f"more than {LARGEST_DEVIATION:g} standard deviations from where it was expected"
    if notes.gains[pair] <= 0:
        likeness = config.match_threshold - notes.distances[pair]
        return "looks different" if math.isfinite(likeness) and likeness < 0 else "place and size make it unlikely"
    others = np.flatnonzero(frame.object_of == place)
    return f"taken by row {int(others[0])}" if len(others) else ""
