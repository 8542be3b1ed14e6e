"""The whole page: one file without any other, readable without its script, the same bytes for the same report."""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from itertools import groupby
from typing import Final

from lookonce.report.charts import curve_chart, curve_table, distance_chart
from lookonce.report.markup import Content, Fragment, element, joined, raw
from lookonce.report.mistakes import add_sizes
from lookonce.report.sequences import sequence_article
from lookonce.report.tables import left_out_table, score_table, scrolled, size_table, table
from lookonce.report.views import Report

__all__ = ["page_text"]

_HOW_TO_DESCRIBE: Final = (
    "Runs do not keep descriptors. Give the model file (--model) and the truth (--truth), and this page shows how far "
    "apart its descriptors put boxes of one object and of two."
)


def page_text(report: Report) -> str:
    """The page as HTML. Everything that is not ours stands in it as escaped text."""
    style = files("lookonce.report").joinpath("page.css").read_text("utf-8")
    script = files("lookonce.report").joinpath("page.js").read_text("utf-8")
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {_hash(script)}; "
        "base-uri 'none'; form-action 'none'"
    )
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("meta", name="referrer", content="no-referrer"),
        element("title", f"{report.title}: tracking report"),
        element("style", raw(style)),
    )
    body = element(
        "body",
        element("a", "Skip to the content", href="#content", class_="skip"),
        _header(report),
        _navigation(report),
        element("main", *_sections(report), id="content"),
        _footer(report),
        element("script", raw(script)),
    )
    return f"<!doctype html>\n{element('html', head, body, lang='en').text}\n"


def _hash(text: str) -> str:
    """As a Content-Security-Policy names what may stand in the page."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _header(report: Report) -> Fragment:
    names = dict.fromkeys(view.sequence for view in report.views)
    runs = ", ".join(report.runs)
    count = f"{len(names):,} sequence{'s' if len(names) != 1 else ''}"
    against = f"held against {report.truth}" if report.truth else "without truth"
    return element(
        "header",
        element("h1", report.title),
        element("p", f"Tracking report: {count}, {against}. Run{'s' if len(report.runs) > 1 else ''}: {runs}."),
        *(element("p", note, class_="note") for note in report.notes),
    )


def _navigation(report: Report) -> Fragment:
    names = list(dict.fromkeys(view.sequence for view in report.views))
    links = [("#scores", "Scores")] if report.scores is not None else []
    links.append(("#s0", "Sequences" if len(names) > 1 else "Sequence"))
    if report.curves:
        links.append(("#detections", "Detections"))
    links += [("#descriptors", "Descriptors"), ("#about", "About")]
    options = [element("option", "all", value=""), *(element("option", name, value=name) for name in names)]
    choice = element("label", "Sequence ", element("select", *options, id="only"), hidden=True)
    content: list[Content] = [element("a", text, href=where) for where, text in links]
    if len(names) > 1:
        content.append(choice)
    return element("nav", element("div", *content), aria_label="Parts of this page")


def _sections(report: Report) -> list[Fragment]:
    found = []
    if report.scores is not None:
        found.append(_scores(report))
    for number, (_, views) in enumerate(groupby(report.views, key=lambda view: view.sequence)):
        found.append(sequence_article(list(views), number, len(report.runs) > 1))
    if report.curves:
        found.append(_detections(report))
    found.append(_descriptors(report))
    return found


def _scores(report: Report) -> Fragment:
    scores = report.scores
    assert scores is not None  # asked before
    meanings = [(element("dt", one.heading), element("dd", one.meaning)) for one in scores.columns]
    parts: list[Content] = [
        element("h2", "Scores", id="scores"),
        score_table(scores),
        *(element("p", note, class_="note") for note in scores.notes),
        element("details", element("summary", "What the figures mean"), element("dl", *meanings)),
        element("h3", "Left out"),
    ]
    if scores.left_out:
        parts.append(scrolled(left_out_table(scores.left_out), "What was left out"))
    else:
        parts.append(element("p", "Nothing: every box of the truth and of the results counts.", class_="note"))
    sizes = [view.sizes for view in report.views if view.sizes]
    for run in report.runs:
        mine = [view.sizes for view in report.views if view.run == run and view.sizes]
        if len(mine) > 1 and len(sizes) > 1:
            name = f", run {run}" if len(report.runs) > 1 else ""
            parts.append(element("h3", f"Misses and false boxes by size, all sequences{name}"))
            parts.append(scrolled(size_table(add_sizes(mine)), f"By size, all sequences{name}"))
    return element("section", *parts, aria_labelledby="scores")


def _detections(report: Report) -> Fragment:
    about = (
        "Every detection, whatever identity it got, from the surest to the least sure. A run holds no detections below "
        "the score it was made with, so its curve ends there; lower that score to see more of it."
    )
    return element(
        "section",
        element("h2", "Precision and recall of the detections", id="detections"),
        element("p", about, class_="note"),
        curve_chart(report.curves),
        scrolled(curve_table(report.curves), "Precision and recall"),
        aria_labelledby="detections",
    )


def _descriptors(report: Report) -> Fragment:
    heading = element("h2", "Descriptors", id="descriptors")
    found = report.descriptors
    if found is None:
        return element("section", heading, element("p", _HOW_TO_DESCRIBE, class_="note"), aria_labelledby="descriptors")
    if not (sum(found.genuine) and sum(found.impostor)):
        text = (
            f"{found.model} described {found.boxes:,} boxes of {found.identities:,} objects; no two of them are 0.5 to "
            "30 s apart and of one object, or none of two, so there is nothing to compare."
        )
        return element("section", heading, element("p", text, class_="note"), aria_labelledby="descriptors")
    rows: list[list[Content]] = [
        ["boxes described", f"{found.boxes:,} of {found.identities:,} objects in {found.frames:,} frames"],
        ["pairs 0.5 to 30 s apart", f"{sum(found.genuine):,} of one object, {sum(found.impostor):,} of two"],
        ["equal error rate", f"{found.equal_error_rate:.3f} at distance {found.equal_error_distance:.2f}"],
        ["area under the ROC curve", f"{found.roc_auc:.3f}"],
    ]
    if found.threshold:
        said = f"accepts {found.accepted:.1%} of the pairs of two objects, refuses {found.rejected:.1%} of those of one"
        rows.append([f"at the match threshold {found.threshold:.2f}", said])
    about = (
        f"Distances of descriptors that {found.model} gives to true objects it finds. Blue, solid: two boxes of one "
        "object; orange, dashed: of two objects. The less they overlap, the better."
    )
    return element(
        "section",
        heading,
        element("p", about, class_="note"),
        distance_chart(found),
        scrolled(table(["what", "measured"], rows, texts=(1,)), "Descriptors"),
        aria_labelledby="descriptors",
    )


def _footer(report: Report) -> Fragment:
    parts: list[Content] = [element("h2", "About this page", id="about")]
    for run, facts in report.runs.items():
        if facts:
            pairs = [joined(element("dt", name), element("dd", value)) for name, value in facts.items()]
            parts += [element("h3", f"How run {run} was made"), element("dl", *pairs)]
    if report.sources:
        rows: list[list[Content]] = [[name, digest] for name, digest in report.sources.items()]
        content = scrolled(table(["file", "SHA-256"], rows, texts=(1,)), "Files")
        parts.append(element("details", element("summary", "Files that this page rests on"), content))
    parts.append(
        element("p", f"lookonce {report.version}. Frames count from 0. This file needs no network.", class_="note")
    )
    return element("footer", *parts)
