"""What `lookonce report` reads: results by run and sequence, with all that lies beside them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.cli import evaluated_runs
from lookonce.cli.evaluated_results import ResultFile, SequenceResult, find_results, named_paths
from lookonce.cli.evaluated_runs import ClassChoice
from lookonce.cli.evaluated_truth import TrueSequence
from lookonce.datasets import usual_name
from lookonce.evaluation import TrackingResult
from lookonce.report.explained import Explanation, read_explanation
from lookonce.report.run_lines import RunLines, read_mot_lines, read_run_lines

__all__ = ["RunSequence", "chosen_detections", "chosen_rows", "files_of_runs", "files_without_truth", "read_sequence"]

_MOT, _JSON, _EXPLAINED = "tracks.txt", "tracks.jsonl", "explain.jsonl"
_TABLE = "_LX"  # the first of UA-DETRAC's four


@dataclass(frozen=True, slots=True)
class RunSequence:
    """What a run says about a sequence.

    Attributes:
        found: boxes with identity.
        lines: all detections, and how they were made.
        explanation: None = the run is not explained.
        files: that were read.
    """

    found: SequenceResult
    lines: RunLines
    explanation: Explanation | None
    files: tuple[Path, ...]


def files_of_runs(given: Sequence[str], names: Sequence[str], *, may_miss: bool, with_classes: bool) -> dict[
    str, dict[str, ResultFile]
]:  # fmt: skip
    """Run -> sequence -> where its result is, for the sequences that have truth.

    Raises:
        ConfigError: results are not found, fit no sequence, or do not fit one only.
    """
    paths = named_paths(given)
    return {run: find_results(path, names, may_miss=may_miss, with_classes=with_classes) for run, path in paths.items()}


def files_without_truth(given: Sequence[str]) -> dict[str, dict[str, ResultFile]]:
    """The same for all sequences that the runs have.

    Raises:
        ConfigError: results are not found, or a sequence has two of them.
    """
    return {
        run: find_results(path, _possible_names(path), may_miss=True, with_classes=True)
        for run, path in named_paths(given).items()
    }


def _possible_names(path: Path) -> list[str]:
    """What the sequences at a path may be called; ``find_results`` says which of them there are."""
    if path.is_file():
        return [path.absolute().parent.name if path.name in (_MOT, _JSON) else path.stem]
    inside = sorted(one.stem if one.is_file() else one.name for one in path.iterdir() if not one.name.startswith("."))
    return list(dict.fromkeys([path.resolve().name, *inside, *(one.removesuffix(_TABLE) for one in inside)]))


def read_sequence(file: ResultFile | None) -> RunSequence:
    """One result and what lies beside it; without a file nothing was found.

    Raises:
        FormatError: a file breaks its format.
    """
    if file is None:
        found = SequenceResult.empty()
        return RunSequence(found, _lines_of(found.result), None, ())
    path, found = file.paths[0], file.read()
    files = [*file.paths]
    beside = path if path.suffix.lower() == ".jsonl" else path.with_name(_JSON)
    if len(file.paths) > 1:
        lines = _lines_of(found.result)
    elif beside == path or (path.name == _MOT and beside.is_file()):
        lines = read_run_lines(beside)
        files += [beside] if beside != path else []
    else:
        lines = read_mot_lines(path)
    explanation = None
    explained = path.with_name(_EXPLAINED)
    if path.name in (_MOT, _JSON) and explained.is_file():
        explanation = read_explanation(explained)
        files.append(explained)
    return RunSequence(found, lines, explanation, tuple(files))


def _lines_of(result: TrackingResult) -> RunLines:
    """What little is known of results without scores."""
    has_area = (result.xyxy[:, 2:] > result.xyxy[:, :2]).all(axis=1)
    rows = np.flatnonzero(has_area)
    none = np.zeros(len(rows), np.int64)
    return RunLines(
        result.row_frames[rows], result.xyxy[rows], np.ones(len(rows)), none, (), result.ids[rows],
        np.unique(result.row_frames),
    )  # fmt: skip


def chosen_rows(
    sequence: TrueSequence, found: SequenceResult, choice: ClassChoice, shown: str, unknown: Counter[str]
) -> tuple[TrueSequence, SequenceResult]:
    """Truth and result with the chosen classes only, as `lookonce eval` takes them; adds to ``unknown``."""
    if not choice.labels:
        return sequence, found
    labels = evaluated_runs.labels_in_truth(sequence, found, choice, shown, unknown)
    truth = replace(
        sequence.truth, is_counted=sequence.truth.is_counted & np.isin(sequence.truth.labels, choice.labels)
    )
    rows = evaluated_runs.rows_of(found.result, np.isin(labels, choice.labels))
    return replace(sequence, truth=truth), SequenceResult(rows, found.class_names)


def chosen_detections(lines: RunLines, classes: Sequence[str]) -> NDArray[np.bool_] | None:
    """(N,) bool: the detections of the chosen classes, all without a choice; None where nobody knows their classes."""
    if not classes:
        return np.ones(len(lines.labels), np.bool_)
    if not lines.names:
        return None
    wanted = {usual_name(name) for name in classes}
    is_wanted = np.array([usual_name(name) in wanted for name in lines.names], np.bool_)
    chosen: NDArray[np.bool_] = is_wanted[lines.labels]
    return chosen
