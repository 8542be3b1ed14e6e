"""What every opened source looks like from outside."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable, Generator, Iterator
from types import TracebackType
from typing import Self

from lookonce.video.frame import Frame

__all__ = ["Findings", "VideoSource"]

log = logging.getLogger(__name__)

Frames = Generator[Frame, None, None]


class Findings:
    """What went wrong without being fatal: kept, and logged once each."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def add(self, text: str) -> None:
        """Keeps and logs ``text`` unless it is known already."""
        if text not in self.texts:
            self.texts.append(text)
            log.warning("%s", text)


class VideoSource:
    """An opened source: iterate over it for its frames, in a ``with`` block or until it ends.

    The first frame is decoded at once, so that whatever cannot be read fails when it is opened. Files may be iterated
    again, each time from the start; one iteration at a time. A loop that is left early closes the source.

    Attributes:
        name: short name, fit for a results folder: the file's stem, the folder's name, ``camera0``.
        frame_count: about how many frames will come; None where nobody can know.
        rate: frames per second of the source itself, before frames are skipped; None if not known.
        size: (height, width) in px of the first frame, upright.
        is_live: True for what cannot be read again: cameras and streams.
    """

    def __init__(
        self,
        read: Callable[[], Frames],
        findings: Findings,
        *,
        name: str,
        frame_count: int | None,
        rate: float | None,
        is_live: bool = False,
    ) -> None:
        """Starts reading.

        Args:
            read: starts one pass over the frames; its generator closes what it opened.
            findings: where ``read`` reports what is not fatal.
            name: see above, as the others.
            frame_count: estimate for progress bars.
            rate: frames per second.
            is_live: whether ``read`` works only once.
        """
        self.name = name
        self.frame_count = frame_count
        self.rate = rate
        self.is_live = is_live
        self._findings = findings
        self._read = read
        self._frames = read()
        self._first = next(self._frames, None)
        self.size = None if self._first is None else self._first.size
        self._started = self._closed = False

    @property
    def warnings(self) -> list[str]:
        """What went wrong so far and was not fatal, one line each; complete when the iteration has ended."""
        return list(self._findings.texts)

    def __iter__(self) -> Iterator[Frame]:
        if self._closed:
            raise ValueError(f"{self.name}: the source is closed")
        if self._started:
            if self.is_live:
                raise ValueError(f"{self.name}: a live source can be read only once")
            self._frames.close()
            self._frames, self._first = self._read(), None
        self._started = True
        return self._pass(self._frames)

    def _pass(self, frames: Frames) -> Frames:
        try:
            first, self._first = self._first, None
            if first is not None:
                yield first
            for frame in frames:
                if self._closed:
                    return
                yield frame
        finally:
            frames.close()

    def close(self) -> None:
        """Closes what is open; a loop in another thread ends with its next frame. Closing twice is harmless."""
        self._closed = True
        self._first = None
        if inspect.getgeneratorstate(self._frames) != inspect.GEN_RUNNING:
            self._frames.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
