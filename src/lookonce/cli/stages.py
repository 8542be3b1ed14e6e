"""Progress of work in stages on stderr: on a terminal a bar, elsewhere a line now and then and one at each end."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

__all__ = ["StageScreen"]

_LINE_EVERY_S = 30.0


class StageScreen:
    """Shows one stage after the other; use it in a ``with`` block."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[note]}", markup=False),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._name = ""
        self._task: TaskID | None = None
        self._latest = ""  # what is to be said of the stage when it ends
        self._last_line_s = 0.0

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self._end_stage()
        self._progress.stop()

    def stage(self, name: str, done: int, total: int | None, note: str = "") -> None:
        """So much of a stage is done; another name, or a finding, ends the stage before."""
        if self._task is None or name != self._name:
            self._end_stage()
            self._name, self._last_line_s = name, time.monotonic()
            self._task = self._progress.add_task(name, total=total, note=note)
        self._progress.update(self._task, completed=done, total=total, note=note)
        of = f" of {total}" if total is not None else ""
        self._latest = f"{name}: {done}{of}{f', {note}' if note else ''}"
        if time.monotonic() - self._last_line_s >= _LINE_EVERY_S and done != total:
            self._last_line_s = time.monotonic()
            self._print_where_no_bar_is(self._latest)

    def say(self, text: str) -> None:
        """A finding that stays on the screen."""
        self._end_stage()
        self._console.print(text, soft_wrap=True, markup=False, highlight=False)

    def _end_stage(self) -> None:
        if self._task is not None:
            self._print_where_no_bar_is(self._latest)
        self._task = None

    def _print_where_no_bar_is(self, text: str) -> None:
        if not self._console.is_terminal:
            self._console.print(text, soft_wrap=True, markup=False, highlight=False)
