"""The size of a picture file, from its header."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

from PIL import Image

from lookonce.datasets.text import fault
from lookonce.video.opening import MAX_PIXELS

__all__ = ["picture_size"]

_FORMATS = ("JPEG", "PNG", "BMP", "WEBP", "TIFF", "PPM")  # what lookonce.open_video reads
_ORIENTATION = 0x0112  # EXIF tag
_TURNED = range(5, 9)  # the orientations that swap height and width
_WIDTH, _HEIGHT = 256, 257  # TIFF tags
# What Pillow raises for damaged files, by its plugins.
_DAMAGED = (OSError, ValueError, TypeError, KeyError, IndexError, AttributeError, SyntaxError, OverflowError, EOFError)


def picture_size(path: Path) -> tuple[int, int]:
    """(height, width) in px as ``lookonce.open_video`` shows the picture: turned as its EXIF says.

    Only the header is read.

    Raises:
        FormatError: it is missing, no picture, damaged, or too large.
    """
    too_large = f"more than {MAX_PIXELS / 1e6:.0f} megapixels; make it smaller"
    try:
        with warnings.catch_warnings():  # Pillow warns of sizes that are allowed here, and of damaged EXIF
            warnings.simplefilter("ignore")
            with Image.open(path, formats=_FORMATS) as image:
                height, width = _size(image)
    except Image.DecompressionBombError as exc:
        raise fault(path, 0, too_large) from exc
    except (*_DAMAGED, struct.error) as exc:
        remedy = "copy it again or remove it" if path.exists() else "check the spelling"
        raise fault(path, 0, f"not a picture, or damaged; {remedy}") from exc
    if height * width > MAX_PIXELS:
        raise fault(path, 0, too_large)
    if not height or not width:
        raise fault(path, 0, "a picture without pixels; copy it again or remove it")
    return height, width


def _size(image: Image.Image) -> tuple[int, int]:
    if image.format == "TIFF":  # Pillow turns these by itself or not, by version: ask the tags
        tags = image.tag_v2  # type: ignore[attr-defined]
        width, height, orientation = tags[_WIDTH], tags[_HEIGHT], tags.get(_ORIENTATION, 1)
    else:
        width, height, orientation = *image.size, _orientation(image)
    return (int(width), int(height)) if orientation in _TURNED else (int(height), int(width))


def _orientation(image: Image.Image) -> object:
    """The EXIF orientation; 1 (upright) where there is none or the EXIF is damaged."""
    data = image.info.get("exif")  # not getexif(), which decodes the whole of a PNG
    if not isinstance(data, bytes):
        return 1
    exif = Image.Exif()
    try:
        exif.load(data)
        return exif.get(_ORIENTATION, 1)
    except (*_DAMAGED, struct.error):
        return 1
