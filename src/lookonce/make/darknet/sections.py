"""Darknet cfg text as sections of checked options: the reading, without any meaning of layers."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from lookonce.errors import FormatError

__all__ = ["Section", "read_sections"]

_MAX_BYTES = 1 << 20  # the largest official cfg has 15 kB
_MAX_SECTIONS = 2000
_MAX_LIST = 1000


@dataclass(slots=True)
class Section:
    """One ``[name]`` with its ``key=value`` lines; every read checks the value and marks the key as known."""

    path: str
    name: str
    line: int
    options: dict[str, tuple[str, int]] = field(default_factory=dict)
    _known: set[str] = field(default_factory=set)

    def fail(self, message: str, key: str | None = None) -> FormatError:
        """The error to raise for this section, or for one key of it."""
        line = self.options[key][1] if key in self.options else self.line
        return FormatError(self.path, line, f"[{self.name}] {message}")

    def integer(self, key: str, default: int | None, low: int, high: int) -> int:
        """The whole number at ``key`` in ``low..high``; without a default the key must be there."""
        text = self._text(key, None if default is None else str(default))
        return self._integer(key, text, low, high)

    def integers(self, key: str, low: int, high: int) -> tuple[int, ...]:
        """The comma-separated whole numbers at ``key``."""
        return tuple(self._integer(key, text, low, high) for text in self._list(key))

    def number(self, key: str, default: float, low: float, high: float) -> float:
        """The number at ``key`` in ``low..high``."""
        return self._number(key, self._text(key, str(default)), low, high)

    def numbers(self, key: str, low: float, high: float) -> tuple[float, ...]:
        """The comma-separated numbers at ``key``."""
        return tuple(self._number(key, text, low, high) for text in self._list(key))

    def choice(self, key: str, default: str, choices: Sequence[str]) -> str:
        """The word at ``key``, which must be one of ``choices``."""
        text = self._text(key, default)
        if text not in choices:
            raise self.fail(f"{key}={text}: expected one of {', '.join(choices)}", key)
        return text

    def has(self, key: str) -> bool:
        """Whether the section holds ``key``."""
        return key in self.options

    def finish(self, ignored: Sequence[str]) -> None:
        """Raise for the first key that was neither read nor is in ``ignored`` (keys that matter to training only)."""
        known = self._known | set(ignored)
        for key, (_, line) in self.options.items():
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1)
                hint = f"; did you mean {near[0]}?" if near else ", or one that lookonce does not support"
                raise FormatError(self.path, line, f"[{self.name}] unknown key '{key}'{hint}")

    def _text(self, key: str, default: str | None) -> str:
        self._known.add(key)
        if key in self.options:
            return self.options[key][0]
        if default is None:
            raise self.fail(f"needs the key '{key}'")
        return default

    def _list(self, key: str) -> list[str]:
        parts = [part.strip() for part in self._text(key, None).split(",")]
        if parts[-1] == "":  # a comma at the end is common in cfg files
            parts.pop()
        if not 0 < len(parts) <= _MAX_LIST:
            raise self.fail(f"{key}: expected 1 to {_MAX_LIST} values, got {len(parts)}", key)
        return parts

    def _integer(self, key: str, text: str, low: int, high: int) -> int:
        try:
            value = int(text)
        except ValueError as exc:
            raise self.fail(f"{key}={text[:40]}: expected a whole number", key) from exc
        if not low <= value <= high:
            raise self.fail(f"{key}={value}: expected {low} to {high}", key)
        return value

    def _number(self, key: str, text: str, low: float, high: float) -> float:
        try:
            value = float(text)
        except ValueError as exc:
            raise self.fail(f"{key}={text[:40]}: expected a number", key) from exc
        if not (math.isfinite(value) and low <= value <= high):
            raise self.fail(f"{key}={text[:40]}: expected {low:g} to {high:g}", key)
        return value


def read_sections(path: Path) -> list[Section]:
    """The sections of a cfg file in order.

    Raises:
        FormatError: the file cannot be read as a cfg; path and line are named.
    """
    sections: list[Section] = []
    for number, raw in enumerate(_read_text(path).splitlines(), start=1):
        line = raw.split("#", 1)[0].split(";", 1)[0].strip()
        if not line:
            continue
        if line.startswith("["):
            if not line.endswith("]") or len(line) > 60:
                raise FormatError(path, number, f"expected a section like [convolutional], got '{line[:40]}'")
            sections.append(Section(str(path), line[1:-1].strip().lower(), number))
            if len(sections) > _MAX_SECTIONS:
                raise FormatError(path, number, f"more than {_MAX_SECTIONS} sections")
        else:
            _add_option(path, sections, number, line)
    if not sections:
        raise FormatError(path, 0, "no [section] found; is this a Darknet cfg file?")
    return sections


def _read_text(path: Path) -> str:
    try:
        with open(path, "rb") as file:
            raw = file.read(_MAX_BYTES + 1)
    except OSError as exc:
        raise FormatError(path, 0, f"cannot read the cfg file ({exc.strerror}); check the path") from exc
    if len(raw) > _MAX_BYTES:
        raise FormatError(path, 0, f"larger than {_MAX_BYTES} bytes; is this a Darknet cfg file?")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as exc:
        raise FormatError(path, 0, "not text; is this a Darknet cfg file?") from exc


def _add_option(path: Path, sections: list[Section], number: int, line: str) -> None:
    key, equals, value = (part.strip() for part in line.partition("="))
    if not equals or not key or not value:
        raise FormatError(path, number, f"expected key=value, got '{line[:40]}'")
    if not sections:
        raise FormatError(path, number, "a key before the first [section]")
    if key in sections[-1].options:
        raise FormatError(path, number, f"[{sections[-1].name}] key '{key}' is given twice")
    sections[-1].options[key] = (value, number)
