"""Folders of pictures, and single pictures, as sources."""

from __future__ import annotations

import configparser
import logging
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import av

from lookonce.errors import ConfigError, VideoError
from lookonce.video.frame import Frame
from lookonce.video.opening import MAX_PIXELS, explain, one_line
from lookonce.video.orientation import orient
from lookonce.video.selection import Selection
from lookonce.video.source import Findings, Frames, VideoSource
from lookonce.video.tiff import only_pixels

__all__ = [
    "IMAGE_SUFFIXES",
    "folder_source",
    "frame_indices",
    "image_folder",
    "is_image",
    "natural_order",
    "pictures_in",
    "pictures_source",
    "sequence_info",
]

log = logging.getLogger(__name__)

IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm"})
_DEFAULT_RATE = 25.0  # frames per second of a folder that names no rate; UA-DETRAC's
_MAX_INFO_BYTES = 1_000_000
_MAX_NAMED = 20  # damaged pictures that get a line of their own
# MOTChallenge (000001.jpg) and UA-DETRAC (img00001.jpg). More digits than this are a time stamp, not a frame number.
_NUMBERED = re.compile(r"(?:img)?(\d{1,9})", re.IGNORECASE)
# By the first bytes, not by the name: many a .jpg is a PNG.
_DECODERS = (
    (b"\xff\xd8\xff", "mjpeg"),
    (b"\x89PNG", "png"),
    (b"BM", "bmp"),
    (b"RIFF", "webp"),
    (b"II*\x00", "tiff"),
    (b"MM\x00*", "tiff"),
    (b"P5", "pgm"),
    (b"P6", "ppm"),
)
_REFUSE_DAMAGE = {"err_detect": "explode"}


@dataclass(frozen=True, slots=True)
class _Entry:
    """A picture file and its place in the sequence."""

    index: int
    time_s: float
    path: Path


def is_image(path: Path) -> bool:
    """Whether the name is that of a picture."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def natural_order(paths: Iterable[Path]) -> list[Path]:
    """Sorted so that img2 comes before img10."""
    return sorted(paths, key=lambda path: ([_number_or_text(t) for t in re.split(r"(\d+)", str(path))], str(path)))


def _number_or_text(text: str) -> tuple[int, str]:
    return (int(text), "") if text.isascii() and text.isdigit() else (-1, text.casefold())


def folder_source(folder: Path, selection: Selection, rate: float | None) -> VideoSource:
    """A folder of pictures, or a MOTChallenge sequence (``img1/`` or ``seqinfo.ini`` inside).

    Args:
        folder: read without its sub-folders.
        selection: which frames.
        rate: frames per second; None = what ``seqinfo.ini`` says, else 25.

    Raises:
        VideoError: it holds no pictures, or none can be decoded.
    """
    paths = pictures_in(folder)
    images, info = folder, sequence_info(folder / "seqinfo.ini")
    if not paths:
        images = image_folder(folder, info.get("imdir") or "img1")
        paths = pictures_in(images)
    elif not info:
        above = sequence_info(folder.parent / "seqinfo.ini")
        info = above if (above.get("imdir") or "img1") == folder.name else {}
    if not paths:
        kinds = ", ".join(sorted(suffix[1:] for suffix in IMAGE_SUFFIXES))
        raise VideoError(f"{one_line(folder)}: no pictures in this folder; expected {kinds}, or a folder img1 of them")
    named = images.resolve()
    name = named.parent.name if named.name == "img1" or named != folder.resolve() else named.name
    return pictures_source(
        paths, selection, _frame_rate(info) if rate is None else rate, name=name or "images", shown=one_line(folder)
    )


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder in natural order, hidden ones left out; empty where there is no folder.

    Raises:
        VideoError: the folder cannot be listed.
    """
    if not folder.is_dir():
        return []
    try:
        return natural_order(path for path in folder.iterdir() if is_image(path) and not path.name.startswith("."))
    except OSError as exc:
        raise VideoError(f"{one_line(folder)}: cannot be listed: {explain(exc)}; check its permissions") from exc


def sequence_info(path: Path) -> dict[str, str]:
    """The [Sequence] section of a MOTChallenge ``seqinfo.ini``, keys in lower case; empty without one.

    Raises:
        VideoError: it cannot be read or understood.
    """
    if not path.is_file():
        return {}
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_INFO_BYTES + 1)
        if len(data) > _MAX_INFO_BYTES:
            raise VideoError(f"{one_line(path)}: larger than {_MAX_INFO_BYTES // 1000} kB; mend or remove it")
        parser.read_string(data.decode("utf-8-sig", errors="replace"))
    except OSError as exc:
        raise VideoError(f"{one_line(path)}: cannot be read: {explain(exc)}; check its permissions") from exc
    except configparser.Error as exc:
        line = getattr(exc, "lineno", 0)
        where = f"{one_line(path)}:{line}" if line else one_line(path)
        raise VideoError(f"{where}: expected [Sequence] and lines of key=value; mend or remove it") from exc
    return dict(parser["Sequence"]) if parser.has_section("Sequence") else {}


