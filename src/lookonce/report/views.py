"""What a page shows, as values: a run's view of each sequence, the scores, and what all of it rests on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation import PrecisionRecall, TrackingResult, TrackingTruth
from lookonce.evaluation.tracking.following import follow
from lookonce.report.described import Descriptors
from lookonce.report.doubts import Doubt, breaks_of, doubts_of
from lookonce.report.explained import Explanation
from lookonce.report.mistakes import SizeClass, by_size
from lookonce.report.pictures import Crop
from lookonce.report.run_lines import RunLines
from lookonce.report.spans import Clock, Timeline, identity_lanes, object_rows
from lookonce.report.switches import Switch, find_switches, reasons_of

__all__ = [
    "DrawnBox",
    "Moment",
    "Places",
    "Report",
    "ScoreColumn",
    "ScoreRow",
    "ScoreTable",
    "SequenceView",
    "Tile",
    "doubted_view",
    "scored_view",
]

_LENGTHS = (1, 2, 5, 10, 30, 100, 300)  # boxes of an identity: where each class of length begins
_MOST_LISTED = 1000  # moments of a sequence


@dataclass(frozen=True, slots=True)
class DrawnBox:
    """A box over a picture: the object itself (true), or what has an identity."""

    xyxy: tuple[float, float, float, float]
    id: int
    is_true: bool = False


@dataclass(frozen=True, slots=True)
class Tile:
    """A picture of an object in a frame, and the boxes around."""

    frame: int
    crop: Crop
    boxes: tuple[DrawnBox, ...]


@dataclass(frozen=True, slots=True)
class Moment:
    """Something worth looking at: an object before and after.

    Attributes:
        title: in a few words.
        frame_before: where to look first.
        frame: and then.
        old_id: identity before.
        new_id: identity after.
        xyxy_before: (4,) float64; None = not known.
        xyxy: (4,) float64; None = not known.
        said: further sentences.
        switch: the counted switch behind it; None = it is only a doubt.
        tiles: pictures, before and after; empty = none.
    """

    title: str
    frame_before: int
    frame: int
    old_id: int
    new_id: int
    xyxy_before: NDArray[np.float64] | None
    xyxy: NDArray[np.float64] | None
    said: tuple[str, ...] = ()
    switch: Switch | None = None
    tiles: tuple[Tile, ...] = ()


@dataclass(frozen=True, slots=True)
class Places:
    """Where in the picture boxes were missed and wrong.

    Attributes:
        missed: (N, 4) float64, boxes.
        wrong: (M, 4) float64, boxes.
        size: (height, width) of the picture in px, or of what holds all boxes.
        backdrop: a frame; "" = none.
    """

    missed: NDArray[np.float64]
    wrong: NDArray[np.float64]
    size: tuple[int, int]
    backdrop: str = ""


@dataclass(frozen=True, slots=True)
class SequenceView:
    """What a run did in one sequence.

    Attributes:
        run: its name.
        sequence: its name.
        clock: when its frames were.
        result: the boxes with identity that were looked at.
        truth: None = there is none.
        timeline: identities over time.
        moments: switches; without truth, doubts; by frame.
        unlisted: how many more there are.
        kinds: kind of switch -> how many.
        sizes: misses and false boxes by size; empty without truth.
        places: the same by place; None without truth.
        lengths: class of length -> how many identities.
        decisions: what the tracker decided -> how often; empty = the run is not explained.
        size: (height, width) of the picture as the run says; None = it does not.
        notes: what else is to be said.
    """

    run: str
    sequence: str
    clock: Clock
    result: TrackingResult
    truth: TrackingTruth | None
    timeline: Timeline
    moments: tuple[Moment, ...] = ()
    unlisted: int = 0
    kinds: Mapping[str, int] = field(default_factory=dict)
    sizes: tuple[SizeClass, ...] = ()
    places: Places | None = None
    lengths: Mapping[str, int] = field(default_factory=dict)
    decisions: Mapping[str, int] = field(default_factory=dict)
    size: tuple[int, int] | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ScoreColumn:
    """A figure: its heading, what it means, and whether more of it is better (None = neither)."""

    heading: str
    meaning: str
    is_more_better: bool | None


@dataclass(frozen=True, slots=True)
class ScoreRow:
    """The figures of a run for a sequence, "" = all of them: as shown, and as numbers."""

    sequence: str
    run: str
    shown: tuple[str, ...]
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ScoreTable:
    """All figures and the rules that they follow.

    Attributes:
        rules: the protocol and what was chosen, in words.
        columns: of the table.
        rows: by sequence, then by run; those over all sequences last.
        left_out: run, why, number of boxes.
        notes: what else is to be said of the figures.
    """

    rules: str
    columns: tuple[ScoreColumn, ...]
    rows: tuple[ScoreRow, ...]
    left_out: tuple[tuple[str, str, int], ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """A whole page.

    Attributes:
        title: what is judged.
        version: of the package.
        truth: the truth file or folder as its user named it; "" = none.
        runs: run -> what its files say about how it was made.
        sources: what -> SHA-256 of the files that were read.
        scores: None without truth.
        views: by sequence, then by run.
        curves: run -> precision and recall of its detections.
        descriptors: None = no model was given.
        notes: what else is to be said.
    """

    title: str
    version: str
    truth: str
    runs: Mapping[str, Mapping[str, str]]
    sources: Mapping[str, str]
    scores: ScoreTable | None
    views: tuple[SequenceView, ...]
    curves: Mapping[str, PrecisionRecall]
    descriptors: Descriptors | None
    notes: tuple[str, ...]


def scored_view(
    run: str,
    sequence: str,
    clock: Clock,
    truth: TrackingTruth,
    result: TrackingResult,
    *,
    protocol: str,
    classes: tuple[str, ...],
    lines: RunLines,
    explanation: Explanation | None,
) -> SequenceView:
    """The view where there is truth.

    Args:
        run: its name.
        sequence: its name.
        clock: when its frames were.
        truth: as it was scored.
        result: as it was scored.
        protocol: by which it was.
        classes: of the truth, by label.
        lines: all detections of the run.
        explanation: where the run has one.
    """
    following = follow(truth, result, protocol)
    names = {}
    if len(classes) > 1:  # one class needs no name
        names = {one: classes[label] for one, label in zip(truth.ids.tolist(), truth.labels.tolist(), strict=True)}
    switches = find_switches(truth, result, following)
    moments = [_moment(one, names.get(one.object, ""), explanation) for one in switches]
    missed, wrong = truth.xyxy[following.missed], result.xyxy[following.wrong]
    extent = lines.size or _extent(truth.xyxy, result.xyxy)
    objects = len(np.unique(truth.ids[following.truth_rows]))
    notes = [f"{len(truth.frames):,} frames", f"{objects:,} true objects", _identities(result)]
    notes += _without_identity(lines)
    kinds: dict[str, int] = {}
    for one in switches:
        kinds[one.kind] = kinds.get(one.kind, 0) + 1
    return SequenceView(
        run,
        sequence,
        clock,
        result,
        truth,
        object_rows(truth, result, following, names),
        tuple(moments[:_MOST_LISTED]),
        max(0, len(moments) - _MOST_LISTED),
        kinds,
        by_size(truth, result, following),
        Places(missed, wrong, extent),
        _lengths(result),
        {} if explanation is None else explanation.counts(),
        lines.size,
        tuple(notes),
    )


def doubted_view(
    run: str,
    sequence: str,
    clock: Clock,
    result: TrackingResult,
    lines: RunLines,
    explanation: Explanation | None,
) -> SequenceView:
    """The view where there is no truth: identities, and where the tracker may be wrong."""
    doubts = breaks_of(result, clock) if explanation is None else doubts_of(explanation)
    moments = [_doubtful(one, result) for one in doubts]
    notes = [f"{len(lines.frames):,} frames", f"{_identities(result)} with {len(result):,} boxes"]
    notes += _without_identity(lines)
    return SequenceView(
        run,
        sequence,
        clock,
        result,
        None,
        identity_lanes(lines.frames, result, [(one.old_id, one.new_id) for one in moments]),
        tuple(sorted(moments, key=lambda one: (one.frame, one.new_id))),
        lengths=_lengths(result),
        decisions={} if explanation is None else explanation.counts(),
        size=lines.size,
        notes=tuple(notes),
    )


def _moment(switch: Switch, name: str, explanation: Explanation | None) -> Moment:
    who = f"object {switch.object}{f' ({name})' if name else ''}"
    return Moment(
        who,
        switch.frame_before,
        switch.frame,
        switch.old_id,
        switch.new_id,
        switch.xyxy_before,
        switch.xyxy,
        () if explanation is None else reasons_of(switch, explanation),
        switch,
    )


def _doubtful(doubt: Doubt, result: TrackingResult) -> Moment:
    """The doubt, beside the last box of the object that was nearly taken."""
    earlier = np.flatnonzero((result.ids == doubt.other) & (result.row_frames < doubt.frame))
    row = int(earlier[result.row_frames[earlier].argmax()]) if len(earlier) else -1
    title = "a new object, or still the old one?" if doubt.is_new else "one object or the other?"
    return Moment(
        title,
        int(result.row_frames[row]) if row >= 0 else doubt.frame,
        doubt.frame,
        doubt.other,
        doubt.id,
        result.xyxy[row] if row >= 0 else None,
        doubt.xyxy,
        (doubt.text,),
    )


def _identities(result: TrackingResult) -> str:
    count = len(np.unique(result.ids))
    return f"{count:,} identit{'y' if count == 1 else 'ies'}"


def _without_identity(lines: RunLines) -> list[str]:
    count = int((lines.ids < 0).sum()) - lines.given_back
    return [f"{count:,} detections without identity"] if count > 0 else []


def _extent(*boxes: NDArray[np.float64]) -> tuple[int, int]:
    """(height, width) of what holds all boxes."""
    every = np.concatenate([np.ones((1, 4)), *boxes])
    return max(1, round(float(every[:, 3].max()))), max(1, round(float(every[:, 2].max())))


def _lengths(result: TrackingResult) -> dict[str, int]:
    """How many identities have so many boxes."""
    _, counts = np.unique(result.ids, return_counts=True)
    found = {}
    for first, end in zip(_LENGTHS, (*_LENGTHS[1:], 0), strict=True):
        name = f"{first} and more" if not end else str(first) if end == first + 1 else f"{first} to {end - 1}"
        found[name] = int(((counts >= first) & ((counts < end) | (end == 0))).sum())
    return found
