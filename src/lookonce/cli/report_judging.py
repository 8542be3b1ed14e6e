"""Runs held against the truth, or looked at by themselves: everything that a report says, but for its pictures."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lookonce.cli.evaluated_results import ResultFile, SequenceResult, digest
from lookonce.cli.evaluated_runs import ClassChoice, EvaluatedRun, choose_classes, evaluate_run
from lookonce.cli.evaluated_truth import TrueSequence, open_truth
from lookonce.cli.report_inputs import (
    RunSequence,
    chosen_detections,
    chosen_rows,
    files_of_runs,
    files_without_truth,
    read_sequence,
)
from lookonce.cli.report_scores import score_table
from lookonce.cli.stages import StageScreen
from lookonce.datasets import read_class_names
from lookonce.errors import ConfigError
from lookonce.evaluation import PrecisionRecall
from lookonce.report import ScoreTable, SequenceView, doubted_view, scored_view
from lookonce.report.curves import Detected, detection_curve
from lookonce.report.pictures import find_source
from lookonce.report.spans import Clock
from lookonce.video.images import natural_order
from lookonce.video.opening import one_line

__all__ = ["Judged", "ReportSettings", "judge"]


@dataclass(frozen=True, slots=True)
class ReportSettings:
    """What is judged, and how."""

    runs: tuple[str, ...]
    truth: Path | None
    frames: Path | None
    protocol: str
    benchmark: str
    classes: tuple[str, ...]
    class_names: Path | None
    missing_as_empty: bool
    max_switches: int
    has_pictures: bool

    @property
    def rules(self) -> str:
        """In words."""
        parts = [f"Protocol {self.protocol}", f"rules of {self.benchmark}" if self.benchmark else ""]
        return ", ".join([*filter(None, parts), *([f"only {', '.join(self.classes)}"] if self.classes else [])])


@dataclass(frozen=True, slots=True)
class Judged:
    """What was found out before there are pictures.

    Attributes:
        views: by sequence, then by run.
        scores: None without truth.
        curves: run -> precision and recall of its detections, where they have scores.
        pictures: sequence -> where its pictures are; only those that are there.
        facts: run -> how it was made, as far as it says.
        sources: file -> SHA-256.
        notes: what else is to be said.
    """

    views: tuple[SequenceView, ...]
    scores: ScoreTable | None
    curves: Mapping[str, PrecisionRecall]
    pictures: Mapping[str, Path]
    facts: Mapping[str, Mapping[str, str]]
    sources: Mapping[str, str]
    notes: tuple[str, ...] = ()


def judge(settings: ReportSettings, screen: StageScreen) -> Judged:
    """All runs, with truth or without.

    Raises:
        LookonceError: truth or results are not found, do not fit each other, or break their format.
    """
    return _without_truth(settings, screen) if settings.truth is None else _with_truth(settings, settings.truth, screen)


def _with_truth(settings: ReportSettings, path: Path, screen: StageScreen) -> Judged:
    truth = open_truth(path, frames=settings.frames, protocol=settings.protocol, benchmark=settings.benchmark)
    numbered = read_class_names(settings.class_names) if settings.class_names else ()
    choice = choose_classes(truth, settings.classes, is_apart=False, numbered=numbered)
    names = [one.name for one in truth]
    files = files_of_runs(settings.runs, names, may_miss=settings.missing_as_empty, with_classes=bool(settings.classes))
    evaluated: list[EvaluatedRun] = []
    views: list[SequenceView] = []
    curves: dict[str, PrecisionRecall] = {}
    every = {run: _read(run, by_sequence, names, screen) for run, by_sequence in files.items()}
    for run, read in every.items():
        done, mine, curve = _judge_run(settings, run, truth, read, files[run], choice, screen)
        evaluated.append(done)
        views += mine
        if curve is not None:
            curves[run] = curve
    views.sort(key=lambda view: names.index(view.sequence))  # stable: runs stay in their order
    sources = {one_line(one.file): digest([one.file]) for one in truth}
    notes = []
    if without := [run for run in every if run not in curves]:
        notes.append(f"No precision-recall curve for {', '.join(without)}: the scores or classes are not told.")
    return Judged(
        tuple(views),
        score_table(evaluated, truth, settings.rules, settings.protocol),
        curves,
        _pictures({one.name: one.pictures for one in truth}, every),
        _facts(every),
        sources | _sources(every),
        tuple(notes),
    )


def _without_truth(settings: ReportSettings, screen: StageScreen) -> Judged:
    files = files_without_truth(settings.runs)
    names = [str(name) for name in natural_order({Path(name) for found in files.values() for name in found})]
    if settings.frames is not None and len(names) > 1:
        raise ConfigError(f"--frames fits one sequence only, and the runs have {len(names)}; name one")
    if settings.frames is not None and not os.path.exists(settings.frames):
        raise ConfigError(f"{one_line(settings.frames)}: no such folder or video; check --frames")
    every = {run: _read(run, found, [one for one in names if one in found], screen) for run, found in files.items()}
    views = []
    for name in names:
        for run, read in every.items():
            if name in read:
                one = read[name]
                clock = Clock(one.lines.times_s)
                views.append(doubted_view(run, name, clock, one.found.result, one.lines, one.explanation))
    given = {} if settings.frames is None else {names[0]: settings.frames}
    return Judged(tuple(views), None, {}, _pictures(given, every), _facts(every), _sources(every))


def _read(
    run: str, files: Mapping[str, ResultFile], names: Sequence[str], screen: StageScreen
) -> dict[str, RunSequence]:
    read = {}
    for done, name in enumerate(names, 1):
        read[name] = read_sequence(files.get(name))
        screen.stage(f"read {one_line(run)}", done, len(names), "results")
    return read


def _judge_run(
    settings: ReportSettings,
    run: str,
    truth: Sequence[TrueSequence],
    read: Mapping[str, RunSequence],
    files: Mapping[str, ResultFile],
    choice: ClassChoice,
    screen: StageScreen,
) -> tuple[EvaluatedRun, list[SequenceView], PrecisionRecall | None]:
    """Scores, views and curve of one run: all from the very same choice of rows."""
    unknown: Counter[str] = Counter()
    shown = {one.name: files[one.name].shown if one.name in files else run for one in truth}
    chosen = {one.name: chosen_rows(one, read[one.name].found, choice, shown[one.name], unknown) for one in truth}
    if not settings.missing_as_empty and not any(len(one.found.result) for one in read.values()):
        remedy = "check that tracking found anything, or give --missing-as-empty"
        raise ConfigError(f"{one_line(run)}: the results hold no box; {remedy}")

    def result(sequence: TrueSequence) -> SequenceResult:
        return chosen[sequence.name][1]

    def report(done: int) -> None:
        screen.stage(f"judge {one_line(run)}", done, len(truth), "sequences")

    scored = [chosen[one.name][0] for one in truth]
    evaluated = evaluate_run(run, scored, result, files, settings.protocol, ClassChoice(), report)
    evaluated = replace(evaluated, unknown_classes=dict(sorted(unknown.items())))
    views = [
        scored_view(
            run,
            one.name,
            Clock(read[one.name].lines.times_s, one.fps),
            one.truth,
            result(one).result,
            protocol=settings.protocol,
            classes=one.classes,
            lines=read[one.name].lines,
            explanation=read[one.name].explanation,
        )
        for one in scored
    ]
    return evaluated, views, _curve(settings, scored, read)


def _curve(
    settings: ReportSettings, truth: Sequence[TrueSequence], read: Mapping[str, RunSequence]
) -> PrecisionRecall | None:
    """Of all detections of a run; None where they have no scores to sort them by, or no known classes."""
    parts, scores = [], set()
    for one in truth:
        lines = read[one.name].lines
        is_chosen = chosen_detections(lines, settings.classes)
        if is_chosen is None:
            return None
        parts.append(Detected(one.truth, lines, is_chosen))
        scores |= set(lines.scores[:1000].tolist())
    return detection_curve(parts, settings.protocol) if len(scores) > 1 else None


def _pictures(given: Mapping[str, Path], every: Mapping[str, Mapping[str, RunSequence]]) -> dict[str, Path]:
    """Where the pictures of each sequence are: where the truth says, else where a run had them from."""
    candidates: dict[str, list[str | Path]] = {name: [path] for name, path in given.items()}
    for read in every.values():
        for name, one in read.items():
            candidates.setdefault(name, []).append(one.lines.source)
    found = {name: find_source(*paths) for name, paths in candidates.items()}
    return {name: path for name, path in found.items() if path is not None}


def _facts(every: Mapping[str, Mapping[str, RunSequence]]) -> dict[str, Mapping[str, str]]:
    """How each run was made: what its first sequence says that the others do not contradict."""
    facts: dict[str, Mapping[str, str]] = {}
    for run, read in every.items():
        told = [one.lines.facts for one in read.values() if one.lines.facts]
        first = told[0] if told else {}
        facts[run] = {what: value for what, value in first.items() if all(one.get(what) == value for one in told)}
    return facts


def _sources(every: Mapping[str, Mapping[str, RunSequence]]) -> dict[str, str]:
    return {one_line(path): digest([path]) for read in every.values() for one in read.values() for path in one.files}
