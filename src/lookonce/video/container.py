"""Video files, cameras and URLs: everything that FFmpeg's containers hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from urllib.parse import urlsplit

import av
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from lookonce.errors import ConfigError, VideoError
from lookonce.video.clock import Clock, frame_time_s, has_presentation_stamps
from lookonce.video.damage import Damage, early_end, promised_length_s
from lookonce.video.frame import Frame
from lookonce.video.opening import (
    LIVE_SCHEMES,
    explain,
    one_line,
    open_camera,
    open_file,
    open_url,
    video_stream,
    without_password,
)
from lookonce.video.orientation import orient
from lookonce.video.seeking import Place, seek_to_start
from lookonce.video.selection import Selection
from lookonce.video.source import Findings, Frames, VideoSource

__all__ = ["camera_source", "file_source", "url_source"]


def file_source(path: Path, selection: Selection) -> VideoSource:
    """A local video file.

    Raises:
        VideoError: it cannot be read, holds no frame, or ends before the selection starts.
    """
    reader = _Reader(lambda: open_file(path), one_line(path), selection, path=path)
    return reader.source(path.stem)


def url_source(url: str, selection: Selection) -> VideoSource:
    """A stream, or a file on a server.

    Raises:
        VideoError: it cannot be read.
        ConfigError: a start is asked of a live stream.
    """
    parts = urlsplit(url)
    reader = _Reader(lambda: open_url(url), without_password(url), selection, live=parts.scheme.lower() in LIVE_SCHEMES)
    return reader.source(one_line(Path(parts.path).stem or parts.hostname or parts.scheme))


def camera_source(number: int, selection: Selection) -> VideoSource:
    """A camera of this machine, counted from 0.

    Raises:
        VideoError: there is no such camera.
        ConfigError: a start is asked of it.
    """
    return _Reader(lambda: open_camera(number), f"camera {number}", selection, live=True).source(f"camera{number}")


class _Reader:
    """Reads the video stream of one container, as often as the container can be opened.

    Attributes:
        shown: the source's name in messages.
        path: the local file; None for cameras and URLs.
        live: whether the source happens now; a server's file turns out not to when it is opened.
    """

    def __init__(
        self,
        connect: Callable[[], InputContainer],
        shown: str,
        selection: Selection,
        *,
        path: Path | None = None,
        live: bool = False,
    ) -> None:
        self.shown = shown
        self.path = path
        self._connect = connect
        self._selection = selection
        self._findings = Findings()
        self._container: InputContainer | None = connect()
        try:
            stream = video_stream(self._container, shown)
            self.live = live or (path is None and self._container.duration is None)
            if self.live and selection.start_s:
                raise ConfigError(f"start: {shown} is live and can only be read from now on; leave it out")
        except (VideoError, ConfigError):
            self._container.close()
            raise
        self._rate = stream.average_rate or stream.guessed_rate
        self._count = None if self.live else _count_frames(self._container, stream, self._rate, selection)

    def source(self, name: str) -> VideoSource:
        """The source that this reader feeds; decodes the first frame."""
        return VideoSource(
            self.frames,
            self._findings,
            name=name,
            frame_count=self._count,
            rate=None if self._rate is None else float(self._rate),
            is_live=self.live,
        )

    def frames(self) -> Frames:
        """One pass over the wanted frames; opens the container unless it still is, and closes it in any case."""
        container, self._container = self._container or self._connect(), None
        damage = Damage(self.shown)
        try:
            place = self._find_start(container)
            if place is None:
                container.close()
                container = self._connect()
                place = Place()
            damage = Damage(self.shown, place.index)
            picked = 0
            for frame in self._selection.pick(self._decode(container, place, damage)):
                picked += 1
                yield frame
            if not picked:
                raise VideoError(self._why_nothing(damage))
        finally:
            container.close()
            for text in damage.summary():
                self._findings.add(text)

    def _find_start(self, container: InputContainer) -> Place | None:
        """Where the wanted frames begin; None if they must be looked for from the beginning of a new container."""
        if not self._selection.start_s or self.path is None:
            return Place()
        return seek_to_start(container, video_stream(container, self.shown), self._selection.start_s)

    def _decode(self, container: InputContainer, place: Place, damage: Damage) -> Iterator[Frame]:
        """All frames from the place on, numbered and timed; says at the end of the file if that came too early."""
        stream = video_stream(container, self.shown)
        if self.live:
            stream.thread_type = "SLICE"  # decoding frames side by side would delay each by one
        assert stream.time_base is not None  # FFmpeg gives one to every stream
        has_pts = has_presentation_stamps(container, stream)
        clock = Clock(stream.time_base, stream.average_rate, place.first, trust_pts=has_pts)
        promised_s = promised_length_s(container, stream)
        for picture in _pictures(container, stream, damage):
            time_s = clock(picture)
            damage.estimated_times = clock.estimated
            if place.first is not None and time_s < self._selection.start_s:
                damage.passed(_stamp(picture))
                continue  # between the key frame and the start: place.index has counted it
            index = damage.decoded(time_s, _stamp(picture))
            yield Frame(index, time_s, *orient(picture))
        damage.cut = early_end(self.path, damage, promised_s)

    def _why_nothing(self, damage: Damage) -> str:
        if damage.last_s is None:
            why = damage.reason or "it holds no picture"
            return f"{self.shown}: no frame could be decoded ({why}); copy or convert it again"
        start_s, length_s = self._selection.start_s, damage.last_s + frame_time_s(self._rate)
        if start_s > damage.last_s:
            return f"{self.shown}: the start, {start_s:g} s, is behind its end; it is {length_s:.2f} s long"
        return f"{self.shown}: start, end and every leave no frame; it is {length_s:.2f} s long"


def _count_frames(
    container: InputContainer, stream: VideoStream, rate: Fraction | None, selection: Selection
) -> int | None:
    """About how many frames of a file are wanted; None if its header tells neither number nor length."""
    total, rate = stream.frames, rate or Fraction(0)
    if not total and stream.duration and stream.time_base:
        total = round(stream.duration * stream.time_base * rate)
    if not total and container.duration:
        total = round(Fraction(container.duration, av.time_base) * rate)
    return selection.count(total, float(rate)) if total > 0 else None


def _stamp(item: av.VideoFrame | Packet[VideoStream]) -> int | None:
    """When a frame or packet is shown, in units of the stream's time base."""
    return item.dts if item.pts is None else item.pts


