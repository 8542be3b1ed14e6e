"""TIFF files without the tags that FFmpeg's decoder does not know."""

from __future__ import annotations

import struct

__all__ = ["only_pixels"]

# The tags that say how pixels are stored, whether FFmpeg's decoder knows them or not: TIFF 6.0 (old JPEG from 512 on),
# JPEG tables (347), TIFF/EP colour filters (33421, 33422) and DNG (from 50706 on).
_PIXEL_TAGS = frozenset(
    {254, 256, 257, 258, 259, 262, 266, 273, 277, 278, 279, 284, 292, 293, 317, 320, 322, 323, 324, 325, 330, 347}
    | {*range(512, 522), 529, 530, 33421, 33422, *range(50706, 50730)}
)
_SAMPLE_FORMAT = 339
_UNSIGNED = 1  # whole numbers from 0; FFmpeg takes all samples for such
_MOST_SAMPLES = 8  # per pixel that are looked at; FFmpeg reads up to 4
_ENTRY_BYTES, _INLINE_BYTES = 12, 4


def only_pixels(data: bytes) -> bytes:
    """The file without what its first directory says about other things than pixels: resolution, orientation, notes.

    Where FFmpeg is told to refuse damaged pictures, it also refuses every tag that it does not know, and most TIFF
    files have one. A file whose directory cannot be read comes back as it is.
    """
    order = "<" if data.startswith(b"II") else ">"
    try:
        (start,) = struct.unpack_from(f"{order}I", data, 4)
        (count,) = struct.unpack_from(f"{order}H", data, start)
        first, end = start + 2, start + 2 + count * _ENTRY_BYTES
        entries = [data[place : place + _ENTRY_BYTES] for place in range(first, end, _ENTRY_BYTES)]
        kept = [entry for entry in entries if _is_about_pixels(entry, data, order)]
    except struct.error:
        return data
    directory = struct.pack(f"{order}H", len(kept)) + b"".join(kept) + data[end : end + 4]
    return b"".join([data[:start], directory, data[start + len(directory) :]])


def _is_about_pixels(entry: bytes, data: bytes, order: str) -> bool:
    tag, _, count, place = struct.unpack(f"{order}HHII", entry)
    if tag != _SAMPLE_FORMAT:
        return tag in _PIXEL_TAGS
    formats = f"{order}{min(count, _MOST_SAMPLES)}H"
    if struct.calcsize(formats) <= _INLINE_BYTES:
        return set(struct.unpack_from(formats, entry, 8)) != {_UNSIGNED}
    return set(struct.unpack_from(formats, data, place)) != {_UNSIGNED}
