"""The experiment of the publication's section 4: UA-DETRAC's protocol along the detector's thresholds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lookonce.cli.compare_rows import IN_DETECT, CompareRow
from lookonce.cli.compare_runs import Comparison, absence
from lookonce.cli.compare_tables import markdown, markdown_table, print_rows, published_lines, show_table
from lookonce.cli.evaluation_files import write_text
from lookonce.cli.figures import Column, figures_of
from lookonce.compare.contenders.registry import Contender
from lookonce.compare.published import PUBLISHED, PUBLISHED_PR, PUBLISHED_SPEED
from lookonce.compare.running import TrackerProcess
from lookonce.evaluation import DetracScores, pr_scores

__all__ = ["THRESHOLDS", "DetracComparison", "compare_ua_detrac"]

THRESHOLDS = tuple(round(0.1 * number, 1) for number in range(11))
_CURVE = "detection_PR.txt"
_MADE = "made here"
_AS_PUBLISHED = "as published"


@dataclass(frozen=True, slots=True)
class DetracComparison:
    """What came out.

    Attributes:
        curve: recall and precision of the detector at each threshold.
        best: of each tracker the threshold of its highest MOTA, with its PR figures; or why it has none.
        every_row: all thresholds of all trackers, and ``best``'s rows without figures.
    """

    curve: tuple[tuple[float, float], ...]
    best: tuple[CompareRow, ...]
    every_row: tuple[CompareRow, ...]

    def show(self, title: str, columns: Sequence[Column], made_by: str) -> None:
        """All tables, as markdown where ``made_by`` says by what they were made."""
        points = zip(THRESHOLDS, self.curve, strict=True)
        curve = [[f"{at:.1f}", f"{100 * recall:.1f}", f"{100 * right:.1f}"] for at, (recall, right) in points]
        tables = [("the detector along its thresholds", ["threshold", "recall", "precision"], curve)]
        tables += [_quality(self.best), _speed(self.best), published_lines()[1]]
        about = f"{title}; each tracker at the threshold of its highest MOTA"
        if made_by:
            print(made_by)
            print(markdown(about, self.best, columns, self.every_row))
        else:
            print_rows(about, self.best, columns, self.every_row)
        for name, heads, lines in tables:
            if made_by:
                print(markdown_table(name, heads, lines))
            else:
                show_table(name, heads, lines)


_Table = tuple[str, list[str], list[list[str]]]


def compare_ua_detrac(
    comparison: Comparison, chosen: Sequence[Contender], has_oracle: bool, output: Path
) -> DetracComparison:
    """All trackers at all thresholds; each tracker's folder holds what `lookonce eval --detector-pr` takes.

    Args:
        comparison: under the protocol ``detrac``.
        chosen: the trackers.
        has_oracle: whether to add the ceiling.
        output: where results and the detector's curve go.
    """
    curve = tuple(_detector_point(comparison, threshold, output / "detector") for threshold in THRESHOLDS)
    lines = (f"{recall:.15f} {precision:.15f}\n" for recall, precision in curve)
    write_text(output / _CURVE, "".join(lines))
    best: list[CompareRow] = []
    every_row: list[CompareRow] = []
    for contender in chosen:
        rows = _along_thresholds(comparison, contender, output / contender.name)
        every_row += rows
        best.append(_best(rows, curve))
    if has_oracle:
        rows = [comparison.oracle(1, output / "oracle" / f"{one:.1f}", one) for one in THRESHOLDS]
        every_row += rows
        best.append(_best(rows, curve))
    return DetracComparison(curve, tuple(best), tuple([*every_row, *(row for row in best if row.pr is not None)]))


def _detector_point(comparison: Comparison, threshold: float, folder: Path) -> tuple[float, float]:
    """Recall and precision; of no detections at all 0 and 1, as in UA-DETRAC's own files."""
    scores = comparison.detector(threshold, folder / f"{threshold:.1f}").combined
    has_found = scores.true_positives + scores.false_positives if isinstance(scores, DetracScores) else 0
    return (scores.recall, scores.precision) if isinstance(scores, DetracScores) and has_found else (0.0, 1.0)


