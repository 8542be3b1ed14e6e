"""Why each detection got its identity: what a tracker says when it is asked to explain."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Candidate", "Ended", "FrameStory", "RowStory"]

DECISIONS = ("kept", "refound", "new", "waiting", "confirmed", "duplicate", "weak")
"""kept: seen in the frame before; refound: after a gap; new: a new object; waiting: of one that is not confirmed yet or
no longer believed; confirmed: now; duplicate: a second box of another row's object; weak: too low a score for a new
object."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """An object that a detection was held against.

    Attributes:
        id: its identity; None = not confirmed yet.
        gain: logarithm of the likelihood ratio, this object against any other; above 0 it may be taken. None: out of
            reach.
        overlap: IoU of the expected box and the detection, 0 to 1.
        deviation: distance from the expected place, in standard deviations.
        distance: of the descriptors, 0 to 2; None where one has none.
        unseen_s: since when it had not been seen, s.
        refused: in words, what spoke against it; empty if it was taken or only less likely.
    """

    id: int | None
    gain: float | None
    overlap: float
    deviation: float
    distance: float | None
    unseen_s: float
    refused: str


@dataclass(frozen=True, slots=True)
class RowStory:
    """One detection.

    Attributes:
        row: its place in the frame.
        decision: one of ``DECISIONS``.
        reason: a short sentence.
        candidates: the one taken first, then the others by gain.
    """

    row: int
    decision: str
    reason: str
    candidates: tuple[Candidate, ...]


@dataclass(frozen=True, slots=True)
class Ended:
    """An identity that is given up: its id, and why, in words."""

    id: int
    why: str


@dataclass(frozen=True, slots=True)
class FrameStory:
    """One frame: a story for each row, and the identities that end with it."""

    rows: tuple[RowStory, ...]
    ended: tuple[Ended, ...]
