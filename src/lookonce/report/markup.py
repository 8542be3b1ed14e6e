"""Markup as values: text is escaped wherever it enters, so that no name of a file or class becomes a tag."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from lookonce.video.opening import one_line

__all__ = ["Content", "Fragment", "data_uri", "element", "joined", "raw", "short"]

_VOID: Final = frozenset({"br", "hr", "img", "input", "link", "meta"})
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9:-]*")
_LONG = frozenset({"content", "d", "href"})  # attributes that only this package writes, and that are long
_LONGEST_TEXT = 2000  # of one piece of text; whatever is longer came from a hostile file


@dataclass(frozen=True, slots=True)
class Fragment:
    """Finished markup; made by ``element``, ``joined`` and, for what is ours, ``raw``."""

    text: str


Content = Fragment | str | int | None | Iterable["Content"]
"""What may stand in an element: markup, text (which is escaped), nothing, or several of these."""


def element(tag: str, *content: Content, **attributes: str | float | bool | None) -> Fragment:
    """An element of HTML or SVG.

    Args:
        tag: its name.
        content: what is in it; text is escaped, characters that do not print are shown as Python writes them.
        attributes: a name's final ``_`` is dropped and other ``_`` become ``-``; None and False leave it out, True is
            an attribute without value.

    >>> element("p", "a < b", element("b", 3), class_="x", hidden=True).text
    '<p class="x" hidden>a &lt; b<b>3</b></p>'
    """
    if not _NAME.fullmatch(tag):
        raise ValueError(f"tag: expected a name, got {tag!r}")
    start = "".join([tag, *(_attribute(name, value) for name, value in attributes.items())])
    if tag in _VOID:
        return Fragment(f"<{start}>")
    return Fragment(f"<{start}>{''.join(_texts(content))}</{tag}>")


def joined(*content: Content) -> Fragment:
    """Several pieces as one."""
    return Fragment("".join(_texts(content)))


def raw(text: str) -> Fragment:
    """Text that is markup already: only for what this package itself wrote."""
    return Fragment(text)


def short(text: object, longest: int = 80) -> str:
    """``text`` on one line and not longer than so many characters.

    >>> short("a long name", 6)
    'a lon…'
    """
    line = one_line(str(text)[: 2 * longest])
    return line if len(line) <= longest and len(str(text)) <= 2 * longest else f"{line[: longest - 1]}…"


def data_uri(kind: str, data: bytes) -> str:
    """A file inside the page, such as ``data_uri("image/png", ...)``."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _texts(content: Content) -> Iterable[str]:
    if isinstance(content, Fragment):
        yield content.text
    elif isinstance(content, str):
        yield _escaped(content)
    elif isinstance(content, int):
        yield str(content)
    elif content is not None:
        for one in content:
            yield from _texts(one)


def _escaped(text: str) -> str:
    return html.escape(short(text, _LONGEST_TEXT), quote=True)


def _attribute(name: str, value: str | float | bool | None) -> str:
    if value is None or value is False:
        return ""
    name = name.removesuffix("_").replace("_", "-")
    if not _NAME.fullmatch(name):
        raise ValueError(f"attribute: expected a name, got {name!r}")
    if value is True:
        return f" {name}"
    if isinstance(value, str):
        text = html.escape(one_line(value)) if name in _LONG else _escaped(value)
        return f' {name}="{text}"'
    return f' {name}="{_number(value)}"'


def _number(value: float) -> str:
    """At most two decimals.

    >>> _number(2.0), _number(0.125), _number(-0.001)
    ('2', '0.12', '0')
    """
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text
