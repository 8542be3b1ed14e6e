"""Markup: whatever a file is called, it stays text."""

from __future__ import annotations

import pytest

from lookonce.report.markup import element, joined, raw, short

HOSTILE = "<script>alert(1)</script>\"'&\x00\u202e\n"


def test_text_and_attributes_are_escaped():
    made = element("p", HOSTILE, title=HOSTILE).text
    assert made.count("<") == 2  # its own two tags
    inner = made.removeprefix('<p title="').removesuffix("</p>")
    assert "'" not in inner
    assert inner.count('"') == 1
    assert made.isprintable()


def test_markup_is_not_escaped_again():
    assert element("p", element("b", "a & b"), joined("<", 3, None, ["x", raw("<br>")])).text == (
        "<p><b>a &amp; b</b>&lt;3x<br></p>"
    )


def test_numbers_are_short_and_none_is_left_out():
    made = element("rect", x=0.123456, y=-0.0001, width=3.0, class_=None, hidden=True, disabled=False).text
    assert made == '<rect x="0.12" y="0" width="3" hidden></rect>'


def test_long_text_is_cut_but_a_path_is_not():
    assert len(element("p", "x" * 100_000).text) < 3000
    assert len(element("p", title="x" * 100_000).text) < 3000
    path = "M" + "L1 2" * 5000
    assert element("path", d=path).text == f'<path d="{path}"></path>'
    assert short("x" * 1000) == "x" * 79 + "…"


def test_names_that_are_none_are_refused():
    with pytest.raises(ValueError, match="tag"):
        element("p onclick=x")
    with pytest.raises(ValueError, match="attribute"):
        element("p", **{"a b": 1})
