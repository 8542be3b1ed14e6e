"""How far apart compared boxes lie: in seconds, for any frame rate, or in frames."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from lookonce.errors import ConfigError
from lookonce.evaluation import DescribedObjects

__all__ = ["Gap", "GapLimits", "Window"]

_TICKS_PER_S = 1000
_LONGEST = 1_000_000  # seconds or frames: twelve days


@dataclass(frozen=True, slots=True)
class Gap:
    """A time between two frames, checked on construction.

    Attributes:
        value: seconds, or a whole number of frames; 0 to 1,000,000.
        in_frames: which of the two.

    Raises:
        ConfigError: it is out of range, or not a whole number of frames.
    """

    value: float
    in_frames: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.value <= _LONGEST or (self.in_frames and self.value != int(self.value)):
            kind = "a whole number of frames" if self.in_frames else "seconds"
            raise ConfigError(f"gap {self.value:g}: expected {kind}, 0 to {_LONGEST:,}")

    @classmethod
    def parse(cls, text: str) -> Gap:
        """A gap as people write it: ``30f`` is frames, ``4s`` and ``0.5`` are seconds.

        Raises:
            ConfigError: it is something else.

        >>> Gap.parse("30f"), Gap.parse("1.5 s")
        (Gap(value=30.0, in_frames=True), Gap(value=1.5, in_frames=False))
        """
        match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*([fs]?)", text.strip().lower())
        if not match:
            raise ConfigError(f"gap '{text}': expected frames such as 30f, or seconds such as 4s")
        return cls(float(match[1]), match[2] == "f")

    def __str__(self) -> str:
        if self.in_frames:
            return f"{self.value:.0f} frame{'' if self.value == 1 else 's'}"
        return f"{self.value:g} s"


@dataclass(frozen=True, slots=True)
class Window:
    """Objects on a clock whose whole ticks say which pairs are compared.

    Attributes:
        objects: as given, their ``frames`` replaced by ticks.
        least: pairs are at least so many ticks apart.
        most: and at most so many.
    """

    objects: DescribedObjects
    least: int
    most: int


@dataclass(frozen=True, slots=True)
class GapLimits:
    """Which boxes are compared, checked on construction.

    The defaults make sense for any frame rate: within half a second hardly anything changes, and after half a minute
    few objects are still in view.

    Attributes:
        least: the boxes of a pair are at least so far apart.
        most: in frames at most so far; in seconds less than so far, as for the parts by time.
        rank: rank one looks for each object so much later.

    Raises:
        ConfigError: the limits leave nothing, or one is in frames and the other in seconds.
    """

    least: Gap = Gap(0.5)
    most: Gap = Gap(30.0)
    rank: Gap = Gap(2.0)

    def __post_init__(self) -> None:
        if self.least.in_frames != self.most.in_frames:
            raise ConfigError(
                f"gaps from {self.least} to {self.most}: give both in frames (30f, 200f) or both in seconds (0.5s, 30s)"
            )
        if self.least.value > self.most.value or (not self.least.in_frames and self.least.value == self.most.value):
            raise ConfigError(f"gaps from {self.least} to {self.most}: the second must be larger")
        if not self.rank.value:
            raise ConfigError("gap of rank one: expected more than 0")

    def __str__(self) -> str:
        return f"{self.least.value:g} to {self.most}"

    def window(self, objects: DescribedObjects) -> Window:
        """The objects on the clock of these limits: frames, or milliseconds of each sequence's own clock."""
        if self.least.in_frames:
            return Window(objects, int(self.least.value), int(self.most.value))
        ticks = np.rint(objects.times_s * _TICKS_PER_S).astype(np.int64)
        least, end = (math.ceil(round(gap.value * _TICKS_PER_S, 3)) for gap in (self.least, self.most))
        return Window(replace(objects, frames=ticks), least, max(least, end - 1))

    def rank_frames(self, objects: DescribedObjects) -> int:
        """How many frames later rank one looks in this sequence, 1 or more.

        Seconds become the nearest number of frames at which the sequence has objects: with truth for every fifth frame,
        a multiple of five.

        Args:
            objects: N rows of one sequence.
        """
        if self.rank.in_frames:
            return int(self.rank.value)
        frames, first_rows = np.unique(objects.frames, return_index=True)
        if len(frames) < 2:
            return 1
        times_s = objects.times_s[first_rows]
        step = int(np.gcd.reduce(np.diff(frames)))
        step_s = float(times_s[-1] - times_s[0]) / (int(frames[-1] - frames[0]) / step)
        return max(1, round(self.rank.value / step_s)) * step