def image_folder(folder: Path, name: str) -> Path:
    """The folder ``name`` inside a sequence's ``folder``, for which ``seqinfo.ini`` may give any text.

    Raises:
        VideoError: it lies outside the sequence, also by a link.
    """
    images = folder / name
    if not images.resolve().is_relative_to(folder.resolve()):
        raise VideoError(f"{one_line(folder / 'seqinfo.ini')}: imDir {one_line(name)} lies outside the folder; mend it")
    return images


def _frame_rate(info: dict[str, str]) -> float | None:
    text = info.get("framerate", "")
    return float(text) if re.fullmatch(r"\d+(\.\d+)?", text) and float(text) else None


def pictures_source(
    paths: Sequence[Path], selection: Selection, rate: float | None, *, name: str, shown: str
) -> VideoSource:
    """Picture files in order as a source.

    Args:
        paths: one or more files.
        selection: which frames.
        rate: frames per second; None = 25.
        name: the source's name.
        shown: what messages call it.

    Raises:
        VideoError: none of the wanted pictures can be decoded.
    """
    if rate is None and len(paths) > 1:
        log.warning("%s: states no frame rate; %g frames per second are assumed (--fps)", shown, _DEFAULT_RATE)
    rate = _DEFAULT_RATE if rate is None else rate
    if not 0 < rate < float("inf"):
        raise ConfigError(f"fps: expected frames per second > 0, got {rate}")
    entries = [_Entry(index, index / rate, path) for index, path in zip(frame_indices(paths), paths, strict=True)]
    wanted = list(selection.pick(entries))
    if not wanted:
        length_s = entries[-1].time_s + 1 / rate
        raise VideoError(f"{shown}: start, end and every leave no picture; it is {length_s:.2f} s long at {rate:g} fps")
    findings = Findings()
    return VideoSource(lambda: _read(wanted, findings, shown), findings, name=name, frame_count=len(wanted), rate=rate)


def frame_indices(paths: Sequence[Path]) -> list[int]:
    """Frame numbers from 0 of pictures in order: from the names where all are running numbers, else by position.

    Numbered names keep their numbers even where pictures are missing, so that frames line up with the truth. They count
    from 0 if there is a 0 and else from 1.

    >>> frame_indices([Path("000001.jpg"), Path("000003.jpg")]), frame_indices([Path("a.jpg"), Path("b.jpg")])
    ([0, 2], [0, 1])
    """
    matches = [_NUMBERED.fullmatch(path.stem) for path in paths]
    numbers = [int(match[1]) for match in matches if match]
    if len(numbers) < len(paths) or any(b <= a for a, b in pairwise(numbers)) or len(paths) < 2:
        return list(range(len(paths)))
    start = 0 if numbers[0] == 0 else 1
    return [number - start for number in numbers]


def _read(entries: Sequence[_Entry], findings: Findings, shown: str) -> Frames:
    damaged = 0
    for entry in entries:
        try:
            picture = _decode(entry.path)
        except (av.FFmpegError, OSError, ValueError) as exc:
            damaged += 1
            if damaged <= _MAX_NAMED:
                findings.add(f"{one_line(entry.path)}: not a picture, or damaged ({explain(exc)}); it was left out")
        else:
            yield Frame(entry.index, entry.time_s, *orient(picture))
    if damaged == len(entries):
        raise VideoError(f"{shown}: no picture in it can be decoded; all {damaged} are damaged or no pictures")
    if damaged > _MAX_NAMED:
        findings.add(f"{shown}: {damaged} pictures were left out")


def _decode(path: Path) -> av.VideoFrame:
    """The file's picture in its own pixel format; raises for a damaged one, where FFmpeg would guess what is missing.

    FFmpeg's decoders of JPEG, PNG, WebP and TIFF report the EXIF orientation with the picture.
    """
    data = path.read_bytes()
    codec = next((codec for magic, codec in _DECODERS if data.startswith(magic)), None)
    if codec is None:
        raise ValueError("unknown kind of file")
    if codec != "tiff":
        return _decode_data(data, codec, _REFUSE_DAMAGE)
    pixels = only_pixels(data)
    picture = _decode_data(pixels, codec, _REFUSE_DAMAGE)
    return picture if pixels == data else _decode_data(data, codec, {})  # the same, with its orientation


def _decode_data(data: bytes, codec: str, options: dict[str, str]) -> av.VideoFrame:
    context = av.CodecContext.create(codec, "r")
    assert isinstance(context, av.VideoCodecContext)  # all of _DECODERS are
    context.options = {"max_pixels": str(MAX_PIXELS), **options}
    pictures = [*context.decode(av.Packet(data)), *context.decode(None)]
    if not pictures:
        raise ValueError("no picture in it")
    return pictures[0]
