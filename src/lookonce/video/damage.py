"""What a broken file cost, in one line for the user."""

from __future__ import annotations

import re
from pathlib import Path

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from lookonce.video.truncation import declared_size

__all__ = ["Damage", "early_end", "promised_length_s"]

_MAX_CONSECUTIVE_ERRORS = 100
_SLACK_BYTES = 16  # writers that count a header or a padding byte wrongly
_SLACK_S = 2.0
_SLACK_GAPS = 10.0  # a header counts how long the last frame is shown; nobody knows whether it was meant to be so long
_DURATION_TAG = re.compile(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)")


class Damage:
    """Numbers the frames of one pass and keeps account of those that were lost.

    A packet that cannot be decoded still takes a number, so that the frames after it keep theirs.

    Attributes:
        last_s: time of the last good frame in seconds; None before the first.
        longest_gap_s: the longest time between two good frames.
        reason: what the first error was, in words; None without errors.
        cut: how the file ends too early; None if it does not, or was not read to its end.
        estimated_times: how many time stamps were missing or went back.
    """

    def __init__(self, shown: str, first_index: int = 0) -> None:
        self.shown = shown
        self.last_s: float | None = None
        self.longest_gap_s = 0.0
        self.reason: str | None = None
        self.cut: str | None = None
        self.estimated_times = 0
        self._next_index = first_index
        self._last_index = first_index
        self._last_before_error: str | None = None
        self._errors = self._consecutive = 0

    def decoded(self, time_s: float) -> int:
        """The number of the good frame that is shown at ``time_s``."""
        if self.last_s is not None:
            self.longest_gap_s = max(self.longest_gap_s, time_s - self.last_s)
        self.last_s = time_s
        self._last_index = self._next_index
        self._next_index += 1
        self._consecutive = 0
        return self._last_index

    def failed(self, reason: str, *, lost_frame: bool) -> None:
        """Counts an error; ``lost_frame`` if a frame went with it."""
        if self.reason is None:
            self.reason, self._last_before_error = reason, self._last_good()
        self._errors += 1
        self._consecutive += 1
        self._next_index += lost_frame

    @property
    def is_hopeless(self) -> bool:
        """Whether too many errors came in a row to go on."""
        return self._consecutive >= _MAX_CONSECUTIVE_ERRORS

    def summary(self) -> list[str]:
        """One line for each kind of damage; empty for a good file and for one without any good frame."""
        if self.last_s is None:
            return []
        lines = []
        if self.cut is not None or self._consecutive:
            reason = self.cut or self.reason
            lines.append(f"{self.shown}: broken after {self._last_good()}: {reason}; the frames before it were used")
        recovered = self._errors - self._consecutive
        if recovered:
            where = f"after {self._last_before_error}" if self._last_before_error else "at its start"
            lines.append(
                f"{self.shown}: damaged {where}: {recovered} piece{'s' * (recovered > 1)} could not be decoded "
                f"({self.reason}); the other frames were used"
            )
        if self.estimated_times:
            lines.append(f"{self.shown}: {self.estimated_times} frames have no usable time stamp; theirs are estimated")
        return lines

    def _last_good(self) -> str | None:
        return None if self.last_s is None else f"frame {self._last_index} ({self.last_s:.2f} s)"


def early_end(path: Path | None, damage: Damage, promised_s: float | None) -> str | None:
    """How a file that was read to its end falls short of what it declares; None if it does not."""
    if path is None or not path.is_file():
        return None
    declared, actual = declared_size(path), path.stat().st_size
    if declared is not None and declared > actual + _SLACK_BYTES:
        return f"the file is cut short, {actual} of {declared} bytes"
    if promised_s is None or damage.last_s is None:
        return None
    missing_s = promised_s - damage.last_s
    if missing_s > max(_SLACK_S, _SLACK_GAPS * damage.longest_gap_s):
        return f"the file's header promises {promised_s:.1f} s"
    return None


def promised_length_s(container: InputContainer, stream: VideoStream) -> float | None:
    """How long the header says that the video is; None where headers do not say it reliably.

    MP4 is not asked: edit lists shorten what is shown, and its index names every frame anyway. A length of the whole
    container is used only where the video is its only stream, since sound often lasts longer.
    """
    formats = set(container.format.name.split(","))
    if "avi" in formats and stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    if "matroska" not in formats:
        return None
    tag = _DURATION_TAG.match(stream.metadata.get("DURATION", ""))
    if tag:
        hours, minutes, seconds = tag.groups()
        return int(hours) * 3600 + int(minutes) * 60 + float(seconds)
    if len(container.streams) == 1 and container.duration:
        return container.duration / av.time_base
    return None
