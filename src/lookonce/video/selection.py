"""Which frames of a source are wanted."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol, TypeVar

from lookonce.errors import ConfigError

__all__ = ["Selection"]


class _Placed(Protocol):
    """Anything that has a number and a time in its source."""

    @property
    def index(self) -> int: ...

    @property
    def time_s(self) -> float: ...


_P = TypeVar("_P", bound=_Placed)


@dataclass(frozen=True, slots=True)
class Selection:
    """The wanted part of a source.

    Attributes:
        start_s: frames before this time are dropped; seconds since the first frame, >= 0.
        end_s: frames at this time and later are dropped; None = to the end.
        every: only frames whose index is a multiple of this; >= 1.
        max_frames: at most so many frames; None = all.
    """

    start_s: float = 0.0
    end_s: float | None = None
    every: int = 1
    max_frames: int | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.start_s) and self.start_s >= 0):
            raise ConfigError(f"start: expected seconds >= 0, got {self.start_s}")
        if self.end_s is not None and not self.end_s > self.start_s:
            raise ConfigError(f"end: expected seconds after the start ({self.start_s}), got {self.end_s}")
        if self.every < 1:
            raise ConfigError(f"every: expected a whole number >= 1, got {self.every}")
        if self.max_frames is not None and self.max_frames < 1:
            raise ConfigError(f"max_frames: expected a whole number >= 1, got {self.max_frames}")

    def pick(self, items: Iterable[_P]) -> Iterator[_P]:
        """The wanted ones of ``items``, which come in order of time; stops reading as soon as no more can come."""
        picked = 0
        for item in items:
            if self.end_s is not None and item.time_s >= self.end_s:
                return
            if item.time_s < self.start_s or item.index % self.every:
                continue
            yield item
            picked += 1
            if picked == self.max_frames:
                return

    def count(self, total: int, rate: float) -> int:
        """About how many of ``total`` frames at ``rate`` frames per second are wanted; exact for a constant rate."""
        first = min(total, math.ceil(self.start_s * rate - 1e-6))
        end = total if self.end_s is None else min(total, math.ceil(self.end_s * rate - 1e-6))
        wanted = max(0, math.ceil(end / self.every) - math.ceil(first / self.every))
        return wanted if self.max_frames is None else min(wanted, self.max_frames)
