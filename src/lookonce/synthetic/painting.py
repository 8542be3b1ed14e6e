"""Outlines painted on tiles, with soft edges and motion blur."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from lookonce.synthetic.projecting import Outline

__all__ = ["Tile", "blur_along", "paint_tile"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SMALL_PX = 40  # tiles up to this side are painted four times as fine, larger ones twice
_OPAQUE = 128
_MOST_BLUR_PX = 24


@dataclass(frozen=True, slots=True)
class Tile:
    """A painted body.

    Attributes:
        image: RGBA, w x h.
        left: px, of its place in the picture.
        top: px.
        mask: (h, w) pixels that are at least half covered.
        xyxy: (4,) exact extent in px, cut at the picture's border.
        truncation: share of the whole extent that lies outside the picture.
    """

    image: Image.Image
    left: int
    top: int
    mask: Bools
    xyxy: Floats
    truncation: float

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom of the tile in px."""
        return self.left, self.top, self.left + self.image.width, self.top + self.image.height


def paint_tile(outline: Outline, size: tuple[int, int]) -> Tile | None:
    """The part of an outline inside a picture of ``size`` (height, width) px; None = nothing of it is."""
    height, width = size
    left, top, right, bottom = outline.xyxy.tolist()
    if not (right > 0 and bottom > 0 and left < width and top < height):
        return None
    x0, y0 = max(0, math.floor(left)), max(0, math.floor(top))
    x1, y1 = min(width, math.ceil(right)), min(height, math.ceil(bottom))
    if x1 <= x0 or y1 <= y0:
        return None
    fine = 4 if max(x1 - x0, y1 - y0) <= _SMALL_PX else 2
    image = Image.new("RGBA", ((x1 - x0) * fine, (y1 - y0) * fine))
    draw = ImageDraw.Draw(image)
    flat = ((outline.corners - np.array([x0, y0])) * fine - 0.5).ravel().tolist()
    start = 0
    for count, colour in zip(outline.counts, outline.colours, strict=True):
        draw.polygon(flat[start : start + 2 * count], fill=colour)
        start += 2 * count
    is_cut = left < 0 or top < 0 or right > width or bottom > height
    xyxy = _painted_extent(image, fine, x0, y0) if is_cut else outline.xyxy
    if xyxy is None:
        return None
    image = image.reduce(fine)
    mask = np.asarray(image.getchannel("A")) >= _OPAQUE
    area = (right - left) * (bottom - top)
    inside = (min(right, width) - max(left, 0)) * (min(bottom, height) - max(top, 0))
    return Tile(image, x0, y0, mask, xyxy, 1 - inside / area if is_cut else 0.0)


def _painted_extent(image: Image.Image, fine: int, left: int, top: int) -> Floats | None:
    """The extent of what was painted, to a part of a pixel."""
    box = image.getchannel("A").getbbox()
    return None if box is None else np.array(box) / fine + np.array([left, top, left, top])


def blur_along(image: Image.Image, motion: tuple[float, float]) -> tuple[Image.Image, int, int]:
    """The image blurred along a motion in px, and by how much its corner moves; less than 1 px changes nothing."""
    length = min(math.hypot(*motion), _MOST_BLUR_PX)
    if length < 1:
        return image, 0, 0
    share = length / max(math.hypot(*motion), 1e-9)
    steps = min(12, math.ceil(length) + 1)
    offsets = [(motion[0] * share * t, motion[1] * share * t) for t in np.linspace(-0.5, 0.5, steps).tolist()]
    pad_x, pad_y = math.ceil(abs(motion[0]) * share / 2), math.ceil(abs(motion[1]) * share / 2)
    pixels = np.asarray(image).astype(np.uint32)
    pixels[..., :3] *= pixels[..., 3:]
    height, width = pixels.shape[:2]
    total = np.zeros((height + 2 * pad_y, width + 2 * pad_x, 4), np.uint32)
    for x, y in offsets:
        column, row = pad_x + round(x), pad_y + round(y)
        total[row : row + height, column : column + width] += pixels
    colour = total[..., :3] // np.maximum(total[..., 3:], 1)
    blurred = np.concatenate([colour, total[..., 3:] // steps], axis=2).astype(np.uint8)
    return Image.fromarray(blurred), -pad_x, -pad_y
