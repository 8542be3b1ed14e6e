"""The page: one file, nothing from outside, readable, every text escaped, the same bytes each time."""

from __future__ import annotations

import base64
import hashlib
import re
from collections import Counter
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pytest

from lookonce.report import Report, ScoreColumn, ScoreRow, ScoreTable, doubted_view, page_text, scored_view
from lookonce.report.curves import Detected, detection_curve
from lookonce.report.described import Descriptors
from lookonce.report.explained import Candidate, Explanation
from lookonce.report.spans import Clock
from report.scenes import explained, lines_of, make_result, make_truth

HOSTILE = "<script>alert('x')</script>\" onload=\"x\u202e"


class Reading(HTMLParser):
    """Tags with their attributes, the text of the page, and whether tags close in order."""

    VOID = ("meta", "br", "hr", "img", "input", "link")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("script", "style"):
            self.texts.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def a_report(name: str = "street", run: str = "first", **others: object) -> Report:
    truth = make_truth({1: list(range(12)), 2: list(range(4, 12))}, 14)
    result = make_result([(frame, 5 if frame < 6 else 8, 1) for frame in range(12)] + [(4, 9, 7)])
    lines = lines_of(result)
    told = explained(6, 8, name, Candidate(5, cost=0.5, refused=name), reason=name)
    views = tuple(
        scored_view(
            one,
            sequence,
            Clock({}, 25.0),
            truth,
            result,
            protocol="trackeval",
            classes=("car", name),
            lines=lines,
            explanation=told,
        )
        for sequence in (name, "second")
        for one in (run, "other")
    )
    columns = (ScoreColumn("HOTA", "both", True), ScoreColumn("IDSW", "switches", False))
    rows = tuple(
        ScoreRow(sequence, one, (f"{value:.1f}", "1"), (value, 1.0))
        for sequence in (name, "second", "")
        for one, value in ((run, 55.5), ("other", 44.4))
    )
    curve = detection_curve([Detected(truth, lines, np.ones(len(lines.ids), np.bool_))], "trackeval")
    fields: dict[str, object] = {
        "title": name,
        "version": "1.2.3",
        "truth": name,
        "runs": {run: {"source": name, name: "x"}, "other": {}},
        "sources": {name: "ab" * 32},
        "scores": ScoreTable("Protocol trackeval", columns, rows, ((run, name, 3), ("other", "why", 2)), (name,)),
        "views": views,
        "curves": {run: curve, "other": curve},
        "descriptors": Descriptors(name, 10, 50, 4, (0, 9) * 32, (4, 0) * 32, 0.1, 0.9, 0.95, 1.05, 0.2, 0.04),
        "notes": (name,),
    }
    return Report(**{**fields, **others})


@pytest.fixture(scope="module")
def page() -> Reading:
    return Reading(page_text(a_report()))


def test_hostile_names_stay_text():
    tame, text = Reading(page_text(a_report())), page_text(a_report(HOSTILE, HOSTILE))
    hostile = Reading(text)
    assert [tag for tag, _ in hostile.tags] == [tag for tag, _ in tame.tags]
    assert [sorted(attributes) for _, attributes in hostile.tags] == [sorted(attributes) for _, attributes in tame.tags]
    assert "<script>alert" not in text
    assert "\u202e" not in text
    assert any("<script>alert('x')" in one for one in hostile.texts)


