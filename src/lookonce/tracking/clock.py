"""Time as a tracker has it: always forward, whatever times come with the frames."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["LEAST_STEP_S", "Clock"]

LEAST_STEP_S = 1e-3
"""Seconds from one frame to the next, at least."""


@dataclass(slots=True)
class Clock:
    """The number and the time of the frame.

    Attributes:
        frame: its number, from 0; -1: none so far.
        now_s: its time, s.
        given_s: as it was given, s.
        offset_s: how far the clock here is ahead of those given, s.
        faults: how often time stood still or went back.
    """

    frame: int = -1
    now_s: float = 0.0
    given_s: float = 0.0
    offset_s: float = 0.0
    faults: int = 0

    def advance(self, time_s: float | None, frame_rate: float) -> float:
        """Go on to the next frame, at ``time_s`` or, without one, at ``frame_rate``; seconds since the one before."""
        self.frame += 1
        if self.frame == 0:
            self.now_s = self.given_s = 0.0 if time_s is None else time_s
            return 0.0
        step_s = 1.0 / frame_rate if time_s is None else time_s + self.offset_s - self.now_s
        if step_s < LEAST_STEP_S:
            self.faults += 1
            # Twice in a row on an earlier clock that goes forward: it was set back, and goes on from there.
            step_s = LEAST_STEP_S
            if time_s is not None and time_s - self.given_s >= LEAST_STEP_S:
                step_s = time_s - self.given_s
                self.offset_s = self.now_s - self.given_s
        self.now_s += step_s
        self.given_s = self.now_s if time_s is None else time_s
        return step_s
