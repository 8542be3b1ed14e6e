"""One row of a comparison: a tracker's figures, and what each stage took."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lookonce.cli.evaluated_runs import EvaluatedRun
from lookonce.cli.figures import Column, figures_of
from lookonce.evaluation import PRScores

__all__ = ["IN_DETECT", "CompareRow", "Speed", "cells", "headings", "notes"]

IN_DETECT = "in detect"
_ABSENT = "-"


@dataclass(frozen=True, slots=True)
class Speed:
    """Seconds of each stage for a frame; 0 = not measured, as detection in a published file.

    Attributes:
        detect_s: letterbox and inference, with descriptors where the model has them.
        describe_s: of a second network.
        associate_s: by the clock.
        associate_cpu_s: in processor time.
        is_one_look: whether the descriptors came with the detections.
        peak_mb: largest resident memory of the process that associated, its libraries and the detections included.
    """

    detect_s: float = 0.0
    describe_s: float = 0.0
    associate_s: float = 0.0
    associate_cpu_s: float = 0.0
    is_one_look: bool = False
    peak_mb: float = 0.0

    @property
    def total_s(self) -> float:
        """All stages, one after the other."""
        return self.detect_s + self.describe_s + self.associate_s


@dataclass(frozen=True, slots=True)
class CompareRow:
    """A tracker at one frame rate.

    Attributes:
        name: of the tracker, to choose it by.
        title: in tables.
        every: every so many-th frame.
        min_score: it was given detections from this score on.
        note: why it has no figures; "" = it has.
        run: its figures.
        speed: of its stages.
        threshold: of the detector, in a sweep over thresholds; None elsewhere.
        pr: its figures along the detector's curve.
    """

    name: str
    title: str
    every: int
    min_score: float
    note: str = ""
    run: EvaluatedRun | None = None
    speed: Speed | None = None
    threshold: float | None = None
    pr: PRScores | None = None


def headings(columns: Sequence[Column], *, has_pr: bool, has_every: bool) -> list[str]:
    """Of a table of rows."""
    parts = ["tracker", *(["every"] if has_every else []), "from score", *(["PR-MOTA"] if has_pr else [])]
    parts += [column.heading for column in columns]
    return [*parts, "detect fps", "describe fps", "associate fps", "all fps", "peak MB"]


def cells(row: CompareRow, columns: Sequence[Column], *, has_pr: bool, has_every: bool) -> list[str]:
    """The row as text, in the order of ``headings``; without figures it says why in ``notes``."""
    found = [row.title, *([str(row.every)] if has_every else [])]
    if row.run is None:
        rest = len(headings(columns, has_pr=has_pr, has_every=has_every)) - len(found)
        return found + [_ABSENT] * rest
    found.append(f"{row.min_score:g}")
    if has_pr:
        found.append(_ABSENT if row.pr is None else f"{100 * row.pr.mota:.1f}")
    figures = figures_of(row.run.combined)
    return found + [column.show(figures) for column in columns] + _speeds(row.speed)


def notes(rows: Sequence[CompareRow]) -> list[str]:
    """Which trackers have no figures, where, and why: a line each."""
    several = len({(row.every, row.threshold) for row in rows}) > 1
    found: dict[str, list[str]] = {}
    for row in rows:
        if row.note:
            where = f"every {row.every}" if row.threshold is None else f"threshold {row.threshold:.1f}"
            found.setdefault(f"{row.title}: {row.note}", []).append(where)
    return [f"{text} ({', '.join(where)})" if several and where else text for text, where in found.items()]


def _speeds(speed: Speed | None) -> list[str]:
    if speed is None:
        return [_ABSENT] * 5
    describe = IN_DETECT if speed.is_one_look else _fps(speed.describe_s)
    memory = f"{speed.peak_mb:.0f}" if speed.peak_mb else _ABSENT
    every = [speed.detect_s, speed.associate_s]
    return [_fps(speed.detect_s), describe, _fps(speed.associate_s), _fps(speed.total_s if all(every) else 0), memory]


def _fps(seconds: float) -> str:
    if not seconds:
        return _ABSENT
    rate = 1 / seconds
    return f"{rate:,.0f}" if rate >= 100 else f"{rate:.1f}"