def test_nothing_comes_from_outside(page):
    for tag, attributes in page.tags:
        assert tag not in ("link", "iframe", "object", "embed", "form", "base")
        assert not [name for name in attributes if name.startswith("on") or name == "style"]
        for name in ("src", "href"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:image/")), value
    text = page_text(a_report())
    assert not re.findall(r"https?://|url\(|@import", text)


def test_the_policy_allows_this_style_and_script_only():
    text = page_text(a_report())
    page = Reading(text)
    (policy,) = (one["content"] for one in page.all("meta") if one.get("http-equiv") == "Content-Security-Policy")
    parts = dict(part.strip().split(" ", 1) for part in policy.split(";"))
    assert parts["default-src"] == "'none'"
    for tag in ("style", "script"):
        (content,) = re.findall(rf"<{tag}>(.*?)</{tag}>", text, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert parts[f"{tag}-src"] == f"'sha256-{digest}'"
    assert "unsafe" not in policy


def test_the_same_report_gives_the_same_bytes():
    assert page_text(a_report()) == page_text(a_report())


def test_headings_tables_and_pictures_say_what_they_are(page):
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b <= a + 1 for a, b in pairwise(levels))
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert max(Counter(ids).values()) == 1
    targets = {one["href"][1:] for one in page.all("a") if one["href"]}
    assert targets <= set(ids)
    assert all(one.get("scope") in ("col", "row") for one in page.all("th"))
    for one in page.all("svg"):
        assert one.get("aria-hidden") == "true" or (one.get("role") == "img" and one.get("aria-label"))
    assert all(one.get("tabindex") == "0" and one.get("aria-label") for one in page.all("div") if one.get("role"))
    assert page.all("html")[0]["lang"] == "en"


def test_the_long_curve_is_drawn_to_its_end():
    rng = np.random.default_rng(0)
    count = 400
    truth = make_truth({one: [0] for one in range(1, count + 1)}, 1)
    result = make_result([(0, one, one) for one in range(1, count + 1)])
    lines = lines_of(result)
    curve = detection_curve([Detected(truth, lines, rng.random(count) < 2)], "trackeval")
    assert curve.recall[-1] == 1
    page = Reading(page_text(a_report(curves={"first": curve})))
    (path,) = (one["d"] for one in page.all("path") if "curve" in (one.get("class") or ""))
    assert path.endswith("L546.0 30.0")  # the upper right corner
    assert path.count("L") == 299


def test_the_better_of_two_runs_is_marked(page):
    best = [one for one in page.all("td") if "best" in (one.get("class") or "")]
    assert [one["data-v"] for one in best] == ["55.5"] * 3


def test_how_to_get_what_is_missing_is_said():
    text = page_text(a_report(descriptors=None, curves={}))
    assert "--model" in text
    assert 'href="#detections"' not in text
    nothing = Descriptors("m", 0, 0, 0, (0,) * 64, (0,) * 64, float("nan"), float("nan"), float("nan"), None, 0.0, 0.0)
    assert "nothing to compare" in page_text(a_report(descriptors=nothing))


def test_without_truth_there_are_identities_lengths_and_doubts():
    result = make_result([(0, 5, 1), (1, 5, 1), (3, 6, 1), (3, 7, 4)])
    view = doubted_view("run", "street", Clock({}), result, lines_of(result), None)
    text = page_text(a_report(scores=None, views=(view,), truth=""))
    page = Reading(text)
    assert "without truth" in text
    assert "Doubtful places (1)" in page.texts
    assert 'id="scores"' not in text
    assert "A guess from the boxes alone" in text
    rows = explained(3, 6, "new", Candidate(5, cost=0.4, refused="too far")).rows
    view = doubted_view("run", "street", Clock({}), result, lines_of(result), Explanation(rows))
    text = page_text(a_report(scores=None, views=(view,), truth=""))
    assert "too far" in text
    assert "What the tracker decided" in text
    assert "begins an object" in text


def test_no_boxes_at_all_make_a_page():
    truth, none = make_truth({1: [0, 1]}, 3), make_result([])
    view = scored_view(
        "run", "street", Clock({}), truth, none, protocol="detrac", classes=(), lines=lines_of(none), explanation=None
    )
    empty = doubted_view("run", "b", Clock({}), none, lines_of(none), None)
    text = page_text(a_report(views=(view, empty)))
    assert "No object changed its identity." in text
    assert "0 identities" in text
    Reading(text)
