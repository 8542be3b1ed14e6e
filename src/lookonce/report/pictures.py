"""The pictures of a page: cut out of the frames of a local folder or video, small, and bounded in bytes."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.datasets.truth import picture_folder
from lookonce.errors import LookonceError
from lookonce.report.markup import data_uri
from lookonce.video import Frame, open_video
from lookonce.video.images import frame_indices, is_image, pictures_in

__all__ = ["CROP_SIZE", "MOST_CROP_BYTES", "Crop", "backdrop", "cut", "find_source", "frames_of", "heat"]

CROP_SIZE = (210, 280)
"""(height, width) in px of a picture of an object."""

MOST_CROP_BYTES = 14_000

_SURROUNDINGS = 2.6  # so many times as wide or as high as the object
_LEAST_WINDOW_PX = 48.0  # of the original picture's height; less is only pixels
_BACKDROP_WIDTH, _MOST_BACKDROP_BYTES = 480, 40_000
_QUALITIES = (78, 66, 54, 42, 30, 18, 8)
_URL = re.compile(r"[a-z][a-z0-9+.-]*://", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Crop:
    """An object and what is around it.

    Attributes:
        uri: the picture as a JPEG within the page.
        window: left, top, right, bottom in px of the original picture: what is shown.
    """

    uri: str
    window: tuple[float, float, float, float]


def find_source(*candidates: str | Path) -> Path | None:
    """The first that is a folder with pictures, a picture or a file; never a URL, a camera or a device."""
    for candidate in candidates:
        if not str(candidate) or _URL.match(str(candidate)):
            continue
        if os.path.isdir(candidate):  # pathlib raises for a name that is too long
            if pictures_in(picture_folder(Path(candidate))):
                return Path(candidate)
        elif os.path.isfile(candidate):
            return Path(candidate)
    return None


def frames_of(source: Path, wanted: Set[int], on_frame: Callable[[int], None] = lambda done: None) -> Iterator[Frame]:
    """The wanted frames in rising order; of a folder only their files are opened, of a video none beyond the last.

    Args:
        source: as ``find_source`` gives it.
        wanted: numbers of frames from 0; those that are not there, or damaged in a folder, do not come.
        on_frame: told how many of them are done.

    Raises:
        VideoError: it cannot be read at all.
    """
    last, done = max(wanted, default=-1), 0
    if last < 0:
        return
    if source.is_dir():
        paths = pictures_in(picture_folder(source))
        for index, path in zip(frame_indices(paths), paths, strict=True):
            if index in wanted:
                yield from _still(path, index)
                done += 1
                on_frame(done)
        return
    if is_image(source):
        if 0 in wanted:
            yield from _still(source, 0)
        return
    with open_video(source) as video:
        for frame in video:
            if frame.index in wanted:
                yield frame
                done += 1
                on_frame(done)
            if frame.index >= last:
                return


def _still(path: Path, index: int) -> Iterator[Frame]:
    try:
        with open_video(path) as picture:
            frames = list(picture)
    except LookonceError:  # a damaged picture among many is no reason to give up
        return
    for frame in frames:
        yield Frame(index, frame.time_s, frame.picture, frame.rotation)


def cut(image: NDArray[np.uint8], xyxy: NDArray[np.float64]) -> Crop:
    """A box with its surroundings; at the border of the picture the window moves inwards.

    Args:
        image: (H, W, 3) uint8 RGB.
        xyxy: (4,) float64, px.
    """
    height, width = image.shape[:2]
    aspect = CROP_SIZE[1] / CROP_SIZE[0]
    left, top, right, bottom = xyxy.tolist()
    tall = max(_SURROUNDINGS * (bottom - top), _SURROUNDINGS * (right - left) / aspect, _LEAST_WINDOW_PX)
    tall = min(tall, float(height), width / aspect)
    wide = tall * aspect
    x = min(max((left + right - wide) / 2, 0.0), width - wide)
    y = min(max((top + bottom - tall) / 2, 0.0), height - tall)
    window = (x, y, x + wide, y + tall)
    picture = Image.fromarray(image).resize(CROP_SIZE[::-1], Image.Resampling.BICUBIC, box=window, reducing_gap=3.0)
    return Crop(data_uri("image/jpeg", _jpeg(picture, MOST_CROP_BYTES)), window)


def backdrop(image: NDArray[np.uint8]) -> str:
    """A frame in grey, at most 480 px wide, to lay colours over."""
    picture = Image.fromarray(image).convert("L")
    scale = min(1.0, _BACKDROP_WIDTH / picture.width)
    size = max(1, round(picture.width * scale)), max(1, round(picture.height * scale))
    return data_uri("image/jpeg", _jpeg(picture.resize(size, Image.Resampling.BOX), _MOST_BACKDROP_BYTES))


def _jpeg(picture: Image.Image, most_bytes: int) -> bytes:
    """The best quality that is small enough, or the worst."""
    data = b""
    for quality in _QUALITIES:
        file = io.BytesIO()
        picture.save(file, "JPEG", quality=quality, optimize=True)
        data = file.getvalue()
        if len(data) <= most_bytes:
            break
    return data


def heat(counts: NDArray[np.int64], colour: tuple[int, int, int], most: int) -> str:
    """Counts by place as a small picture of one colour, the more opaque the more there are; a pixel a cell.

    Args:
        counts: (rows, columns) int64.
        colour: red, green, blue.
        most: the count that is drawn opaque; the square root of the share is drawn, so that few are seen, too.
    """
    share = np.sqrt(np.minimum(counts / max(1, most), 1.0))
    pixels = np.empty((*counts.shape, 4), np.uint8)
    pixels[..., :3] = colour
    pixels[..., 3] = np.where(counts > 0, np.rint(60 + 195 * share), 0)
    file = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(file, "PNG", optimize=True)
    return data_uri("image/png", file.getvalue())
