"""Opening files, cameras and URLs with PyAV: what may be read, and errors in words.

Files and streams are hostile until they are decoded. FFmpeg would follow playlists to other files and hosts, and would
draw text as pictures; so it may use only the container formats and the protocols named here.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path
from typing import Final

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from lookonce.errors import VideoError
from lookonce.video.truncation import lacks_index

__all__ = [
    "LIVE_SCHEMES",
    "MAX_PIXELS",
    "URL_PROTOCOLS",
    "explain",
    "one_line",
    "open_camera",
    "open_file",
    "open_url",
    "video_stream",
    "without_password",
]

MAX_PIXELS: Final = 1 << 27  # 134 megapixels, four times 8K: more is a file made to exhaust the memory
_OPEN_TIMEOUT_S: Final = 4.5  # FFmpeg applies it to connecting and to probing, so a dead URL fails within 9 s
_READ_TIMEOUT_S: Final = 10.0

# Containers of videos, without playlists and others that name further files; the sound formats are here so that an
# audio file is called by its name.
_FILE_FORMATS: Final = (
    "mov,mp4,matroska,webm,avi,mpegts,mpeg,mpegvideo,flv,live_flv,asf,asf_o,ogg,mxf,wtv,dv,nut,rm,ivf,obu,av1,dhav,"
    "h261,h263,h264,hevc,vvc,m4v,vc1,mjpeg,mpjpeg,gif,apng,yuv4mpegpipe,mp3,wav,flac,aac,aiff"
)
_URL_FORMATS: Final = _FILE_FORMATS + ",rtsp,rtp,sdp,hls"

# What each kind of URL needs, and no "file" among it: a stream must not read this machine's disk.
URL_PROTOCOLS: Final = {
    "rtsp": "rtsp,tcp",
    "rtsps": "rtsps,tls,tcp",
    "rtmp": "rtmp,tcp",
    "rtmps": "rtmps,tls,tcp",
    "http": "http,https,tls,tcp,crypto",  # https: redirections; crypto: encrypted HLS
    "https": "https,http,tls,tcp,crypto",
    "udp": "udp",
    "tcp": "tcp",
    "srt": "srt",
}
LIVE_SCHEMES: Final = frozenset(URL_PROTOCOLS) - {"http", "https"}


def open_file(path: Path) -> InputContainer:
    """A local video file, whatever its name looks like.

    Raises:
        VideoError: it is missing, empty, no video, cut short, or may not be read.
    """
    if not path.exists():
        raise VideoError(f"no such file: {one_line(path)}; check the spelling")
    if path.is_file() and path.stat().st_size == 0:
        raise VideoError(f"{one_line(path)}: the file is empty (0 bytes); copy or record it again")
    options = {"protocol_whitelist": "file", "format_whitelist": _FILE_FORMATS}
    try:
        # "file:" keeps a name such as "tcp:a.mp4" or "concat:a|b" a name.
        return av.open(f"file:{path.absolute()}", "r", options=options, metadata_errors="replace")
    except (av.FFmpegError, OSError) as exc:
        raise VideoError(f"{one_line(path)}: {_why_no_video(path, exc)}") from exc


def _why_no_video(path: Path, exc: Exception) -> str:
    if isinstance(exc, PermissionError):
        return "it may not be read; check its permissions"
    if isinstance(exc, ValueError):  # invalid data, or a format that is not accepted
        if lacks_index(path):
            return "the file is cut short or was never closed: its index (moov) is missing; copy or record it again"
        return "not a video; expected MP4, MOV, MKV, WebM, AVI, MPEG-TS or a like format"
    return f"cannot be opened: {explain(exc)}"


def open_url(url: str) -> InputContainer:
    """A stream or a file behind a URL whose scheme is in ``URL_PROTOCOLS``; gives up within 10 s.

    Raises:
        VideoError: nobody answers, or what answers is no video.
    """
    scheme = url.partition(":")[0].lower()
    options = {"protocol_whitelist": URL_PROTOCOLS[scheme], "format_whitelist": _URL_FORMATS}
    if scheme.startswith("rtsp"):
        options["rtsp_transport"] = "tcp"  # over UDP, lost packets tear pictures
    begun_s = time.monotonic()
    try:
        return av.open(url, "r", options=options, metadata_errors="replace", timeout=(_OPEN_TIMEOUT_S, _READ_TIMEOUT_S))
    except (av.FFmpegError, OSError) as exc:
        shown = without_password(url)
        is_late = time.monotonic() - begun_s >= _OPEN_TIMEOUT_S  # some protocols call an interruption bad data
        why = "no answer in time" if is_late else explain(exc)
        raise VideoError(f"{shown}: cannot be opened: {why}; check the address, and that it plays") from exc


def open_camera(number: int) -> InputContainer:
    """The camera of this number, from 0.

    Raises:
        VideoError: there is no such camera, or it may not be used; the message names those that exist.
    """
    device, driver = _camera_device(number)
    try:
        return av.open(device, "r", format=driver)
    except (av.FFmpegError, OSError, ValueError) as exc:
        if isinstance(exc, PermissionError):
            raise VideoError(f"camera {device}: it may not be used; check its permissions") from exc
        if isinstance(exc, FileNotFoundError):
            raise VideoError(f"no camera {device}; {_existing_cameras()}") from exc
        raise VideoError(f"camera {device}: cannot be opened: {explain(exc)}; {_existing_cameras()}") from exc


def _camera_device(number: int) -> tuple[str, str]:
    """(device, FFmpeg's driver) of a camera."""
    if sys.platform.startswith("linux"):
        return f"/dev/video{number}", "video4linux2"
    if sys.platform == "darwin":
        return str(number), "avfoundation"
    raise VideoError(
        f"camera {number}: cameras cannot be opened by number on {sys.platform}; "
        "send the camera's picture as a stream (ffmpeg -f dshow -i video=NAME ...) and open that URL"
    )


def _existing_cameras() -> str:
    found = sorted(str(device) for device in Path("/dev").glob("video[0-9]*"))
    return f"found: {', '.join(found)}" if found else "none found; is it plugged in?"


def video_stream(container: InputContainer, shown: str) -> VideoStream:
    """The container's first real video stream, set up for decoding on two threads.

    Raises:
        VideoError: there is only sound (a cover picture is no video), or no decoder.
    """
    streams = [s for s in container.streams.video if not s.disposition & av.stream.Disposition.attached_pic]
    if not streams:
        held = "only sound" if container.streams.audio else "no picture and no sound"
        raise VideoError(f"{shown}: no video in it, {held}; give a file that has pictures")
    stream = streams[0]
    if stream.codec_context is None:
        raise VideoError(f"{shown}: nothing here can decode its video; convert it to H.264 first")
    stream.codec_context.options = {"max_pixels": str(MAX_PIXELS)}
    stream.thread_type = "AUTO"
    stream.codec_context.thread_count = 2
    return stream


def explain(exc: Exception) -> str:
    """An error of FFmpeg in a few words without names of files."""
    if isinstance(exc, av.error.ExitError):
        return "no answer in time"
    if isinstance(exc, av.error.BlockingIOError | av.error.InvalidDataError):  # FFmpeg finds no place to go on
        return "the data makes no sense"
    if isinstance(exc, av.error.ProtocolNotFoundError):
        return "this build of FFmpeg has no support for it"
    text = exc.strerror if isinstance(exc, av.FFmpegError | OSError) else str(exc)
    return one_line(text or type(exc).__name__)


def without_password(url: str) -> str:
    """``url`` for messages, its password hidden.

    >>> without_password("rtsp://admin:secret@10.0.0.5/1")
    'rtsp://admin:***@10.0.0.5/1'
    """
    return one_line(re.sub(r"(?<=://)([^/:@]*):[^/]*@", r"\1:***@", url))


def one_line(text: object) -> str:
    """``text`` as a single printable line; names of files may hold anything."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))