def _pictures(container: InputContainer, stream: VideoStream, damage: Damage) -> Iterator[av.VideoFrame]:
    """Every good picture, in order of presentation; what is lost goes to ``damage``.

    A picture of which a part is missing is lost: what FFmpeg paints there is invented, and differs between runs.
    """
    torn: set[int | None] = set()
    for packet in _packets(container, stream, damage):
        if packet is not None and packet.is_corrupt:
            torn.add(_stamp(packet))
        for picture in _decode_packet(stream, packet, damage):
            stamp = _stamp(picture)
            if picture.is_corrupt or stamp in torn:
                torn = {later for later in torn if later is not None and stamp is not None and later > stamp}
                damage.failed("data is missing or wrong", stamp, lost_frame=True)
            else:
                yield picture


def _packets(container: InputContainer, stream: VideoStream, damage: Damage) -> Iterator[Packet[VideoStream] | None]:
    """The video's packets, over damaged places, up to the end, a stalled stream, or too many errors in a row.

    At the end comes None, which asks the decoder for the pictures that it still holds.
    """
    stamp: int | None = None
    while not damage.is_hopeless:
        try:
            for packet in container.demux(stream):
                if packet.size:  # an empty one would end the decoding
                    stamp = _stamp(packet)
                    yield packet
                if damage.is_hopeless:
                    break
            break
        except av.error.ExitError:
            damage.failed("no data came in time", stamp, lost_frame=False)
            break
        except av.FFmpegError as exc:
            damage.failed(explain(exc), stamp, lost_frame=False)
    yield None


def _decode_packet(stream: VideoStream, packet: Packet[VideoStream] | None, damage: Damage) -> list[av.VideoFrame]:
    """The pictures that become ready with this packet; None gives those that still wait in the decoder."""
    try:
        return stream.codec_context.decode(packet)
    except av.error.EOFError:
        return []
    except av.FFmpegError as exc:
        damage.failed(explain(exc), None if packet is None else _stamp(packet), lost_frame=packet is not None)
        return []
