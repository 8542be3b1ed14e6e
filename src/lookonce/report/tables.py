"""The tables of a page: scores, what was left out, sizes, lengths, decisions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from lookonce.report.explained import DECISIONS
from lookonce.report.markup import Content, Fragment, element, joined
from lookonce.report.mistakes import SizeClass
from lookonce.report.views import ScoreColumn, ScoreRow, ScoreTable

__all__ = ["bar", "count_table", "decision_table", "left_out_table", "score_table", "scrolled", "size_table", "table"]


def table(
    headings: Sequence[Content],
    rows: Sequence[Sequence[Content]],
    *,
    caption: str = "",
    texts: Sequence[int] = (),
    class_: str | None = None,
) -> Fragment:
    """A table whose first column names the rows; ``texts`` are the columns of words, which stand to the left."""
    is_text = [number in (0, *texts) for number in range(len(headings))]
    head = [
        element("th", heading, scope="col", class_="t" if text else None)
        for heading, text in zip(headings, is_text, strict=True)
    ]
    body = [
        element(
            "tr",
            element("th", row[0], scope="row"),
            *(
                element("td", cell, class_="t" if text else None)
                for cell, text in zip(row[1:], is_text[1:], strict=True)
            ),
        )
        for row in rows
    ]
    return element(
        "table",
        element("caption", caption) if caption else None,
        element("thead", element("tr", *head)),
        element("tbody", *body),
        class_=class_,
    )


def scrolled(content: Fragment, label: str) -> Fragment:
    """Something wide in a region that scrolls by itself, also by keyboard."""
    return element("div", content, class_="scroll", tabindex=0, role="region", aria_label=label)


def bar(share: float, class_: str) -> Fragment:
    """A share from 0 to 1 as a bar; it only repeats what is written beside it."""
    part = f"{100 * min(max(share, 0.0), 1.0):.1f}%"
    return element(
        "svg",
        element("rect", width="100%", height="100%", class_="all"),
        element("rect", width=part, height="100%", class_=class_),
        class_="bar",
        aria_hidden="true",
    )


def score_table(scores: ScoreTable) -> Fragment:
    """A row for each sequence and run, the best of several runs marked; the combined figures of several runs first."""
    apart = [row for row in scores.rows if row.sequence]
    combined = [row for row in scores.rows if not row.sequence]
    rules = f"{scores.rules}. Shares in percent."
    if len({row.run for row in scores.rows}) > 1 and combined:
        return joined(
            _scores(scores, combined, [], f"{rules} All sequences combined."),
            _scores(scores, apart, [], "By sequence."),
        )
    return _scores(scores, apart, combined, rules)


def _scores(scores: ScoreTable, rows: Sequence[ScoreRow], foot: Sequence[ScoreRow], caption: str) -> Fragment:
    is_several = len({row.run for row in rows}) > 1
    best = {name: _best(scores.columns, [row for row in rows if row.sequence == name]) for name in _sequences(rows)}
    head = [element("th", "sequence", scope="col", class_="t")]
    if is_several:
        head.append(element("th", "run", scope="col", class_="t"))
    head += [
        element("th", element("abbr", column.heading, title=column.meaning), scope="col") for column in scores.columns
    ]
    none: list[float | None] = [None] * len(scores.columns)
    made = element(
        "table",
        element("caption", caption),
        element("thead", element("tr", *head)),
        element("tbody", *(_score_row(scores, row, best[row.sequence], is_several) for row in rows)),
        element("tfoot", *(_score_row(scores, row, none, is_several) for row in foot)) if foot else None,
        class_="wide sortable" if len(rows) > 1 else "wide",
    )
    return scrolled(made, f"Scores. {caption}")


def _sequences(rows: Sequence[ScoreRow]) -> list[str]:
    return list(dict.fromkeys(row.sequence for row in rows))


def _best(columns: Sequence[ScoreColumn], rows: Sequence[ScoreRow]) -> list[float | None]:
    """By column the best value of several runs; None where they are all the same, or nothing is better."""
    found: list[float | None] = []
    for number, column in enumerate(columns):
        values = [row.values[number] for row in rows]
        if column.is_more_better is None or len(set(values)) < 2:
            found.append(None)
        else:
            found.append(max(values) if column.is_more_better else min(values))
    return found


def _score_row(scores: ScoreTable, row: ScoreRow, best: Sequence[float | None], is_several: bool) -> Fragment:
    cells = [element("th", row.sequence or "combined", scope="row")]
    if is_several:
        cells.append(element("td", row.run, class_="t"))
    for column, shown, value, top in zip(scores.columns, row.shown, row.values, best, strict=True):
        is_best = top is not None and value == top
        class_ = ("best" if column.is_more_better else "best low") if is_best else None
        cells.append(element("td", shown, class_=class_, data_v=f"{value:.6g}"))
    return element("tr", *cells, data_sequence=row.sequence or None)


def left_out_table(rows: Sequence[tuple[str, str, int]]) -> Fragment:
    """What did not count, by run and reason."""
    is_several = len({run for run, _, _ in rows}) > 1
    if is_several:
        shown: list[list[Content]] = [[run, why, f"{count:,}"] for run, why, count in rows]
        return table(["run", "what", "boxes"], shown, texts=(1,))
    return table(["what", "boxes"], [[why, f"{count:,}"] for _, why, count in rows])


def size_table(sizes: Sequence[SizeClass]) -> Fragment:
    """True boxes, misses and false boxes by height."""
    most_wrong = max((one.wrong for one in sizes), default=0)
    rows: list[list[Content]] = []
    for one in sizes:
        share = one.missed / one.true if one.true else math.nan
        rows.append(
            [
                one.name,
                f"{one.true:,}",
                f"{one.missed:,}",
                ["- " if math.isnan(share) else f"{share:.0%} ", bar(0 if math.isnan(share) else share, "part")],
                [f"{one.wrong:,} ", bar(one.wrong / most_wrong if most_wrong else 0, "count")],
            ]
        )
    return table(["height of the box", "true", "missed", "share missed", "false"], rows)


def count_table(heading: str, counts: Mapping[str, int], caption: str = "") -> Fragment:
    """What -> how many, with bars."""
    most = max(counts.values(), default=0)
    rows: list[list[Content]] = [
        [what, [f"{count:,} ", bar(count / most if most else 0, "count")]] for what, count in counts.items()
    ]
    return scrolled(table([heading, "how many"], rows, caption=caption), heading[:1].upper() + heading[1:])


def decision_table(decisions: Mapping[str, int]) -> Fragment:
    """What the tracker decided, in words."""
    rows: list[list[Content]] = [[name, f"{count:,}", DECISIONS.get(name, "")] for name, count in decisions.items()]
    return table(["decision", "detections", "the detection ..."], rows, texts=(2,))
