"""What a broken file cost, in one line for the user."""

from __future__ import annotations

import heapq
import re
from pathlib import Path

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from lookonce.video.truncation import declared_size

__all__ = ["Damage", "early_end", "promised_length_s"]

_MAX_CONSECUTIVE_ERRORS = 100
_EARLIEST = -(1 << 63)  # before all stamps
_SLACK_BYTES = 16  # writers that count a header or a padding byte wrongly
_SLACK_S = 0.5
_SLACK_GAPS = 10.0  # a header counts how long the last frame is shown; nobody knows whether it was meant to be so long
_DURATION_TAG = re.compile(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)")


class Damage:
    """Numbers the frames of one pass and keeps account of those that were lost.

    A lost frame still takes a number, so that the frames after it keep theirs. Decoders give frames late and in
    another order than packets come; whether a loss lies before a frame is therefore told by their stamps.

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
        self._first_damage: str | None = None  # the last good frame before the first error that was got over
        self._errors = self._consecutive = 0
        self._pending: list[tuple[int, int]] = []  # heap of (stamp, frames lost): errors no frame came after yet

    def decoded(self, time_s: float, stamp: int | None) -> int:
        """The number of the good frame that is shown at ``time_s`` and has this stamp."""
        self._next_index += self.passed(stamp)
        if self.last_s is not None:
            self.longest_gap_s = max(self.longest_gap_s, time_s - self.last_s)
        self.last_s = time_s
        self._last_index = self._next_index
        self._next_index += 1
        return self._last_index

    def passed(self, stamp: int | None) -> int:
        """Notes that decoding got as far as a good frame; returns how many frames were lost since the one before."""
        self._consecutive = lost = 0
        while self._pending and (stamp is None or self._pending[0][0] <= stamp):
            if not self._errors:
                self._first_damage = self._last_good()
            self._errors += 1
            lost += heapq.heappop(self._pending)[1]
        return lost

    def failed(self, reason: str, stamp: int | None, *, lost_frame: bool) -> None:
        """Counts an error near ``stamp``; ``lost_frame`` if a frame went with it."""
        self.reason = self.reason or reason
        self._consecutive += 1
        heapq.heappush(self._pending, (_EARLIEST if stamp is None else stamp, int(lost_frame)))

    @property
    def is_hopeless(self) -> bool:
        """Whether too many errors came in a row to go on."""
        return self._consecutive >= _MAX_CONSECUTIVE_ERRORS

    def summary(self) -> list[str]:
        """One line for each kind of damage; empty for a good file and for one without any good frame."""
        if self.last_s is None:
            return []
        lines = []
        if self.cut is not None or self._pending:
            reason = self.cut or self.reason
            lines.append(f"{self.shown}: broken after {self._last_good()}: {reason}; the frames before it were used")
        if self._errors:
            where = f"after {self._first_damage}" if self._first_damage else "at its start"
            lines.append(
                f"{self.shown}: damaged {where}: {self._errors} piece{'s' * (self._errors > 1)} could not be decoded "
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
