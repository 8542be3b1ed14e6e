"""The video with its tracks drawn in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lookonce.output.drawing import TrackPainter
from lookonce.output.sink import Sink
from lookonce.output.trails import TrailMemory
from lookonce.structures import Tracks
from lookonce.video.frame import Frame
from lookonce.video.writer import VideoWriter

__all__ = ["AnnotatedVideoSink"]


class AnnotatedVideoSink(Sink):
    """Writes the frames with boxes, ``name id score`` labels and short trails; rows without identity are not drawn.

    Args:
        path: the video; its extension names the container.
        names: the class names by label.
        rate_hint: frames a second of the source, as far as known.
        trail_s: length of the trails in seconds, above 0.
        font: a TrueType or OpenType file for names beyond ASCII; None = Pillow's own, accents dropped.

    Raises:
        OutputError: the file cannot be created.
        ConfigError: the font cannot be read.
    """

    def __init__(
        self, path: Path, names: Sequence[str], rate_hint: float, trail_s: float = 1.5, font: Path | None = None
    ) -> None:
        self.path = path
        self._painter = TrackPainter(names, font)
        self._trails = TrailMemory(trail_s)
        self._writer = VideoWriter(path, rate_hint)

    def write(self, frame: Frame, tracks: Tracks) -> None:
        """Append the frame with its tracks drawn in."""
        trails = self._trails.update(tracks, frame.time_s)
        self._writer.write(self._painter.draw(frame.image, tracks.identified(), trails), frame.time_s)

    def close(self) -> None:
        """Complete the video; a second call does nothing."""
        self._writer.close()
