"""The trials of a search on disk, a line each: whatever happens, those that are done are kept."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from lookonce.errors import FormatError, OutputError
from lookonce.interrupts import interrupts_deferred
from lookonce.tuning.ranges import SearchRange

__all__ = ["Trial", "TrialFile"]

_FORMAT = {"format": "lookonce-tuning", "format_version": 1}
_MAX_BYTES = 64 << 20
_LARGEST = 1e9
_CUT = "remove this line and those after it"
_NOT_OURS = "not a search of `lookonce tune`; give another folder with -o, or --overwrite"


@dataclass(frozen=True, slots=True)
class Trial:
    """Values of settings by name, and how good they are: larger is better."""

    values: Mapping[str, float]
    score: float


class TrialFile:
    """A file whose first line says what is searched, and every other one is a trial.

    Args:
        path: the file.
        about: all that scores depend on; a file about something else is refused.
        ranges: what is searched.
        resumes: go on with the trials of an existing file; else it is replaced.

    Attributes:
        path: the file.
        trials: those so far.

    Raises:
        OutputError: the file cannot be read or written, or is that of another search.
        FormatError: it is no such file.
    """

    def __init__(
        self, path: Path, about: Mapping[str, object], ranges: Sequence[SearchRange], *, resumes: bool
    ) -> None:
        self.path = path
        self.trials: list[Trial] = []
        self._ranges = tuple(ranges)
        header = {**_FORMAT, **about}
        if resumes and path.exists():
            self._read(header)
        else:
            self._write(header, "wb")

    def append(self, trial: Trial) -> None:
        """One more trial, on the disk when this returns.

        Raises:
            OutputError: it cannot be written; the trials before it are.
        """
        with interrupts_deferred():
            self._write({"score": trial.score, "values": dict(trial.values)}, "ab")
            self.trials.append(trial)

    def _write(self, record: Mapping[str, object], mode: str) -> None:
        try:
            with open(self.path, mode) as file:
                file.write(json.dumps(record, allow_nan=False).encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as exc:
            raise OutputError(f"{self.path}: cannot be written ({exc.strerror}); --resume goes on from here") from exc

    def _read(self, header: Mapping[str, object]) -> None:
        """The trials of the file; a last line that was not finished is cut off."""
        try:
            with open(self.path, "rb") as file:
                data = file.read(_MAX_BYTES + 1)
        except OSError as exc:
            raise OutputError(f"{self.path}: cannot be read ({exc.strerror}); check it") from exc
        if len(data) > _MAX_BYTES:
            raise FormatError(self.path, 0, f"larger than {_MAX_BYTES >> 20} MB; {_NOT_OURS}")
        whole = data[: data.rfind(b"\n") + 1]
        lines = whole.split(b"\n")[:-1]
        if not lines:
            raise FormatError(self.path, 1, f"no whole line; {_NOT_OURS}")
        self._check_header(header, _parse(self.path, 1, lines[0]))
        self.trials = [self._trial(number, _parse(self.path, number, line)) for number, line in enumerate(lines[1:], 2)]
        if len(whole) < len(data):
            try:
                os.truncate(self.path, len(whole))
            except OSError as exc:
                raise OutputError(f"{self.path}: cannot be written ({exc.strerror}); check it") from exc

    def _check_header(self, wanted: Mapping[str, object], found: Mapping[str, object]) -> None:
        if any(found.get(name) != value for name, value in _FORMAT.items()):
            raise FormatError(self.path, 1, _NOT_OURS)
        plain = json.loads(json.dumps(wanted))
        other = [name for name in plain if found.get(name) != plain[name]]
        if other:
            shown = [f"{name.replace('_', ' ')}{_both(found.get(name), plain[name])}" for name in other]
            remedy = "give the same, another folder with -o, or --overwrite"
            raise OutputError(f"{self.path}: a search of other {', '.join(shown)}; {remedy}")

    def _trial(self, line: int, record: Mapping[str, object]) -> Trial:
        score, values = record.get("score"), record.get("values")
        if not (_is_number(score) and isinstance(values, dict) and values.keys() == {one.name for one in self._ranges}):
            raise FormatError(self.path, line, f"expected a score and a value for each setting; {_CUT}")
        for one in self._ranges:
            value = values[one.name]
            if not (_is_number(value) and one.low <= value <= one.high and one.tidy(value) == value):
                expected = f"expected a value of {one.low:g} to {one.high:g} as they were tried"
                raise FormatError(self.path, line, f"{one.name}: {expected}; {_CUT}")
        return Trial({one.name: one.tidy(values[one.name]) for one in self._ranges}, float(cast(float, score)))


def _parse(path: Path, line: int, data: bytes) -> dict[str, Any]:
    try:
        record = json.loads(data)
    except (ValueError, RecursionError) as exc:  # not JSON, not text, or a number of too many digits
        raise FormatError(path, line, f"not JSON; {_NOT_OURS}") from exc
    if not isinstance(record, dict):
        raise FormatError(path, line, _NOT_OURS)
    return record


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _both(found: object, wanted: object) -> str:
    """Two values that differ, where they can be said shortly."""
    is_short = all(isinstance(one, (str, int, float)) and len(str(one)) <= 20 for one in (found, wanted))
    return f" ({found} there, {wanted} here)" if is_short else ""
