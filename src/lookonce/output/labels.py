"""Labels: text as cached masks, and a place for each where it hides least."""

from __future__ import annotations

import unicodedata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from lookonce.errors import ConfigError

__all__ = ["TextMasks", "place_labels", "plain_ascii"]

_CACHED_TEXTS = 1024  # all scores and the names of several crowds; a mask is a few kB
_OWN_BOX_WEIGHT = 0.5  # to hide another label is twice as bad as to hide one's own object


class TextMasks:
    """Pieces of text in one font size, rendered once and kept, at most 1024 of them.

    Args:
        font_px: font size in px.
        font: a TrueType or OpenType file; None = Pillow's own font, which has little beyond ASCII.

    Raises:
        ConfigError: the font cannot be read.
    """

    def __init__(self, font_px: int, font: Path | None = None) -> None:
        self._font = _load_font(font, font_px)
        self._masks: dict[str, NDArray[np.uint8]] = {}
        self._padding = max(1, round(font_px / 6))
        # The height is that of figures and capitals, with room for descenders: equal for all texts.
        top, bottom = (round(self._font.getbbox(sample, anchor="ls")[side]) for sample, side in (("0", 1), ("g", 3)))
        self._baseline = self._padding - top
        self.height = self._baseline + max(bottom, self._padding)

    def __call__(self, text: str) -> NDArray[np.uint8]:
        """The coverage ``(height, W) uint8`` of ``text`` with a margin on both sides; not to be modified."""
        mask = self._masks.get(text)
        if mask is None:
            if len(self._masks) >= _CACHED_TEXTS:
                self._masks.clear()
            mask = self._masks[text] = self._render(text)
        return mask

    def _render(self, text: str) -> NDArray[np.uint8]:
        width = round(self._font.getlength(text)) + 2 * self._padding
        canvas = Image.new("L", (width, self.height))
        ImageDraw.Draw(canvas).text((self._padding, self._baseline), text, fill=255, font=self._font, anchor="ls")
        return np.asarray(canvas)


def _load_font(path: Path | None, font_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    if path is None:
        return ImageFont.load_default(font_px)
    try:
        return ImageFont.truetype(str(path), font_px)
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be read as a font ({exc}); give a .ttf or .otf file") from exc


def plain_ascii(text: str) -> str:
    """The text in letters that Pillow's own font has: accents dropped, anything further off as "?".

    >>> plain_ascii("Straßenbahn, vélo, 車")
    'Strassenbahn, velo, ?'
    """
    decomposed = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    kept = "".join(character for character in decomposed if not unicodedata.combining(character))
    return kept.encode("ascii", errors="replace").decode("ascii")


def place_labels(
    boxes: NDArray[np.int64], sizes: NDArray[np.int64], image_size: tuple[int, int], order: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Corners for labels: above the box, else below it, else inside; within the picture, off each other if possible.

    Args:
        boxes: (N, 4) int64, xyxy in px, within the picture.
        sizes: (N, 2) int64, height and width of each label in px.
        image_size: (height, width) of the picture in px.
        order: (N,) int64, the rows in the order in which they choose.

    Returns:
        (N, 2) int64, left and top of each label; a label larger than the picture starts at 0.
    """
    places = _candidates(boxes, sizes, image_size)  # (N, 5, 4) xyxy
    penalty = _OWN_BOX_WEIGHT * _overlap(places, boxes[:, None])  # (N, 5)
    taken = np.zeros((len(boxes), 4), np.int64)
    for count, row in enumerate(order.tolist()):
        hidden = _overlap(places[row][:, None], taken[None, :count]).sum(axis=1)
        best = int(np.argmin(hidden + penalty[row]))  # the first of equals
        taken[count] = places[row, best]
    corners = np.empty((len(boxes), 2), np.int64)
    corners[order] = taken[:, :2]
    return corners


def _candidates(boxes: NDArray[np.int64], sizes: NDArray[np.int64], image_size: tuple[int, int]) -> NDArray[np.int64]:
    """(N, 5, 4) int64: above left, above right, below left, below right, inside; moved into the picture."""
    left, top, right, bottom = boxes.T
    height, width = sizes.T
    corners = np.stack(
        [
            np.stack([left, top - height], axis=1),
            np.stack([right - width, top - height], axis=1),
            np.stack([left, bottom], axis=1),
            np.stack([right - width, bottom], axis=1),
            np.stack([left, top], axis=1),
        ],
        axis=1,
    )
    extent = np.stack([width, height], axis=1)[:, None]
    corners = np.maximum(np.minimum(corners, np.array(image_size[::-1]) - extent), 0)
    return np.concatenate([corners, corners + extent], axis=2)


def _overlap(a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    """Common area in px² of boxes xyxy (..., 4) that broadcast against each other."""
    sides = np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2])
    sides = np.maximum(sides, 0)
    area: NDArray[np.int64] = sides[..., 0] * sides[..., 1]
    return area
