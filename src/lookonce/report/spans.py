"""Identities over time: the rows of the timelines."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation import TrackingResult, TrackingTruth
from lookonce.evaluation.tracking.following import Following

__all__ = ["COLOURS", "Clock", "Span", "Timeline", "TimelineRow", "identity_lanes", "object_rows"]

COLOURS = 8
"""So many colours are told apart, also by the colour-blind; identities next to each other never share one."""

MISSED = -1
_MOST_STEPS = 800  # drawn across the page; finer cannot be seen
_MOST_ROWS = 150
_MOST_IDENTITIES = 2500


@dataclass(frozen=True, slots=True)
class Clock:
    """When the frames of a sequence were.

    Attributes:
        times_s: frame -> seconds, where stated.
        rate: frames per second for the others; None = not known.
    """

    times_s: Mapping[int, float]
    rate: float | None = None

    def seconds(self, frame: int) -> float | None:
        """The frame's time; None where nobody knows."""
        if frame in self.times_s:
            return self.times_s[frame]
        return frame / self.rate if self.rate else None

    def show(self, frame: int) -> str:
        """For people.

        >>> Clock({}, 25.0).show(30), Clock({}).show(30)
        ('30 (1.20 s)', '30')
        """
        seconds = self.seconds(frame)
        return f"{frame:,}" if seconds is None else f"{frame:,} ({seconds:.2f} s)"


@dataclass(frozen=True, slots=True)
class Span:
    """Some steps in a row with the same identity, first and last included; -1 = missed."""

    first: int
    last: int
    id: int


@dataclass(frozen=True, slots=True)
class TimelineRow:
    """An object and the identities that it was given; or, without truth, identities that follow each other.

    Attributes:
        name: of the object; "" where the row is no object.
        label: its class, where known.
        boxes: true boxes that count.
        found: of them those that were found.
        identities: how many different ones it was given.
        spans: in the order of time; those with identity -1 say where it was missed.
    """

    name: str
    label: str
    boxes: int
    found: int
    identities: int
    spans: tuple[Span, ...]


