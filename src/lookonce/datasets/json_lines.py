"""Files of JSON lines with a header, read with care: bounded, strict about types, deaf to fields it does not know."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from lookonce.boxes import FARTHEST_PX
from lookonce.datasets.text import LARGEST_WHOLE, fault, quoted, read_text
from lookonce.datasets.track_rows import MAX_FRAMES
from lookonce.errors import FormatError

__all__ = ["Record", "read_records"]

_MAX_LINE_BYTES = 10_000_000  # a frame of 100,000 boxes
_MAX_BYTES = 400_000_000  # an explained hour of a street
_LONGEST_TEXT = 1000
_MOST_ITEMS = 100_000  # of a list


@dataclass(frozen=True, slots=True)
class Record:
    """A JSON object and where it stands; each field is checked when it is asked for, and None where it is absent."""

    path: Path
    line: int
    fields: dict[str, Any]

    def bad(self, name: str, expected: str) -> FormatError:
        """The error for a field."""
        got = quoted(json.dumps(self.fields.get(name)))
        return fault(self.path, self.line, f"{name}: expected {expected}, got {got}; mend or remove the line")

    def whole(self, name: str, largest: float = LARGEST_WHOLE) -> int | None:
        """A whole number from 0."""
        value = self.fields.get(name)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= largest:
            raise self.bad(name, "a whole number from 0")
        return value

    def frame(self) -> int:
        """The field ``frame``, which must be there."""
        frame = self.whole("frame", MAX_FRAMES)
        if frame is None:
            raise self.bad("frame", f"0 to {MAX_FRAMES:,}")
        return frame

    def number(self, name: str) -> float | None:
        """A finite number."""
        value = self.fields.get(name)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST_WHOLE:
            raise self.bad(name, "a number")
        return float(value)

    def text(self, name: str) -> str | None:
        """A text; of a very long one the start."""
        value = self.fields.get(name)
        if value is None:
            return None
        if not isinstance(value, str):
            raise self.bad(name, "a text")
        return value[:_LONGEST_TEXT]

    def box(self, name: str = "xyxy") -> tuple[float, float, float, float] | None:
        """Four numbers, left <= right and top <= bottom; None also where one of them was not finite (null)."""
        value = self.fields.get(name)
        if value is None:
            return None
        if not isinstance(value, list) or len(value) != 4:
            raise self.bad(name, "four numbers")
        if None in value:
            return None
        if not all(isinstance(one, int | float) and not isinstance(one, bool) for one in value):
            raise self.bad(name, "four numbers")
        left, top, right, bottom = (float(one) if abs(one) <= LARGEST_WHOLE else math.inf for one in value)
        if not (max(map(abs, (left, top, right, bottom))) <= FARTHEST_PX and left <= right and top <= bottom):
            raise self.bad(name, "left <= right and top <= bottom, near the picture")
        return left, top, right, bottom

    def record(self, name: str) -> Record:
        """An object; without it one without fields."""
        value = self.fields.get(name, {})
        if not isinstance(value, dict):
            raise self.bad(name, "an object")
        return Record(self.path, self.line, value)

    def records(self, name: str) -> list[Record]:
        """A list of objects; empty where it is absent."""
        value = self.fields.get(name, [])
        if not isinstance(value, list) or len(value) > _MOST_ITEMS or not all(isinstance(one, dict) for one in value):
            raise self.bad(name, f"a list of at most {_MOST_ITEMS:,} objects")
        return [Record(self.path, self.line, one) for one in value]


def read_records(path: Path, kind: str, version: int) -> tuple[Record, Iterator[Record]]:
    """The header of a file and its other lines, each parsed when its turn comes.

    Args:
        path: the file.
        kind: what the header must call its ``format``.
        version: and its ``format_version``.

    Raises:
        FormatError: it is missing, too large, no such file or of another version; later, a line breaks its format.
    """
    lines = read_text(path, _MAX_BYTES, _MAX_LINE_BYTES).split("\n")
    header = _parsed(path, 1, lines[0]) if lines[0].strip() else Record(path, 1, {})
    if header.fields.get("format") != kind:
        raise fault(path, 1, f'expected a header with "format": "{kind}"; give a file that lookonce track wrote')
    if header.fields.get("format_version") != version:
        message = f"format_version: expected {version}; use the lookonce that wrote it, or track again"
        raise fault(path, 1, message)
    return header, (_parsed(path, number, line) for number, line in enumerate(lines[1:], 2) if line.strip())


def _parsed(path: Path, number: int, line: str) -> Record:
    def refuse(word: str) -> NoReturn:
        raise ValueError(word)

    try:
        fields = json.loads(line, parse_constant=refuse)
    except (ValueError, RecursionError):
        raise fault(path, number, f"no JSON, or cut short: {quoted(line)}; mend or remove the line") from None
    if not isinstance(fields, dict):
        raise fault(path, number, f"expected a JSON object, got {quoted(line)}; mend or remove the line")
    return Record(path, number, fields)
