"""Whether a file ends before its own outermost structure says that it should.

MP4, MKV and AVI files consist of elements that state their size. This is the only sign of a cut file that good files,
with a variable frame rate or with sound that outlasts the picture, never show. Only sizes are read, nothing is trusted.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

__all__ = ["declared_size", "lacks_index"]

_EBML = b"\x1a\x45\xdf\xa3"
_SEGMENT = b"\x18\x53\x80\x67"
_MP4_BRANDS = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"styp")
_MAX_ELEMENTS = 1_000_000  # a bound on work for a file made to have many tiny elements


def declared_size(path: Path) -> int | None:
    """The size in bytes that the file's outermost elements add up to; None if they do not say."""
    with path.open("rb") as file:
        head = file.read(12)
        if head[4:8] in _MP4_BRANDS:
            return max((end for _, end in _boxes(file)), default=None)
        if head[:4] == _EBML:
            return _matroska_size(file)
        if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
            return _riff_size(file)
    return None


def lacks_index(path: Path) -> bool:
    """True for an MP4 file without its index: it was cut short, or its writer never closed it."""
    with path.open("rb") as file:
        if file.read(12)[4:8] not in _MP4_BRANDS:
            return False
        return all(kind != b"moov" for kind, _ in _boxes(file))


def _boxes(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """(kind, end in bytes) of each outermost MP4 box, the last of which may end behind the file."""
    size = os.fstat(file.fileno()).st_size
    start = 0
    for _ in range(_MAX_ELEMENTS):
        file.seek(start)
        head = file.read(16)
        if len(head) < 8:
            return
        length, kind = struct.unpack(">I4s", head[:8])
        if length == 1 and len(head) == 16:
            length = struct.unpack(">Q", head[8:])[0]
        if length == 0:  # "to the end of the file"
            length = size - start
        if length < 8 or not kind.isascii():  # no box: bytes that somebody appended
            return
        start += length
        yield kind, start


def _matroska_size(file: BinaryIO) -> int | None:
    """Where the segment ends, or None if its writer could not know."""
    file.seek(4)
    header = _ebml_length(file)
    if header is None:
        return None
    file.seek(header, os.SEEK_CUR)
    if file.read(4) != _SEGMENT:
        return None
    length = _ebml_length(file)
    return None if length is None else file.tell() + length


def _ebml_length(file: BinaryIO) -> int | None:
    """Reads a variable-length number; None if it is cut off or means "unknown"."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    extra = 8 - first[0].bit_length()
    rest = file.read(extra)
    if len(rest) < extra:
        return None
    bits = 7 * (extra + 1)
    value = int.from_bytes(first + rest, "big") & ((1 << bits) - 1)
    return None if value == (1 << bits) - 1 else value


def _riff_size(file: BinaryIO) -> int | None:
    """Where the last RIFF chunk ends; long AVI files have several, and one that was never closed says 0."""
    end = 0
    for _ in range(_MAX_ELEMENTS):
        file.seek(end)
        head = file.read(8)
        if len(head) < 8 or head[:4] != b"RIFF":
            return end or None
        length = struct.unpack("<I", head[4:])[0]
        if length == 0:
            return None
        end += 8 + length
    return None
