"""The container's time stamps as seconds that only go forward."""

from __future__ import annotations

from fractions import Fraction

import av
from av.container import InputContainer
from av.video.stream import VideoStream

__all__ = ["Clock", "frame_time_s", "has_presentation_stamps"]

_FALLBACK_RATE = Fraction(25)  # frames per second where the container names none


def frame_time_s(rate: Fraction | None) -> float:
    """Seconds between two frames at ``rate`` frames per second."""
    return float(1 / (rate or _FALLBACK_RATE))


def has_presentation_stamps(container: InputContainer, stream: VideoStream) -> bool:
    """False for H.264 and H.265 in AVI, which stores no such stamps: FFmpeg's guesses are wrong with B-frames."""
    return container.format.name != "avi" or stream.codec_context.name not in {"h264", "hevc"}


class Clock:
    """Gives each frame its time in seconds since the first frame.

    The time is the presentation stamp, else the decoding stamp. Where both are missing, or do not go forward (clips
    that were joined, broken cameras), it is the previous time plus one frame at the average rate. Without presentation
    stamps it is the decoding stamp, which for frames in the order shown is late by the same time for all.

    Attributes:
        estimated: how many times were made up because the stamps went back or were missing.
    """

    def __init__(
        self, time_base: Fraction, rate: Fraction | None, first: int | None = None, *, trust_pts: bool = True
    ) -> None:
        """Starts at the stamp ``first``, in units of ``time_base`` seconds; None = at the first frame's stamp."""
        self._trust_pts = trust_pts
        self._time_base = time_base
        self._step_s = frame_time_s(rate)
        self._first = first
        self._previous_s: float | None = None
        self.estimated = 0

    def __call__(self, picture: av.VideoFrame) -> float:
        """Seconds of the next frame; greater than those of the frame before."""
        has_pts = self._trust_pts and picture.pts is not None
        time_s = self._stamp_s(picture.pts if has_pts else picture.dts)
        if self._previous_s is not None and (time_s is None or time_s <= self._previous_s):
            self.estimated += self._trust_pts
            time_s = self._previous_s + self._step_s
        self._previous_s = time_s or 0.0
        return self._previous_s

    def _stamp_s(self, stamp: int | None) -> float | None:
        if stamp is None:
            return None
        if self._first is None:
            self._first = stamp
        return float((stamp - self._first) * self._time_base)
