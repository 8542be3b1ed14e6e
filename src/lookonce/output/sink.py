"""The contract of everything that takes a tracker's results."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from lookonce.structures import Tracks
from lookonce.video.frame import Frame

__all__ = ["Sink"]


class Sink(Protocol):
    """Takes the frames of one source in order, each with its tracks; a context manager that closes itself.

    Results are append-only and handed to the system frame by frame: whatever happens, everything up to the last
    whole frame is valid. Faults of the disk are ``OutputError``; after one, ``close()`` still works.

    Attributes:
        path: the file written.
    """

    path: Path

    def write(self, frame: Frame, tracks: Tracks) -> None:
        """Append one frame's result; ``tracks`` may be empty."""
        ...

    def close(self) -> None:
        """Complete the file; a second call does nothing."""
        ...

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, error_type: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
