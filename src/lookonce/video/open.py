"""Which kind of source a name means."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Callable
from os import PathLike
from pathlib import Path

from lookonce.errors import ConfigError, VideoError
from lookonce.video.container import camera_source, file_source, url_source
from lookonce.video.images import folder_source, is_image, natural_order, pictures_source
from lookonce.video.opening import URL_PROTOCOLS, one_line, without_password
from lookonce.video.selection import Selection
from lookonce.video.source import VideoSource

__all__ = ["open_video"]

_URL = re.compile(r"([a-z][a-z0-9+.-]*)://", re.IGNORECASE)
_CAMERA = re.compile(r"(?:/dev/video)?(\d+)")
_GLOB = re.compile(r"[*?\[]")


def open_video(
    source: str | int | PathLike[str],
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    every: int = 1,
    fps: float | None = None,
    max_frames: int | None = None,
) -> VideoSource:
    """Any source as an iterable of frames; see ``VideoSource``.

    Args:
        source: a video file; a folder of pictures (also a MOTChallenge or UA-DETRAC sequence) or one picture; a glob
            such as ``"frames/*.jpg"``; a camera (0, ``"0"``, ``"/dev/video0"``); or a URL (rtsp, http, rtmp, srt, ...).
        start_s: leave out what comes before; seconds since the first frame, >= 0.
        end_s: leave out what comes at this time and later; seconds.
        every: yield only frames whose index is a multiple of this.
        fps: frames per second of a folder of pictures; videos have their own clock.
        max_frames: stop after so many frames.

    Raises:
        VideoError: the source cannot be opened, or holds no frame that is wanted.
        ConfigError: a setting cannot work, or does not fit this kind of source.
    """
    selection = Selection(start_s, end_s, every, max_frames)
    name = str(source) if isinstance(source, int) else os.fspath(source)
    camera = _CAMERA.fullmatch(name)
    if camera and (isinstance(source, int) or name.startswith("/dev/") or not Path(name).exists()):
        return _timed(fps, lambda: camera_source(int(camera[1]), selection))
    url = _URL.match(name)
    if url:
        if url[1].lower() not in URL_PROTOCOLS:
            known = ", ".join(URL_PROTOCOLS)
            raise VideoError(f"{without_password(name)}: {url[1]}:// cannot be read; expected a path or one of {known}")
        return _timed(fps, lambda: url_source(name, selection))
    if Path(name).exists() or not _GLOB.search(name):
        return _open_path(Path(name), selection, fps)
    return _open_glob(name, selection, fps)


def _timed(fps: float | None, open_it: Callable[[], VideoSource]) -> VideoSource:
    """Opens a source that has a clock, for which ``fps`` makes no sense."""
    if fps is not None:
        raise ConfigError("a video has its own clock; --fps is for image folders")
    return open_it()


def _open_path(path: Path, selection: Selection, fps: float | None) -> VideoSource:
    if path.is_dir():
        return folder_source(path, selection, fps)
    if is_image(path) and path.exists():
        return pictures_source([path], selection, fps, name=path.stem, shown=one_line(path))
    return _timed(fps, lambda: file_source(path, selection))


def _open_glob(pattern: str, selection: Selection, fps: float | None) -> VideoSource:
    paths = natural_order(Path(match) for match in glob.glob(pattern, recursive=True))
    if not paths:
        raise VideoError(f"no such file: nothing matches {one_line(pattern)}; check the spelling")
    if len(paths) == 1:
        return _open_path(paths[0], selection, fps)
    if not all(is_image(path) for path in paths):
        raise ConfigError(
            f"{one_line(pattern)} matches {len(paths)} files that are not all pictures; give one at a time"
        )
    folder = paths[0].resolve().parent
    name = folder.parent.name if folder.name == "img1" else folder.name
    return pictures_source(paths, selection, fps, name=name or "images", shown=one_line(pattern))
