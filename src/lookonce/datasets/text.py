"""Text files of other programs: bounded, and numbers read fast; a faulty line is looked for only when there is one."""

from __future__ import annotations

import io
from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import FormatError
from lookonce.video.opening import one_line

__all__ = [
    "LARGEST_WHOLE",
    "MAX_FILE_BYTES",
    "MAX_ROWS",
    "Table",
    "check_size",
    "fault",
    "quoted",
    "read_table",
    "read_text",
    "whole",
]

# No file of a known data set comes near these; a larger one is a mistake or made to exhaust the memory.
MAX_FILE_BYTES = 200_000_000
MAX_ROWS = 5_000_000
_MAX_LINE_BYTES = 10_000
LARGEST_WHOLE = 2.0**53  # above, float64 does not tell neighbours apart
_SEPARATORS = {",": "commas", ";": "semicolons", None: "blanks"}


def fault(path: Path, line: int, message: str) -> FormatError:
    """The error for a line of a file (0 = no certain line), on one line whatever the file is called."""
    return FormatError(one_line(path), line, message)


def quoted(text: str) -> str:
    """``text`` for messages: in quotes, printable and short.

    >>> quoted("x" * 100) == "'" + "x" * 40 + "...'"
    True
    """
    return f"'{one_line(text[:40])}{'...' if len(text) > 40 else ''}'"


def check_size(path: Path, max_bytes: int) -> None:
    """Raise ``FormatError`` unless ``path`` is a file of at most ``max_bytes``."""
    if not path.is_file():
        raise fault(path, 0, "no such file; check the spelling")
    if path.stat().st_size > max_bytes:
        raise fault(path, 0, f"larger than {max_bytes // 1_000_000} MB; split it, or check that it is the right file")


def read_text(path: Path, max_bytes: int | None = None, max_line_bytes: int = _MAX_LINE_BYTES) -> str:
    r"""A whole UTF-8 file, its line ends as ``\n``.

    Raises:
        FormatError: it is missing, not text, too large, or has too many or too long lines.
    """
    max_bytes = MAX_FILE_BYTES if max_bytes is None else max_bytes
    try:
        check_size(path, max_bytes)
        data = path.read_bytes()
    except OSError as exc:
        raise fault(path, 0, f"cannot be read ({exc.strerror}); check its permissions") from exc
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\0" in data:
        raise fault(path, 0, "binary or UTF-16, not a UTF-8 text; check that it is the right file")
    _check_lines(path, data, max_line_bytes)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as exc:
        raise fault(path, data.count(b"\n", 0, exc.start) + 1, "not UTF-8 text; save the file as UTF-8") from exc


def _check_lines(path: Path, data: bytes, max_line_bytes: int) -> None:
    if len(data) <= max_line_bytes:
        return
    ends = np.flatnonzero(np.frombuffer(data, np.uint8) == ord("\n"))
    if len(ends) > MAX_ROWS:
        raise fault(path, 0, f"more than {MAX_ROWS:,} lines; split it into sequences")
    lengths = np.diff(ends, prepend=-1, append=len(data)) - 1
    longest = int(lengths.argmax())
    if lengths[longest] > max_line_bytes:
        raise fault(path, longest + 1, f"a line of more than {max_line_bytes:,} bytes; check that it is the right file")


@dataclass(frozen=True, slots=True)
class Table:
    """Numbers of a text file.

    Attributes:
        path: the file.
        values: (R, C) float64, a row a line that is not blank; may hold NaN and infinity if the file says so.
        lines: (R,) int64, each row's line in the file, from 1.
    """

    path: Path
    values: NDArray[np.float64]
    lines: NDArray[np.int64]

    def check(self, is_right: NDArray[np.bool_], column: int, expected: str) -> None:
        """Raise ``FormatError`` for the first row that is not right.

        Args:
            is_right: (R,) bool.
            column: the column at fault, from 0.
            expected: what the number should be, and the remedy.
        """
        if not is_right.all():
            row = int(is_right.argmin())
            raise fault(self.path, int(self.lines[row]), f"{expected}, got {self.values[row, column]:.10g}")


def read_table(path: Path, columns: str, max_line_bytes: int = _MAX_LINE_BYTES) -> Table:
    """Reads a file of numbers, separated by commas, semicolons or blanks, the same way in every line.

    Args:
        path: the file; blank lines are skipped, an empty file gives 0 rows.
        columns: names of the columns that must be there, for messages; more may follow.
        max_line_bytes: the longest line that such a file can have.

    Raises:
        FormatError: as ``read_text``; a field is no number, or the lines differ in separator or number of columns.
    """
    text = read_text(path, max_line_bytes=max_line_bytes)
    least = columns.count(",") + 1
    first = text.lstrip().partition("\n")[0]
    if not first:
        return Table(path, np.zeros((0, least)), np.zeros(0, np.int64))
    separator = next((mark for mark in ",;" if mark in first), None)
    try:
        values = np.loadtxt(io.StringIO(text), delimiter=separator, comments=None, ndmin=2)
    except ValueError:
        values = _read_carefully(path, text, separator)
    lines = _line_numbers(text, len(values))
    if values.shape[1] < least:
        got = f"got {values.shape[1]} separated by {_SEPARATORS[separator]}"
        raise fault(path, int(lines[0]), f"expected at least {least} columns ({columns}), {got}")
    return Table(path, values, lines)


def _line_numbers(text: str, rows: int) -> NDArray[np.int64]:
    if rows == text.count("\n") + (not text.endswith("\n")):
        return np.arange(1, rows + 1)
    return np.array([number for number, line in enumerate(text.split("\n"), 1) if line.strip()], np.int64)


def _read_carefully(path: Path, text: str, separator: str | None) -> NDArray[np.float64]:
    """The numbers of a text that the fast way refused; raises for the first line that cannot be understood."""
    numbers, columns = array("d"), 0
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        if message := _separator_fault(line, separator):
            raise fault(path, number, message)
        row = [_number(path, number, column, text) for column, text in enumerate(line.split(separator), 1)]
        columns = columns or len(row)
        if len(row) != columns:
            raise fault(path, number, f"{len(row)} columns where the lines before have {columns}; mend the line")
        numbers.extend(row)
    return np.array(numbers).reshape(-1, columns)


def _separator_fault(line: str, separator: str | None) -> str:
    others = [mark for mark in ",;" if mark != separator and mark in line]
    if not others and (separator is None or separator in line):
        return ""
    other = _SEPARATORS[others[0] if others else None]
    return f"separated by {other} where the lines before have {_SEPARATORS[separator]}; use one separator throughout"


def _number(path: Path, line: int, column: int, text: str) -> float:
    try:
        if "_" in text:  # Python's digit groups are none of the format's
            raise ValueError
        return float(text)
    except ValueError:
        hint = "; remove the heading" if line == 1 else ""
        raise fault(path, line, f"expected a number in column {column}, got {quoted(text.strip())}{hint}") from None


def whole(numbers: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which ``numbers (R,)`` are whole, written as ``1`` or ``1.0``; (R,) bool, False for NaN and infinity.

    >>> whole(np.array([1.0, 1.5, np.nan, np.inf])).tolist()
    [True, False, False, False]
    """
    is_whole: NDArray[np.bool_] = (np.abs(numbers) <= LARGEST_WHOLE) & (np.floor(numbers) == numbers)
    return is_whole
