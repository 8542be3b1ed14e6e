"""The container's time stamps as seconds that only go forward."""

from __future__ import annotations

from fractions import Fraction

import av

__all__ = ["Clock", "frame_time_s"]

_FALLBACK_RATE = Fraction(25)  # frames per second where the container names none


def frame_time_s(rate: Fraction | None) -> float:
    """Seconds between two frames at ``rate`` frames per second."""
    return float(1 / (rate or _FALLBACK_RATE))


class Clock:
    """Gives each frame its time in seconds since the first frame.

    The time is the presentation stamp, else the decoding stamp. Where both are missing, or do not go forward (clips
    that were joined, broken cameras), it is the previous time plus one frame at the average rate.

    Attributes:
        estimated: how many times were made up because the stamps went back or were missing.
    """

    def __init__(self, time_base: Fraction, rate: Fraction | None, first: int | None = None) -> None:
        """Starts at the stamp ``first``, in units of ``time_base`` seconds; None = at the first frame's stamp."""
        self._time_base = time_base
        self._step_s = frame_time_s(rate)
        self._first = first
        self._previous_s: float | None = None
        self.estimated = 0

    def __call__(self, picture: av.VideoFrame) -> float:
        """Seconds of the next frame; greater than those of the frame before."""
        time_s = self._stamp_s(picture.dts if picture.pts is None else picture.pts)
        if self._previous_s is not None and (time_s is None or time_s <= self._previous_s):
            self.estimated += 1
            time_s = self._previous_s + self._step_s
        self._previous_s = time_s or 0.0
        return self._previous_s

    def _stamp_s(self, stamp: int | None) -> float | None:
        if stamp is None:
            return None
        if self._first is None:
            self._first = stamp
        return float((stamp - self._first) * self._time_base)
