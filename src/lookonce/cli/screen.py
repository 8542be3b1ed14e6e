"""What a run shows on the screen: progress while it goes, a table when it ends."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from lookonce.pipeline import StageTimes, TrackedFrame
from lookonce.structures import class_name
from lookonce.video import VideoSource
from lookonce.video.opening import one_line

__all__ = ["RunScreen"]

_LINE_EVERY_S = 30.0
_MOST_CLASSES = 12


class RunScreen:
    """One run: progress on stderr, the closing table on stdout."""

    def __init__(self, video: VideoSource, times: StageTimes, described: str = "", names: Sequence[str] = ()) -> None:
        self.video = video
        self.described = described  # where descriptors come from, if not with the boxes
        self.times = times
        self.names = names  # of classes, by label
        self.identities = 0  # so many so far: the highest
        self._classes: Counter[int] = Counter()  # of these, each as it was when confirmed
        self.seconds = 0.0
        self.passed_over = 0  # frames that an earlier run has tracked
        self.last_index: int | None = None  # of the last frame that was tracked, from 0

    def follow(self, frames: Iterator[TrackedFrame]) -> None:
        """Consume the frames, showing progress on stderr: a bar on a terminal, a line now and then elsewhere."""
        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]:.1f} fps"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        start, last_line_s = time.perf_counter(), 0.0
        with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
            task = progress.add_task(self.video.name, total=self.video.frame_count, rate=0.0)
            try:
                for frame in frames:
                    self._count(frame)
                    self.seconds = time.perf_counter() - start
                    progress.update(task, advance=1, rate=self.times.frames / self.seconds)
                    if not console.is_terminal and self.seconds - last_line_s >= _LINE_EVERY_S:
                        last_line_s = self.seconds
                        console.print(self._line(), soft_wrap=True, markup=False)
            finally:
                self.seconds = time.perf_counter() - start

    def _line(self) -> str:
        """Progress in one line, such as ``traffic: 1200 of 9000 frames, 58.1 fps, 134 s left``."""
        done, total, rate = self.times.frames, self.video.frame_count, self.times.frames / self.seconds
        if not total:
            return f"{self.video.name}: {done} frames, {rate:.1f} fps"
        return f"{self.video.name}: {done} of {total} frames, {rate:.1f} fps, {max(0, total - done) / rate:.0f} s left"

    def _count(self, frame: TrackedFrame) -> None:
        self.last_index = frame.index
        new = frame.tracks.ids > self.identities
        if new.any():
            self._classes.update(frame.tracks.labels[new].tolist())
            self.identities = int(frame.tracks.ids.max())

    def _identities(self) -> str:
        """How many, and of which classes, such as ``59: 57 car, 2 truck``; of the rest of a run only how many."""
        if len(self.names) < 2 or not self._classes or self.passed_over:
            return str(self.identities)
        found = [
            f"{count} {class_name(self.names, label)}" for label, count in self._classes.most_common(_MOST_CLASSES)
        ]
        return f"{self.identities}: {one_line(', '.join(found))}"

    def print_summary(self, files: list[Path], is_stopped: bool = False) -> None:
        """One table: frames, frames a second of each stage, identities, files, and whether the run can go on."""
        table = Table(title=Text(self.video.name), show_header=False, title_justify="left")
        rate = self.times.frames / self.seconds if self.seconds else 0.0
        earlier = f", going on after frame {self.passed_over}" if self.passed_over else ""
        table.add_row("frames", f"{self.times.frames} in {self.seconds:.1f} s, {rate:.1f} fps{earlier}")
        for stage, seconds in self.times.seconds.items():
            if seconds > 0:
                each = seconds / max(1, self.times.frames)
                side_by_side = self.times.workers if stage == "detect" else 1
                note = f", {side_by_side} at once" if side_by_side > 1 else ""
                table.add_row(stage, f"{side_by_side / each:.1f} fps ({each * 1000:.2f} ms a frame{note})")
        if self.described:
            table.add_row("descriptors", Text(self.described))
        table.add_row("identities", Text(self._identities()))
        for path in files:
            table.add_row("written", Text(str(path)))
        if is_stopped:
            table.add_row("stopped", "not at the end: the same command with --resume goes on")
        Console().print(table)
