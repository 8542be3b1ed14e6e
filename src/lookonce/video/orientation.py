"""Which way up a decoded picture belongs."""

from __future__ import annotations

import math
import struct
from typing import cast

import av
import numpy as np
from av.sidedata.sidedata import SideDataContainer, Type
from numpy.typing import NDArray

from lookonce.letterbox import to_rgb

__all__ = ["orient"]

_MATRIX = struct.Struct("=9i")  # FFmpeg's display matrix: a b u, c d v, x y w, in the machine's byte order


def orient(picture: av.VideoFrame) -> tuple[av.VideoFrame | NDArray[np.uint8], int]:
    """The picture, and the quarter turns counter-clockwise that bring it upright.

    The turn comes from the container (phones) or from EXIF (cameras): FFmpeg reports both as a display matrix. Angles
    between quarter turns go to the nearest. A mirrored video, which turns alone cannot mend, comes back as
    ``(H, W, 3) uint8`` RGB with the mirroring undone; mirrored EXIF orientations (2, 4, 5, 7) stay mirrored, because
    PyAV does not show the matrix of a picture that has EXIF.
    """
    degrees = picture.rotation
    if not degrees:
        return picture, 0
    matrix = _display_matrix(picture)
    if matrix is None:
        return picture, round(degrees / 90) % 4
    a, b, c, d = matrix
    if a * d - b * c >= 0:
        return picture, _quarter_turns(a, b)
    return np.ascontiguousarray(to_rgb(picture)[:, ::-1]), _quarter_turns(-a, -b)


def _display_matrix(picture: av.VideoFrame) -> tuple[int, int, int, int] | None:
    """(a, b, c, d) of x' = a x + c y, y' = b x + d y with y downwards, or None where PyAV cannot show it."""
    try:
        everything = cast(SideDataContainer, picture.side_data)  # PyAV's stub names another type
    except ValueError:  # PyAV lists all or nothing, and does not know every kind, EXIF among them
        return None
    for data in everything:
        if data.type is Type.DISPLAYMATRIX:
            a, b, _, c, d, *_ = _MATRIX.unpack(bytes(data))
            return a, b, c, d
    return None


def _quarter_turns(a: int, b: int) -> int:
    """Quarter turns counter-clockwise, 0 to 3, of the rotation that takes the x axis to (a, b) with y downwards."""
    return round(math.degrees(math.atan2(-b, a)) / 90) % 4