def _along_thresholds(comparison: Comparison, contender: Contender, folder: Path) -> list[CompareRow]:
    """A row a threshold; a single one that says why, where the tracker cannot take part."""
    note = absence(contender, comparison.scenes)
    rows: list[CompareRow] = []
    with TrackerProcess(contender, comparison.limit_s) as process:
        for threshold in THRESHOLDS:
            rows.append(comparison.run(process, 1, folder / f"{threshold:.1f}", threshold, note))
            if note:
                break
    return rows


def _best(rows: Sequence[CompareRow], curve: Sequence[tuple[float, float]]) -> CompareRow:
    """The row of highest MOTA, with the figures along the curve if there is a row for each threshold."""
    figures = [(row.run.combined, row) for row in rows if row.run is not None]
    detrac = [(scores, row) for scores, row in figures if isinstance(scores, DetracScores)]
    if not detrac:
        return rows[-1]
    _, best = max(detrac, key=lambda pair: pair[0].mota)  # of equals the first
    if len(detrac) < len(curve):
        return best
    recalls, precisions = np.array(curve).T
    return replace(best, pr=pr_scores([scores for scores, _ in detrac], precisions.copy(), recalls.copy()))


def _quality(best: Sequence[CompareRow]) -> _Table:
    """Table 1, ours beside theirs, by MOTA."""
    lines: list[tuple[float, list[str]]] = []
    for row in best:
        if row.run is not None:
            figures = figures_of(row.run.combined)
            mota, motp = figures["mota"], figures["motp"]
            cells = [
                _MADE,
                row.title,
                f"{100 * mota:.1f}",
                f"{100 * motp:.1f}",
                f"{100 * row.pr.mota:.1f}" if row.pr else "-",
            ]
            lines.append((mota, cells))
    for one in PUBLISHED:
        ranked = [
            f"{100 * pr.mota:.1f}" for pr in PUBLISHED_PR if (pr.detector, pr.tracker) == (one.detector, one.tracker)
        ]
        cells = [
            _AS_PUBLISHED,
            f"{one.detector} + {one.tracker}",
            f"{100 * one.mota:.1f}",
            f"{100 * (one.motp or 0):.1f}",
        ]
        lines.append((one.mota, [*cells, ranked[0] if ranked else "-"]))
    lines.sort(key=lambda line: line[0])
    return (
        "table 1: quality, rising; rows as published rest on other data or detections",
        ["row", "tracker", "MOTA", "MOTP", "PR-MOTA"],
        [cells for _, cells in lines],
    )


def _speed(best: Sequence[CompareRow]) -> _Table:
    """Table 2: frames a second, of all stages and of the association alone."""
    lines: list[tuple[float, list[str]]] = []
    for row in best:
        if row.speed is not None and row.speed.associate_s:
            speed = row.speed
            whole = f"{1 / speed.total_s:.1f}" if speed.detect_s else "-"
            describe = IN_DETECT if speed.is_one_look else f"{1 / speed.describe_s:.1f}" if speed.describe_s else "-"
            detect = f"{1 / speed.detect_s:.1f}" if speed.detect_s else "-"
            rate = 1 / speed.total_s
            lines.append((rate, [_MADE, row.title, whole, detect, describe, f"{1 / speed.associate_s:,.0f}"]))
    lines += [(one.fps, [_AS_PUBLISHED, one.method, f"{one.fps:g}", "-", "-", "-"]) for one in PUBLISHED_SPEED]
    lines.sort(key=lambda line: line[0])
    return (
        "table 2: frames a second, rising; rows as published come from other machines and do not say of which stages",
        ["row", "method", "all fps", "detect fps", "describe fps", "associate fps"],
        [cells for _, cells in lines],
    )
