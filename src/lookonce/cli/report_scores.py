"""The figures of a report: those of `lookonce eval`, with what each of them means."""

from __future__ import annotations

from collections.abc import Sequence

from lookonce.cli.evaluated_runs import EvaluatedRun
from lookonce.cli.evaluated_truth import TrueSequence
from lookonce.cli.figures import Column, Scores, choose_columns, figures_of
from lookonce.report import ScoreColumn, ScoreRow, ScoreTable

__all__ = ["score_table"]

_MEANINGS: dict[str, tuple[str, bool | None]] = {
    "hota": ("detection and association in one figure: the root of DetA times AssA, mean over overlaps", True),
    "det_a": ("how well objects are found, mean over overlaps of 0.05 to 0.95", True),
    "ass_a": ("how well what is found keeps its identity, mean over overlaps of 0.05 to 0.95", True),
    "idf1": ("share of boxes with the right identity, each object belonging to one identity for the whole video", True),
    "mota": ("1 minus misses, false boxes and identity switches per true box; may be negative", True),
    "motp": ("mean overlap of matches", True),
    "recall": ("of the true boxes those found", True),
    "precision": ("of the result's boxes those that found something", True),
    "id_switches": ("identity switches: an object's match has another identity than its last match", False),
    "fragmentations": ("how often the tracking of an object breaks off and is taken up again", False),
    "false_positives": ("false boxes: they found nothing", False),
    "misses": ("true boxes that were not found", False),
    "mostly_tracked": ("objects found in more than 80 % of their frames", True),
    "partly_tracked": ("objects found in 20 to 80 % of their frames", None),
    "mostly_lost": ("objects found in less than 20 % of their frames", False),
    "truth_boxes": ("true boxes that count", None),
}


def score_table(runs: Sequence[EvaluatedRun], truth: Sequence[TrueSequence], rules: str, protocol: str) -> ScoreTable:
    """All runs side by side, by sequence and combined, with everything that did not count."""
    columns = choose_columns("", protocol)
    rows = []
    for number, sequence in enumerate(truth):
        rows += [_row(sequence.name, run.name, run.sequences[number].scores, columns) for run in runs]
    if len(truth) > 1:
        rows += [_row("", run.name, run.combined, columns) for run in runs]
    left_out = []
    for run in runs:
        left_out += [(run.name, why, count) for why, count in sorted(run.combined.left_out.items())]
        left_out += [
            (run.name, f"result: of class {name}, which the truth does not have", count)
            for name, count in run.unknown_classes.items()
        ]
    return ScoreTable(
        rules,
        tuple(ScoreColumn(column.heading, *_MEANINGS[column.name]) for column in columns),
        tuple(rows),
        tuple(left_out),
        tuple(_notes(runs)),
    )


def _row(sequence: str, run: str, scores: Scores, columns: Sequence[Column]) -> ScoreRow:
    figures = figures_of(scores)
    return ScoreRow(
        sequence,
        run,
        tuple(column.show(figures) for column in columns),
        tuple(float(figures[column.name]) for column in columns),
    )


def _notes(runs: Sequence[EvaluatedRun]) -> list[str]:
    notes = []
    for run in runs:
        if empty := [one.name for one in run.sequences if not one.boxes]:
            notes.append(f"No boxes in the results of run {run.name} for: {', '.join(empty)}.")
    return notes
