"""Boxes for the frames in which an object was missed, once it is seen again: on the straight line between."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import Filled

__all__ = ["MOST_PASSED", "PassedFrames"]

_F = NDArray[np.float64]

MOST_PASSED = 256
"""Frames that are remembered: longer gaps, in frames, are not filled."""


class PassedFrames:
    """The numbers and times of the last frames.

    Args:
        fill_s: how long a gap may be, s.
    """

    def __init__(self, fill_s: float) -> None:
        self.fill_s = fill_s
        self.frames: deque[tuple[int, float]] = deque(maxlen=MOST_PASSED)

    def add(self, number: int, time_s: float) -> None:
        """One more frame, later than those before."""
        if self.fill_s <= 0:
            return
        self.frames.append((number, time_s))
        while self.frames[0][1] < time_s - self.fill_s:
            self.frames.popleft()

    def have_missed(self, seen_s: _F, now_s: float) -> NDArray[np.intp]:
        """Which objects, last seen at ``seen_s`` (M,), missed frames that can be filled if they are seen now."""
        if not self.frames:
            return np.zeros(0, np.intp)
        seen_first = max(self.frames[0][1], now_s - self.fill_s)
        missed: NDArray[np.intp] = ((seen_s < self.frames[-1][1]) & (seen_s >= seen_first)).nonzero()[0]
        return missed

    def fill(
        self, ids: NDArray[np.int64], labels: NDArray[np.int64], seen_s: _F, before: _F, now_s: float, now: _F
    ) -> Filled:
        """Rows for the frames between.

        Args:
            ids: (M,) of objects that are seen now and have missed frames.
            labels: (M,)
            seen_s: (M,) when each was seen before.
            before: (M, 4) its box then, xyxy.
            now_s: the time of this frame.
            now: (M, 4) its box in it.
        """
        first, latest = seen_s.min(), []
        for frame in reversed(self.frames):
            if frame[1] <= first:
                break
            latest.append(frame)
        latest.reverse()
        numbers, times = np.array([number for number, _ in latest]), np.array([time_s for _, time_s in latest])
        objects, frames = (times > seen_s[:, np.newaxis]).nonzero()
        begun_s = seen_s[objects]
        share = (times[frames] - begun_s) / (now_s - begun_s)
        boxes = before[objects]
        boxes += share[:, np.newaxis] * (now - before)[objects]
        return Filled(numbers[frames], ids[objects], boxes.astype(np.float32), labels[objects])
