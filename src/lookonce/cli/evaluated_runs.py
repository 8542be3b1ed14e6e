"""Truth and results brought together: the figures of a run by sequence, combined, and by class."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lookonce.cli.evaluated_results import ResultFile, SequenceResult
from lookonce.cli.evaluated_truth import TrueSequence
from lookonce.cli.figures import Scores
from lookonce.datasets import read_class_names, usual_name
from lookonce.datasets.track_rows import NO_CLASS
from lookonce.errors import ConfigError
from lookonce.evaluation import DetracScores, TrackingResult, TrackingScores, combine, evaluate_tracking
from lookonce.video.opening import one_line

__all__ = [
    "ClassChoice",
    "EvaluatedRun",
    "EvaluatedSequence",
    "choose_classes",
    "evaluate_run",
    "labels_in_truth",
    "rows_of",
]

_ANOTHER_CLASS = "of another class"
_BENCHMARK_CLASSES = 7  # as many as MOT16, MOT17 and MOT20 have that are not left out
_NOT_IN_TRUTH = -2


@dataclass(frozen=True, slots=True)
class ClassChoice:
    """Which classes are looked at.

    Attributes:
        labels: of the truth's classes, rising; empty = classes count as one, whatever they are.
        is_apart: whether each is evaluated by itself, too.
        is_all: whether nothing is left out where the classes count as one.
        numbered: names for the class numbers of MOT files, which count from 1; empty = as the truth says.
    """

    labels: tuple[int, ...] = ()
    is_apart: bool = False
    is_all: bool = True
    numbered: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class EvaluatedSequence:
    """The figures of a sequence.

    Attributes:
        name: of the sequence.
        scores: all chosen classes as one.
        by_class: class name -> figures, where classes are evaluated apart.
        file: where the result came from; None = from the tracker, or there was none.
        boxes: how many boxes the result had.
    """

    name: str
    scores: Scores
    by_class: Mapping[str, Scores]
    file: ResultFile | None
    boxes: int


@dataclass(frozen=True, slots=True)
class EvaluatedRun:
    """The figures of one set of results.

    Attributes:
        name: of the run.
        sequences: in the order of the truth.
        combined: over the sequences.
        by_class: class name -> figures over the sequences.
        unknown_classes: class of the result that the truth does not have -> boxes.
    """

    name: str
    sequences: tuple[EvaluatedSequence, ...]
    combined: Scores
    by_class: Mapping[str, Scores]
    unknown_classes: Mapping[str, int] = field(default_factory=dict)


def choose_classes(
    sequences: Sequence[TrueSequence], wanted: Sequence[str], *, is_apart: bool, numbered: tuple[str, ...] = ()
) -> ClassChoice:
    """The choice for class names, as COCO or as Darknet spells them.

    Raises:
        ConfigError: the truth has no classes, or not this one.
    """
    if not (wanted or is_apart):
        return ClassChoice(numbered=numbered)
    names = sequences[0].classes
    if not names:
        raise ConfigError("the rules of a benchmark count pedestrians only; leave --classes and --per-class away")
    known = _by_usual_name(names)
    for name in wanted:
        if usual_name(name) not in known:
            raise ConfigError(f"class {name!r} is not in the truth; it has {', '.join(names)}")
    labels = {known[usual_name(name)] for name in wanted} if wanted else set(range(len(names)))
    return ClassChoice(tuple(sorted(labels)), is_apart, not wanted, numbered)


def _by_usual_name(names: Sequence[str]) -> dict[str, int]:
    labels: dict[str, int] = {}
    for label, name in enumerate(names):
        labels.setdefault(usual_name(name), label)
    return labels


def evaluate_run(
    name: str,
    sequences: Sequence[TrueSequence],
    results: Callable[[TrueSequence], SequenceResult],
    files: Mapping[str, ResultFile],
    protocol: str,
    choice: ClassChoice,
    report: Callable[[int], None] = lambda done: None,
) -> EvaluatedRun:
    """The figures of one set of results; each sequence is read, evaluated and forgotten.

    Args:
        name: of the run.
        sequences: the truth, one or more.
        results: gives the boxes of a sequence.
        files: where they come from, by sequence.
        protocol: one of ``lookonce.evaluation.PROTOCOLS``.
        choice: of classes.
        report: told how many sequences are done.

    Raises:
        ConfigError: classes are chosen and the results have none, or none that the truth has.
    """
    unknown: Counter[str] = Counter()
    evaluated = []
    for sequence in sequences:
        file = files.get(sequence.name)
        evaluated.append(_evaluate(sequence, results(sequence), file, name, protocol, choice, unknown))
        report(len(evaluated))
    if unknown and sum(unknown.values()) == sum(one.boxes for one in evaluated):
        theirs, ours = ", ".join(sorted(unknown)), ", ".join(sequences[0].classes)
        raise ConfigError(
            f"{one_line(name)}: no box is of a class that the truth has (results: {theirs}; truth: {ours})"
        )
    classes = [sequences[0].classes[label] for label in choice.labels] if choice.is_apart else []
    by_class = {one: _combined([sequence.by_class[one] for sequence in evaluated]) for one in classes}
    return EvaluatedRun(
        name, tuple(evaluated), _combined([one.scores for one in evaluated]), by_class, dict(sorted(unknown.items()))
    )


def _evaluate(
    sequence: TrueSequence,
    found: SequenceResult,
    file: ResultFile | None,
    run: str,
    protocol: str,
    choice: ClassChoice,
    unknown: Counter[str],
) -> EvaluatedSequence:
    """The figures of one sequence; adds to ``unknown`` the boxes of classes that the truth does not have."""
    by_class: dict[str, Scores] = {}
    chosen, truth = found.result, sequence.truth
    if choice.labels:
        labels = labels_in_truth(sequence, found, choice, file.shown if file else run, unknown)
        if not choice.is_all:
            chosen = rows_of(found.result, np.isin(labels, choice.labels))
            truth = replace(truth, is_counted=truth.is_counted & np.isin(truth.labels, choice.labels))
        for label in choice.labels if choice.is_apart else ():
            rows = rows_of(found.result, labels == label)
            by_class[sequence.classes[label]] = evaluate_tracking(truth.of_class(label), rows, protocol)
    return EvaluatedSequence(
        sequence.name, evaluate_tracking(truth, chosen, protocol), by_class, file, len(found.result)
    )


def _combined(scores: Sequence[Scores]) -> Scores:
    usual = [one for one in scores if isinstance(one, TrackingScores)]
    return combine(usual) if usual else combine([one for one in scores if isinstance(one, DetracScores)])


def rows_of(result: TrackingResult, is_chosen: NDArray[np.bool_]) -> TrackingResult:
    """The chosen rows; the others are counted as left out."""
    left_out = Counter(dict(result.left_out)) + Counter({_ANOTHER_CLASS: int((~is_chosen).sum())})
    return TrackingResult(
        result.row_frames[is_chosen], result.ids[is_chosen], result.xyxy[is_chosen], result.labels[is_chosen], left_out
    )


def labels_in_truth(
    sequence: TrueSequence, found: SequenceResult, choice: ClassChoice, shown: str, unknown: Counter[str]
) -> NDArray[np.int64]:
    """(N,) int64: the truth's label of each row of a result; names that the truth does not have go to ``unknown``."""
    labels = found.result.labels
    numbers, places = np.unique(labels, return_inverse=True)
    if found.class_names:
        names = [found.class_names[number] for number in numbers.tolist()]
    elif NO_CLASS in numbers.tolist():
        remedy = "give tracks.jsonl or a class column (the eighth), or leave --classes and --per-class away"
        raise ConfigError(f"{shown}: has boxes without class; {remedy}")
    else:
        names = [_name_of_number(sequence, number, choice.numbered, shown) for number in numbers.tolist()]
    known = _by_usual_name(sequence.classes)
    ours = np.array([known.get(usual_name(name), _NOT_IN_TRUTH) for name in names], np.int64)
    for name, label, count in zip(names, ours.tolist(), np.bincount(places, minlength=len(names)), strict=True):
        if label == _NOT_IN_TRUTH:
            unknown[name] += int(count)
    found_labels: NDArray[np.int64] = ours[places] if len(labels) else np.zeros(0, np.int64)
    return found_labels


def _name_of_number(sequence: TrueSequence, number: int, numbered: tuple[str, ...], shown: str) -> str:
    """What a class number of a MOT file means; they count from 1."""
    names, plain = numbered, f"class {number}"
    if not names and sequence.layout == "cvat":
        names = read_class_names(sequence.file.parent / "labels.txt")
    if not names and sequence.layout == "motchallenge" and sequence.classes[0] == "pedestrian":
        names = sequence.classes[:_BENCHMARK_CLASSES]
    if not names and plain not in sequence.classes:
        raise ConfigError(f"{shown}: nobody says what class number {number} means; give --class-names FILE")
    return names[number - 1] if 1 <= number <= len(names) else plain
