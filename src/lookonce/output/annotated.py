"""The video with its tracks drawn in."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import OutputError
from lookonce.output.drawing import TrackPainter
from lookonce.output.sink import Sink
from lookonce.output.trails import TrailMemory
from lookonce.structures import Tracks
from lookonce.video.frame import Frame
from lookonce.video.writer import VideoWriter

__all__ = ["AnnotatedVideoSink", "FrameWriter"]


class FrameWriter(Protocol):
    """What a sink needs of a video writer."""

    def write(self, rgb: NDArray[np.uint8], time_s: float) -> None:
        """Append a picture (H, W, 3) uint8 RGB, shown from ``time_s`` on."""
        ...

    def close(self) -> None:
        """Complete the file."""
        ...


class AnnotatedVideoSink(Sink):
    """Writes the frames with boxes, ``name id score`` labels and short trails.

    Args:
        path: the video; its extension names the container.
        names: the class names by label.
        rate_hint: frames a second of the source, as far as known.
        trail_s: length of the trails in seconds, above 0.
        font: a TrueType or OpenType file for names beyond ASCII; None = Pillow's own, accents dropped.
        open_writer: opens the file; ``VideoWriter`` unless another encoder is wanted.

    Raises:
        OutputError: the file cannot be created.
        ConfigError: the font cannot be read.
    """

    def __init__(
        self,
        path: Path,
        names: Sequence[str],
        rate_hint: float,
        trail_s: float = 1.5,
        font: Path | None = None,
        open_writer: Callable[[Path, float], FrameWriter] = VideoWriter,
    ) -> None:
        self.path = path
        self._painter = TrackPainter(names, font)
        self._trails = TrailMemory(trail_s)
        self._failed = False
        self._closed = False
        with _as_output_error(path):
            self._writer = open_writer(path, rate_hint)

    def write(self, frame: Frame, tracks: Tracks) -> None:
        """Append the frame with its tracks drawn in."""
        trails = self._trails.update(tracks, frame.time_s)
        picture = self._painter.draw(frame.image, tracks, trails)
        try:
            with _as_output_error(self.path):
                self._writer.write(picture, frame.time_s)
        except OutputError:
            self._failed = True
            raise

    def close(self) -> None:
        """Complete the video; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        # After a failed write the file can hardly be completed; that fault has been told already.
        told = contextlib.suppress(OutputError) if self._failed else contextlib.nullcontext()
        with told, _as_output_error(self.path):
            self._writer.close()


@contextlib.contextmanager
def _as_output_error(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise OutputError(f"{path}: cannot be written ({exc.strerror or exc}); free some space") from exc
