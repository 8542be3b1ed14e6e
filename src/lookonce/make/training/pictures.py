"""Picture files as Pillow pictures, upright and no larger than is of use."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from lookonce.errors import FormatError
from lookonce.video.opening import one_line

__all__ = ["open_picture"]

_FORMATS = ("JPEG", "PNG", "BMP", "WEBP", "TIFF", "PPM")  # what lookonce.open_video reads
_LARGER = 2  # a picture is kept so many times as large as the network's input, where it has as many pixels
# What Pillow raises for damaged files, by its plugins; OSError and ValueError cover most.
_DAMAGED = (
    *(OSError, ValueError, TypeError, KeyError, IndexError, AttributeError, SyntaxError, OverflowError, EOFError),
    *(struct.error, Image.DecompressionBombError),
)


def open_picture(path: Path, size: tuple[int, int]) -> tuple[Image.Image, NDArray[np.float64]]:
    """The picture upright in RGB, shrunk where it is much larger than the network's input of ``size``.

    Returns:
        The picture, and by what (4,) a box xyxy in px of the upright file is to be multiplied.

    Raises:
        FormatError: it is no picture, or damaged.
    """
    height, width = size
    try:
        with Image.open(path, formats=_FORMATS) as file:
            whole = file.size
            file.draft("RGB", (_LARGER * width, _LARGER * height))  # JPEG: decodes 2, 4 or 8 times smaller
            drafted = file.size
            upright = ImageOps.exif_transpose(file)
            picture = upright.convert("RGB")
    except _DAMAGED as exc:
        reason = one_line(exc) or type(exc).__name__
        raise FormatError(one_line(path), 0, f"not a picture, or damaged ({reason:.80}); remove it") from exc
    is_turned = picture.size != drafted
    shrink = int(min(picture.width / width, picture.height / height) // _LARGER)
    if shrink > 1:
        picture = picture.reduce(shrink)
    factor = np.array(picture.size) / (whole[::-1] if is_turned else whole)
    return picture, np.tile(factor, 2)
