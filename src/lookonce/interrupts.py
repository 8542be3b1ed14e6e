"""Ctrl-C at a moment that loses nothing."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["interrupts_deferred"]


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Let a block finish: a SIGINT that comes within it takes effect at its end.

    Python raises ``KeyboardInterrupt`` between any two instructions of the main thread, for instance after an encoder
    gave its packets and before the file has them. In other threads, where it is never raised, the block just runs; so
    it does where the handler was not set by Python.
    """
    usual = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(usual):
        yield
        return
    came: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        if came:
            usual(*came[0])
