"""Starting in the middle of a file with the right frame number."""

from __future__ import annotations

from dataclasses import dataclass

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from lookonce.video.clock import has_presentation_stamps

__all__ = ["Place", "seek_to_start"]

# Containers whose index finds the key frame before a time exactly, and codecs in which a packet is a frame. Elsewhere
# (MPEG-TS, VP8 with its hidden frames) decoding starts at the beginning.
_INDEXED_FORMATS = frozenset({"mov", "mp4", "matroska", "webm", "avi"})
_ONE_FRAME_CODECS = frozenset({"h264", "hevc", "mpeg4", "mjpeg", "vp9", "libdav1d", "av1", "prores", "vvc"})


@dataclass(frozen=True, slots=True)
class Place:
    """Where decoding begins.

    Attributes:
        first: stamp of the source's first frame; None = that of the first frame decoded.
        index: number in the source of the first frame at or after the start.
    """

    first: int | None = None
    index: int = 0


def seek_to_start(container: InputContainer, stream: VideoStream, start_s: float) -> Place | None:
    """Moves a freshly opened ``container`` to the key frame before ``start_s`` seconds; reads, but decodes nothing.

    Returns:
        The place, or None if only decoding from the beginning gives sure numbers; the container must then be reopened.
    """
    if not _INDEXED_FORMATS & set(container.format.name.split(",")):
        return None
    if stream.codec_context.name not in _ONE_FRAME_CODECS or not has_presentation_stamps(container, stream):
        return None
    try:
        stamps = _stamps_until(container, stream, start_s)
        if not stamps:
            return None
        before = [stamp for stamp in stamps if _time_s(stamp, stamps[0], stream) < start_s]
        found = _seek_key_frame(container, stream, max(before))
    except av.FFmpegError:  # damaged before the start: decoding from the beginning says where
        return None
    return Place(stamps[0], len(before)) if found else None


def _stamps_until(container: InputContainer, stream: VideoStream, start_s: float) -> list[int]:
    """The stamps of all frames shown before ``start_s`` and of some after, the first frame's first.

    Empty if a stamp is missing or out of order, or if the file ends before ``start_s``.
    """
    stamps: list[int] = []
    previous: int | None = None
    for packet in container.demux(stream):
        if not packet.size or packet.is_discard:  # the end's empty packet; what an edit list cuts away
            continue
        if packet.pts is None or packet.dts is None or (previous is not None and packet.dts < previous):
            return []
        stamps.append(packet.pts)
        previous = packet.dts
        if packet.pts < stamps[0]:  # leading pictures, which a decoder may or may not show
            return []
        if _time_s(packet.dts, stamps[0], stream) >= start_s:
            return stamps  # a packet is not shown before it is decoded: all later ones are shown after the start
    return stamps if any(_time_s(stamp, stamps[0], stream) >= start_s for stamp in stamps) else []


def _time_s(stamp: int, first: int, stream: VideoStream) -> float:
    """Seconds, by the rule of ``Clock``, so that both agree on which frames come before the start."""
    assert stream.time_base is not None  # FFmpeg gives one to every stream
    return float((stamp - first) * stream.time_base)


def _seek_key_frame(container: InputContainer, stream: VideoStream, stamp: int) -> bool:
    """Seeks to the last key frame not after ``stamp``; False if the container leads somewhere else."""
    container.seek(stamp, stream=stream)
    packet = next((p for p in container.demux(stream) if p.size), None)
    if packet is None or packet.pts is None or not packet.is_keyframe or packet.pts > stamp:
        return False
    container.seek(stamp, stream=stream)
    return True
