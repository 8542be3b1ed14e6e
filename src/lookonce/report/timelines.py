"""Timelines as tables of bars: a bar is as long as an object kept an identity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from lookonce.report.markup import Fragment, element, joined
from lookonce.report.spans import Clock, Span, Timeline, TimelineRow

__all__ = ["colour_class", "timeline_of_identities", "timeline_of_objects"]

_ROW_PX, _BAR_PX = 17, 14
_LEAST_LABELLED = 2.2  # percent of the width that a digit or two need
_TICKS = 6


def colour_class(timeline: Timeline, identity: int) -> str:
    """The style class of an identity's colour."""
    return f"c{timeline.colours.get(identity, identity % 8)}"


def timeline_of_objects(timeline: Timeline, clock: Clock, title: str) -> Fragment:
    """A table: each true object, its identities over time, how many they are, and how much of it was found."""
    head = element(
        "tr",
        element("th", "object", scope="col", class_="t"),
        element("th", _axis(timeline, clock), scope="col", class_="t"),
        element("th", "ids", scope="col", class_="n"),
        element("th", "found", scope="col", class_="n"),
    )
    rows = [_object_row(timeline, clock, row) for row in timeline.rows]
    table = element("table", element("thead", head), element("tbody", *rows, class_="bars"))
    usual = "A colour is an identity; its number stands in the bar where there is room. A thin grey line: missed."
    return _frame(table, usual, title, timeline, "objects")


def timeline_of_identities(timeline: Timeline, clock: Clock, title: str) -> Fragment:
    """All identities in as few rows as hold them."""
    height = _ROW_PX * max(1, len(timeline.rows))
    bars = [_bars(timeline, clock, row, number * _ROW_PX, "") for number, row in enumerate(timeline.rows)]
    label = f"{title}: {sum(row.identities for row in timeline.rows):,} identities in {len(timeline.rows)} rows"
    chart = element(
        "div",
        _axis(timeline, clock),
        element("svg", *bars, height=height, role="img", aria_label=label, class_="bars"),
        class_="lanes",
    )
    usual = "A bar is an identity from its first box to its last; a row holds several that follow each other."
    return _frame(chart, usual, title, timeline, "identities")


def _frame(content: Fragment, usual: str, title: str, timeline: Timeline, what: str) -> Fragment:
    """The chart in a region that can be scrolled, also by keyboard, with a line that says what is under the pointer."""
    notes = []
    if timeline.left_out:
        notes.append(f"{timeline.left_out:,} short-lived {what} are not drawn.")
    if timeline.step > 1:
        notes.append(f"{timeline.step} frames are drawn as one.")
    return element(
        "div",
        element("p", usual, class_="readout", aria_hidden="true"),
        element("div", content, class_="scroll", tabindex=0, role="region", aria_label=title),
        element("p", " ".join(notes), class_="note") if notes else None,
        class_="tl",
    )


def _object_row(timeline: Timeline, clock: Clock, row: TimelineRow) -> Fragment:
    who = f"{row.name} {row.label}".strip()
    share = row.found / row.boxes if row.boxes else 0.0
    said = f"object {who}: {row.identities} identities, {share:.0%} found"
    return element(
        "tr",
        element("th", who, scope="row", title=f"object {who}"),
        element(
            "td",
            element(
                "svg", _bars(timeline, clock, row, 0, f", object {row.name}"), height=_ROW_PX, role="img",
                aria_label=said,
            ),
        ),
        element("td", row.identities),
        element("td", f"{share:.0%}"),
    )  # fmt: skip


def _bars(timeline: Timeline, clock: Clock, row: TimelineRow, top: int, where: str) -> Fragment:
    """The spans of a row, those of an identity in one group; positions in percent, so that text is not stretched."""
    scale = 100 / timeline.steps
    missed = [
        _rect(span, scale, top + _ROW_PX // 2 - 1, 2, "m") for span in row.spans if span.id < 0 and timeline.frames.size
    ]
    groups = []
    for identity, spans in _by_identity(row.spans):
        first, last = timeline.first_frame(spans[0].first), timeline.last_frame(spans[-1].last)
        said = f"identity {identity}{where}: frames {clock.show(first)} to {clock.show(last)}"
        longest = max(spans, key=lambda span: span.last - span.first)
        label = str(identity)
        is_labelled = (longest.last - longest.first + 1) * scale >= _LEAST_LABELLED * max(1.0, len(label) * 0.55)
        groups.append(
            element(
                "g",
                element("title", said),
                *(_rect(span, scale, top + 1, _BAR_PX) for span in spans),
                element("text", label, x=f"{_percent(longest.first * scale + 0.25)}", y=top + 12)
                if is_labelled
                else None,
                class_=colour_class(timeline, identity),
                data_i=identity,
            )
        )
    return joined(*missed, *groups)


def _by_identity(spans: Sequence[Span]) -> Iterator[tuple[int, list[Span]]]:
    seen = sorted((span for span in spans if span.id >= 0), key=lambda span: (span.id, span.first))
    for identity, group in groupby(seen, key=lambda span: span.id):
        yield identity, list(group)


def _rect(span: Span, scale: float, y: int, height: int, class_: str | None = None) -> Fragment:
    return element(
        "rect",
        x=_percent(span.first * scale),
        width=_percent(max(0.12, (span.last - span.first + 1) * scale)),
        y=y,
        height=height,
        class_=class_,
    )


def _percent(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".") + "%"


def _axis(timeline: Timeline, clock: Clock) -> Fragment:
    """Where frames are, and at what time."""
    marks = []
    for tick in range(_TICKS):
        step = round(tick * (timeline.steps - 1) / (_TICKS - 1))
        frame = timeline.first_frame(step)
        seconds = clock.seconds(frame)
        text = f"{frame:,}" if seconds is None else f"{seconds:.1f} s"
        anchor = "start" if tick == 0 else "end" if tick == _TICKS - 1 else "middle"
        marks.append(
            element("text", text, x=_percent(100 * tick / (_TICKS - 1)), y=12, text_anchor=anchor, class_="axis")
        )
    return element("svg", *marks, height=_ROW_PX, aria_hidden="true")
