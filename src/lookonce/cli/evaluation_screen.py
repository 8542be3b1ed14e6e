"""What `lookonce eval` shows: the tables, what was left out, and what falls short of a limit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from rich.console import Console

from lookonce.cli.evaluated_runs import EvaluatedRun
from lookonce.cli.evaluated_truth import TrueSequence
from lookonce.cli.figures import Column, choose_columns, figures_of, print_table
from lookonce.errors import ConfigError
from lookonce.evaluation import PRScores

__all__ = ["Limit", "print_hints", "print_left_out", "print_pr", "print_runs", "shortfalls"]

_PR_HEADINGS = {
    "mota": "PR-MOTA",
    "motp": "PR-MOTP",
    "motal": "PR-MOTAL",
    "recall": "PR-Rcll",
    "precision": "PR-Prcn",
    "mostly_tracked_share": "PR-MT",
    "partly_tracked_share": "PR-PT",
    "mostly_lost_share": "PR-ML",
    "false_positives": "PR-FP",
    "misses": "PR-FN",
    "id_switches": "PR-IDs",
    "fragmentations": "PR-FM",
}
_BENCHMARK = re.compile(r"MOT(15|16|17|20)(?=-[0-9])", re.IGNORECASE)
_PR_COUNTS = ("false_positives", "misses", "id_switches", "fragmentations")


@dataclass(frozen=True, slots=True)
class Limit:
    """What a figure of a run must reach.

    Attributes:
        name: of the figure.
        heading: the same in tables.
        limit: the smallest value that is good, or the largest.
        is_largest: which of the two.
    """

    name: str
    heading: str
    limit: float
    is_largest: bool

    @classmethod
    def of(cls, limits: Mapping[str, float | None], protocol: str) -> tuple[Limit, ...]:
        """Those that are given; identity switches are limited from above.

        Raises:
            ConfigError: the protocol has no such figure, or a limit is no number.
        """
        found = []
        for name, limit in limits.items():
            if limit is None:
                continue
            (column,) = choose_columns(name, "trackeval")
            if protocol == "detrac" and name in ("hota", "idf1"):
                raise ConfigError(f"the protocol detrac has no {column.heading}; leave --min-{name} away")
            if limit != limit:
                raise ConfigError(f"--min-{name}: expected a number, got nan")
            found.append(cls(name, column.heading, limit, name == "id_switches"))
        return tuple(found)


def shortfalls(limits: Sequence[Limit], runs: Sequence[EvaluatedRun]) -> list[str]:
    """In words, each combined figure that misses its limit."""
    found = []
    for run in runs:
        figures = figures_of(run.combined)
        where = f"{run.name}: " if len(runs) > 1 else ""
        for one in limits:
            value = figures[one.name]
            if value > one.limit if one.is_largest else value < one.limit:
                relation = "is above" if one.is_largest else "is below"
                found.append(f"{where}{one.heading} {value:.6g} {relation} {one.limit:.6g}")
    return found


def print_runs(runs: Sequence[EvaluatedRun], columns: Sequence[Column], rules: str, heading: str) -> None:
    """One run by sequence and class; several side by side, a row each; then each run by class."""
    if len(runs) == 1:
        (run,) = runs
        rows = [(one.name, figures_of(one.scores)) for one in run.sequences]
        combined = figures_of(run.combined) if len(rows) > 1 else None
        print_table("sequence", f"{run.name}: {rules}", rows, columns, combined)
    else:
        rows = [(run.name, figures_of(run.combined)) for run in runs]
        print_table(heading, f"{rules}; all sequences combined", rows, columns)
    for run in runs:
        if run.by_class:
            rows = [(name, figures_of(scores)) for name, scores in run.by_class.items()]
            print_table("class", f"{run.name}: each class by itself", rows, columns)


def print_pr(scores: PRScores) -> None:
    """UA-DETRAC's ranking figures, with the name of the formula."""
    names = _PR_HEADINGS
    columns = [Column(heading, name, name not in _PR_COUNTS) for name, heading in names.items()]
    print_table("formula", "along the detector's precision-recall curve", [("trapezoid", asdict(scores))], columns)


def print_left_out(runs: Sequence[EvaluatedRun]) -> None:
    """Everything that did not count, with its number."""
    for run in runs:
        where = f"{run.name}: " if len(runs) > 1 else ""
        for why, count in sorted(run.combined.left_out.items()):
            _say(f"{where}left out: {_counted(why, count)}")
        for name, scores in run.by_class.items():
            if reasons := "; ".join(_counted(why, count) for why, count in sorted(scores.left_out.items())):
                _say(f"{where}left out for {name}: {reasons}")
        for name, count in run.unknown_classes.items():
            _say(f"{where}not in the truth: class {name}, {_counted('result', count)}")
        if empty := [one.name for one in run.sequences if not one.boxes]:
            _say(f"{where}no boxes in the results of: {', '.join(empty)}")


def print_hints(truth: Sequence[TrueSequence], benchmark: str, protocol: str) -> None:
    """Says so where sequences are called as a benchmark's, and no rule follows from it."""
    names = [one.name for one in truth]
    found = sorted({match[0].upper() for name in names if (match := _BENCHMARK.match(name))})
    if found and not benchmark and protocol == "trackeval":
        _say(f"these are not {found[0]}'s official figures: every object counts; --benchmark {found[0]} for its rules")


def _counted(why: str, count: int) -> str:
    return f"{count:,} {'box' if count == 1 else 'boxes'} of the {why}"


def _say(text: str) -> None:
    Console().print(text, markup=False, highlight=False, soft_wrap=True)