@dataclass(frozen=True, slots=True)
class Timeline:
    """All rows of a sequence.

    Attributes:
        frames: (F,) int64, the frames, rising.
        step: how many of them are drawn as one.
        rows: in the order of their first frame.
        colours: identity -> 0 to ``COLOURS`` - 1.
        left_out: how many objects, or identities, are not drawn.
    """

    frames: NDArray[np.int64]
    step: int
    rows: tuple[TimelineRow, ...]
    colours: Mapping[int, int]
    left_out: int

    @property
    def steps(self) -> int:
        """How many steps the time has."""
        return max(1, -(-len(self.frames) // self.step))

    def first_frame(self, step: int) -> int:
        """The frame where a step begins."""
        return int(self.frames[min(step * self.step, len(self.frames) - 1)]) if len(self.frames) else 0

    def last_frame(self, step: int) -> int:
        """The frame where it ends."""
        return int(self.frames[min((step + 1) * self.step, len(self.frames)) - 1]) if len(self.frames) else 0


def object_rows(
    truth: TrackingTruth, result: TrackingResult, following: Following, names: Mapping[int, str]
) -> Timeline:
    """A row for each true object that takes part; of very many the longest.

    Args:
        truth: what is to be found.
        result: what was.
        following: who was matched with whom.
        names: class of each object, where known.
    """
    rows = following.truth_rows
    places = np.searchsorted(truth.frames, truth.row_frames[rows])
    tracks = np.where(following.partners >= 0, result.ids[following.partners], MISSED) if len(result) else None
    given = np.full(len(rows), MISSED) if tracks is None else tracks
    step = _step(len(truth.frames))
    objects, counts = np.unique(truth.ids[rows], return_counts=True)
    chosen = set(objects[np.argsort(-counts, kind="stable")][:_MOST_ROWS].tolist())
    found = []
    for one in sorted(chosen):
        mine = np.flatnonzero(truth.ids[rows] == one)
        mine = mine[np.argsort(places[mine], kind="stable")]
        hits = given[mine][given[mine] != MISSED]
        spans = _spans(places[mine], given[mine], step)
        found.append(
            TimelineRow(str(one), names.get(one, ""), len(mine), len(hits), len(np.unique(hits)), tuple(spans))
        )
    found.sort(key=lambda row: (row.spans[0].first, int(row.name)))
    colours = _colours([[span.id for span in row.spans if span.id != MISSED] for row in found])
    return Timeline(truth.frames, step, tuple(found), colours, len(objects) - len(found))


def identity_lanes(
    frames: NDArray[np.int64], result: TrackingResult, beside: Iterable[tuple[int, int]] = ()
) -> Timeline:
    """Where there is no truth: the identities in as few rows as show no two of them at once.

    Args:
        frames: (F,) int64, rising; frames of the result that are not among them are added.
        result: what was found.
        beside: identities that are shown beside each other elsewhere, so that they should differ in colour.
    """
    frames = np.union1d(frames, result.row_frames)
    places, step = np.searchsorted(frames, result.row_frames), _step(len(frames))
    ids, counts = np.unique(result.ids, return_counts=True)
    chosen = ids[np.argsort(-counts, kind="stable")][:_MOST_IDENTITIES]
    order = np.lexsort((places, result.ids))
    order = order[np.isin(result.ids[order], chosen)]
    parts = np.split(order, np.flatnonzero(np.diff(result.ids[order])) + 1) if len(order) else []
    lives = [_spans(places[part], result.ids[part], step) for part in parts]
    lanes: list[list[Span]] = []
    for life in sorted(lives, key=lambda spans: (spans[0].first, spans[0].id)):
        free = next((lane for lane in lanes if lane[-1].last < life[0].first - 1), None)
        if free is None:
            lanes.append(free := [])
        free.extend(life)
    rows = tuple(TimelineRow("", "", 0, 0, len({span.id for span in lane}), tuple(lane)) for lane in lanes)
    colours = _colours([*beside, *([span.id for span in lane] for lane in lanes)])
    return Timeline(frames, step, rows, colours, len(ids) - len(chosen))


def _step(frames: int) -> int:
    return max(1, math.ceil(frames / _MOST_STEPS))


def _spans(places: NDArray[np.int64], ids: NDArray[np.int64], step: int) -> list[Span]:
    """Runs of one identity, by rising place; of the boxes in a step the first that has an identity counts."""
    steps = places // step
    order = np.lexsort((places, ids == MISSED, steps))
    _, first = np.unique(steps[order], return_index=True)
    steps, ids = steps[order[first]], ids[order[first]]
    starts = np.flatnonzero((np.diff(ids, prepend=ids[0] - 1) != 0) | (np.diff(steps, prepend=-2) != 1))
    ends = np.append(starts[1:], len(ids)) - 1
    return [
        Span(first, last, one)
        for first, last, one in zip(steps[starts].tolist(), steps[ends].tolist(), ids[starts].tolist(), strict=True)
    ]


def _colours(rows: Iterable[Sequence[int]]) -> dict[int, int]:
    """A colour for each identity, such that those that follow each other in a row have different ones if possible."""
    neighbours: defaultdict[int, set[int]] = defaultdict(set)
    order: dict[int, None] = {}
    for row in rows:
        for place, one in enumerate(row):
            order[one] = None
            for other in row[max(0, place - 2) : place]:
                if other != one:
                    neighbours[one].add(other)
                    neighbours[other].add(one)
    colours: dict[int, int] = {}
    used: Counter[int] = Counter()
    for one in order:
        beside = Counter(colours[other] for other in neighbours[one] if other in colours)
        colours[one] = min(range(COLOURS), key=lambda colour: (beside[colour], used[colour], colour))
        used[colours[one]] += 1
    return colours
