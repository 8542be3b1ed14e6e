"""Small grey pictures and pyramids of them: whole numbers only, so that every sum over them is exact."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from lookonce.letterbox import Fit

__all__ = ["Pyramid", "gather", "luma_of_canvas", "make_pyramid", "pyramid_of_level", "windows", "working_size"]

_LONG_SIDE_PX = 320  # what the longer side of the lowest level is near to; below, sub-pixel precision goes
_FULL_SCALE = 4  # a grey level in units of the pyramid: the mean of four pixels keeps its fraction
_MOST_INTERLEAVED = 4  # bytes of a px of which one is the luma; pictures with more are copied first
_GREEN = 1  # carries 6 to 7 tenths of the luma


def luma_of_canvas(canvas: NDArray[np.uint8], placed: Fit) -> NDArray[np.uint8]:
    """The grey picture in a letterboxed one: its green, without the bars; a view, nothing is copied.

    Args:
        canvas: (H, W, 3) uint8 RGB.
        placed: where the picture lies in it.

    Returns:
        (h, w) uint8.
    """
    (top, left), (height, width) = placed.offset, placed.scaled
    return canvas[top : top + height, left : left + width, _GREEN]


@dataclass(frozen=True, slots=True)
class Pyramid:
    """A picture at sizes each of which is half of the one before.

    Attributes:
        levels: (h, w) int16 each, in quarters of a grey level, as far as they are made; ``level`` gives them. "Working
            px" are those of the first.
        factor: px of the picture for one of the first level.
        size: (height, width) of the picture that it was made from.
    """

    levels: list[NDArray[np.int16]]
    factor: int
    size: tuple[int, int]

    def level(self, number: int) -> NDArray[np.int16]:
        """A level (h, w) from 0, made when it is first asked for: most frames need one or two."""
        while len(self.levels) <= number:
            self.levels.append(_halve(self.levels[-1]))
        return self.levels[number]

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) of the first level."""
        height, width = self.levels[0].shape
        return height, width


def make_pyramid(luma: NDArray[np.uint8]) -> Pyramid:
    """The pyramid of a grey picture (h, w) uint8 of any size; its rows and columns may be apart in memory."""
    height, width = luma.shape
    factor = _factor((height, width))
    return Pyramid([_shrink(luma, factor)], factor, (height, width))


def pyramid_of_level(first: NDArray[np.int16], size: tuple[int, int]) -> Pyramid:
    """The pyramid of a picture of ``size`` (height, width) whose first level is at hand, of ``working_size``."""
    return Pyramid([first], _factor(size), size)


def working_size(size: tuple[int, int]) -> tuple[int, int]:
    """(height, width) of the first level of a picture of ``size``."""
    factor = _factor(size)
    return size[0] // factor, size[1] // factor


def _factor(size: tuple[int, int]) -> int:
    return max(1, (max(size) + _LONG_SIDE_PX // 2) // _LONG_SIDE_PX)


def _shrink(luma: NDArray[np.uint8], factor: int) -> NDArray[np.int16]:
    """Means of ``factor`` x ``factor`` px in quarters of a grey level; of large blocks nine px stand for all."""
    height, width = (side // factor for side in luma.shape)
    picked = range(factor) if factor <= 3 else (factor // 6, factor // 2, factor - 1 - factor // 6)
    if not 1 <= luma.strides[1] <= _MOST_INTERLEAVED:
        luma = np.ascontiguousarray(luma)
    apart = luma.strides[1]
    rows = as_strided(luma, (height * factor, (luma.shape[1] - 1) * apart + 1), (luma.strides[0], 1), writeable=False)
    lines = (rows[down::factor] for down in picked)  # with what lies between: one byte after the other is faster
    added = reduce(lambda one, other: np.add(one, other, dtype=np.uint16), lines)
    columns = (added[:, across * apart :: factor * apart][:, :width] for across in picked)
    total = reduce(np.add, columns).astype(np.uint16)
    if len(picked) != 2:  # else the sum of four is what is wanted
        total *= _FULL_SCALE
        total //= len(picked) ** 2
    return total.view(np.int16)


def _halve(picture: NDArray[np.int16]) -> NDArray[np.int16]:
    height, width = (side // 2 for side in picture.shape)
    cut = picture[: 2 * height, : 2 * width]
    rows = cut[0::2] + cut[1::2]
    half: NDArray[np.int16] = (rows[:, 0::2] + rows[:, 1::2]) >> 2
    return half


def gather(
    picture: NDArray[np.int16], tops: NDArray[np.int64], lefts: NDArray[np.int64], side: int
) -> NDArray[np.int16]:
    """Square patches (N, side, side) of a picture, all of them inside it."""
    return windows(picture, (side, side))[tops, lefts]


def windows(picture: NDArray[np.int16], shape: tuple[int, int]) -> NDArray[np.int16]:
    """All windows (rows, columns, *shape) of a picture; a view that must not be written to."""
    (rows, columns), (height, width) = picture.strides, picture.shape
    view: NDArray[np.int16] = np.ndarray(  # as_strided, without its cost
        (height - shape[0] + 1, width - shape[1] + 1, *shape), np.int16, picture, 0, (rows, columns, rows, columns)
    )
    return view
