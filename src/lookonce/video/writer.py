"""Annotated video that survives a crash of its writer."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Sequence
from fractions import Fraction
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import av
import numpy as np
from av.container import OutputContainer
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream
from numpy.typing import NDArray

from lookonce.errors import OutputError
from lookonce.video.opening import explain, one_line

__all__ = ["ENCODERS", "VideoWriter"]

log = logging.getLogger(__name__)

# In order of preference: the H.264 encoders that FFmpeg builds have, then MPEG-4, which all have.
ENCODERS: Final = ("libx264", "libopenh264", "h264_videotoolbox", "h264_mf", "mpeg4")
_ENCODER_OPTIONS: Final = {"libx264": {"preset": "veryfast", "crf": "23"}, "mpeg4": {"qscale": "4"}}
# Each fragment (MP4) or cluster (MKV) is whole in itself and goes to the disk at once, so a kill loses a second.
_CONTAINER_OPTIONS: Final = {
    ".mp4": {"movflags": "frag_keyframe+empty_moov+default_base_moof", "flush_packets": "1"},
    ".mkv": {"flush_packets": "1", "cluster_time_limit": "1000"},
}
_TIME_BASE: Final = Fraction(1, 90_000)
_MPEG4_TIME_BASE: Final = Fraction(1, 60_000)  # its clock has 16 bits
_BT601: Final = 6  # H.273's number for the matrix that swscale uses by default; players would guess BT.709 for HD
_LIMITED_RANGE: Final = 1


class VideoWriter:
    """Writes RGB pictures as a video with their true times; MP4 or MKV by the suffix.

    The first picture's time becomes 0. What was written before a crash, up to the last whole second or so, plays.
    A file without any picture is removed.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        rate_hint: float,
        size: tuple[int, int] | None = None,
        *,
        encoders: Sequence[str] = ENCODERS,
    ) -> None:
        """Creates the file.

        Args:
            path: ends in .mp4 or .mkv; an existing file is replaced.
            rate_hint: about how many frames per second will come; for the encoder only, times are exact.
            size: (height, width) in px of the video; None = the first picture's. Odd sides grow by one.
            encoders: FFmpeg's names of encoders, the first that works is used.

        Raises:
            OutputError: the file cannot be created, or its suffix names no container that can be used.
        """
        self.path = Path(path)
        if not (math.isfinite(rate_hint) and rate_hint > 0):
            raise ValueError(f"rate_hint: expected frames per second > 0, got {rate_hint}")
        if self.path.suffix.lower() not in _CONTAINER_OPTIONS:
            raise OutputError(f"{one_line(self.path)}: expected a name that ends in .mp4 or .mkv")
        self._rate = Fraction(rate_hint).limit_denominator(1001)
        self._size = size
        self._encoders = tuple(encoders)
        self._container: OutputContainer | None = None
        self._stream: VideoStream | None = None
        self._scaler = VideoReformatter()  # keeps swscale's tables between pictures
        self._first_s = 0.0
        self._last_stamp = -1
        self._closed = self._is_broken = False
        try:
            self.path.open("wb").close()  # so that a bad folder shows now, not after the first frame
        except OSError as exc:
            raise self._error(exc) from exc

    def write(self, rgb: NDArray[np.uint8], time_s: float) -> None:
        """Appends a picture.

        Args:
            rgb: (H, W, 3) uint8; scaled if its size is not the video's.
            time_s: when it is shown, in seconds on any clock; one that does not go forward is moved on by a tick.

        Raises:
            OutputError: it cannot be encoded or written, for instance because the disk is full.
        """
        if self._closed:
            raise ValueError("the writer is closed")
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8 or not rgb.size:
            raise ValueError(f"rgb: expected (H, W, 3) uint8, got {rgb.shape} {rgb.dtype}")
        if not math.isfinite(time_s):
            raise ValueError(f"time_s: expected a finite number, got {time_s}")
        try:
            self._append(rgb, time_s)
        except (av.FFmpegError, OSError) as exc:
            self._is_broken = True
            raise self._error(exc) from exc

    def _append(self, rgb: NDArray[np.uint8], time_s: float) -> None:
        if self._container is None or self._stream is None:
            self._container, self._stream = self._start(_even(self._size or (rgb.shape[0], rgb.shape[1])))
            self._first_s = time_s
        height, width = _even((rgb.shape[0], rgb.shape[1]))
        if (height, width) != rgb.shape[:2]:
            rgb = np.pad(rgb, ((0, height - rgb.shape[0]), (0, width - rgb.shape[1]), (0, 0)), mode="edge")
        picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb), format="rgb24")
        picture = self._scaler.reformat(picture, self._stream.width, self._stream.height, "yuv420p", threads=1)
        time_base = self._stream.codec_context.time_base
        self._last_stamp = max(round((time_s - self._first_s) / time_base), self._last_stamp + 1)
        picture.pts, picture.time_base = self._last_stamp, time_base
        self._container.mux(self._stream.encode(picture))

    def _start(self, size: tuple[int, int]) -> tuple[OutputContainer, VideoStream]:
        """Opens the container with the first encoder that works."""
        faults = []
        for encoder in self._encoders:
            container = av.open(str(self.path.absolute()), "w", options=self._container_options())
            try:
                stream = self._add_stream(container, encoder, size)
            except (av.FFmpegError, ValueError) as exc:  # ValueError: this build does not have it
                container.close()
                faults.append(f"{encoder}: {explain(exc)}")
                continue
            if faults:
                log.warning("%s: encoded with %s; %s", one_line(self.path), encoder, "; ".join(faults))
            return container, stream
        raise OutputError(
            f"{one_line(self.path)}: no encoder works ({'; '.join(faults)}); install PyAV from its wheels"
        )

    def _container_options(self) -> dict[str, str]:
        return dict(_CONTAINER_OPTIONS[self.path.suffix.lower()])

    def _add_stream(self, container: OutputContainer, encoder: str, size: tuple[int, int]) -> VideoStream:
        options: dict[str, Any] = {"options": dict(_ENCODER_OPTIONS.get(encoder, {}))}
        stream = container.add_stream(encoder, rate=self._rate, **options)
        assert isinstance(stream, VideoStream)  # all of ENCODERS are
        stream.height, stream.width = size
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.time_base = _MPEG4_TIME_BASE if encoder == "mpeg4" else _TIME_BASE
        context.gop_size = max(1, round(self._rate))  # a key frame, and so a fragment, about every second
        context.max_b_frames = 0  # pictures shown out of order would shift a fragmented file's first time
        context.colorspace, context.color_range = _BT601, _LIMITED_RANGE
        context.thread_count = 2
        context.open()
        return stream

    def close(self) -> None:
        """Writes what the encoder still holds and closes the file; closing twice is harmless.

        Raises:
            OutputError: the rest cannot be written.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if self._container is None or self._stream is None:
                self.path.unlink(missing_ok=True)
            elif self._is_broken:  # reported already; writing on after a failed header crashes FFmpeg
                with contextlib.suppress(av.FFmpegError, OSError):
                    self._container.close()
            else:
                self._finish(self._container, self._stream)
        except (av.FFmpegError, OSError) as exc:
            raise self._error(exc) from exc

    @staticmethod
    def _finish(container: OutputContainer, stream: VideoStream) -> None:
        packets = stream.encode(None)
        try:
            container.mux(packets)
        except (av.FFmpegError, OSError):
            with contextlib.suppress(av.FFmpegError, OSError):  # the first error says it
                container.close()
            raise
        container.close()

    def _error(self, exc: Exception) -> OutputError:
        return OutputError(f"{one_line(self.path)}: cannot be written: {explain(exc)}; check the folder and its space")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _even(size: tuple[int, int]) -> tuple[int, int]:
    """(height, width) with odd sides one larger: H.264 halves the colour planes."""
    return size[0] + size[0] % 2, size[1] + size[1] % 2
