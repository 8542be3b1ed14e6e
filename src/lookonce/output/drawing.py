"""Tracks drawn onto a picture: trails, boxes, labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import clip
from lookonce.output.colours import Colour, text_colour, track_colour
from lookonce.output.labels import TextMasks, place_labels, plain_ascii
from lookonce.output.trails import NO_TRAILS, TrailBrush, Trails
from lookonce.structures import NO_ID, Tracks, class_name

__all__ = ["TrackPainter", "draw_tracks"]

_NO_ID_COLOUR: Colour = (190, 190, 190)
_LONGEST_NAME = 20  # characters; the id behind it must stay in view
_SCORE_STRENGTH = 0.8  # of the text's: the identity comes first
_CACHED_PALETTES = 1024  # 768 bytes each


def draw_tracks(
    image: NDArray[np.uint8],
    tracks: Tracks,
    names: Sequence[str] = (),
    trails: Trails = NO_TRAILS,
    font: Path | None = None,
) -> NDArray[np.uint8]:
    """A copy of a picture with its tracks drawn in; for a stream, a ``TrackPainter`` is faster.

    Args:
        image: (H, W, 3) uint8 RGB.
        tracks: the objects; their boxes may reach beyond the picture.
        names: the class names by label.
        trails: paths to draw, from a ``TrailMemory``.
        font: a TrueType or OpenType file for names beyond ASCII; None = Pillow's own, accents dropped.

    Returns:
        (H, W, 3) uint8 RGB.

    Raises:
        ConfigError: the font cannot be read.
    """
    return TrackPainter(names, font).draw(image, tracks, trails)


@dataclass(frozen=True, slots=True)
class _Style:
    """Sizes in px that suit one picture size."""

    font_px: int
    line_px: int
    trail_px: float

    @classmethod
    def fitting(cls, size: tuple[int, int]) -> _Style:
        """Grows slower than the picture: 10 px text at 320x240, 14 at 960x540, 22 at 1920x1080."""
        diagonal = math.hypot(*size)
        font = max(10, round(6 + 0.0075 * diagonal))
        line = max(1, round(font / 7))
        return cls(font, line, 1.25 * line + 0.75)


class TrackPainter:
    """Draws tracks, and keeps rendered text between calls; the memory it takes is bounded.

    Args:
        names: the class names by label.
        font: a TrueType or OpenType file for names beyond ASCII; None = Pillow's own, accents dropped.

    Raises:
        ConfigError: the font cannot be read.
    """

    def __init__(self, names: Sequence[str], font: Path | None = None) -> None:
        self._names = [_shorten(name if font else plain_ascii(name)) for name in names]
        self._font = font
        self._size = (0, 0)
        self._style = _Style.fitting(self._size)
        self._texts = TextMasks(self._style.font_px, font)
        self._brush = TrailBrush()
        self._palettes: dict[int, NDArray[np.uint8]] = {}

    def draw(self, image: NDArray[np.uint8], tracks: Tracks, trails: Trails = NO_TRAILS) -> NDArray[np.uint8]:
        """A copy of ``image`` ``(H, W, 3) uint8`` RGB with trails, boxes and labels.

        Objects without identity get a thin grey box and no label. Boxes outside the picture, and boxes with numbers
        that are not finite, are left out.
        """
        canvas = np.array(image, order="C")
        height, width = canvas.shape[:2]
        self._fit((height, width))
        self._brush.paint_(canvas, trails, self._style.trail_px)
        rows, boxes = _visible(tracks, (height, width))
        ids = tracks.ids[rows]
        for identity, box in zip(ids.tolist(), boxes.tolist(), strict=True):
            if identity == NO_ID:
                _paint_box_(canvas, box, 1, _NO_ID_COLOUR)
            else:
                _paint_box_(canvas, box, self._style.line_px, track_colour(identity))
        known = ids != NO_ID
        self._paint_labels_(canvas, tracks, rows[known], boxes[known])
        return canvas

    def _fit(self, size: tuple[int, int]) -> None:
        if size == self._size:
            return
        style = _Style.fitting(size)
        if style.font_px != self._style.font_px:
            self._texts = TextMasks(style.font_px, self._font)
        self._size, self._style = size, style

    def _paint_labels_(
        self, canvas: NDArray[np.uint8], tracks: Tracks, rows: NDArray[np.int64], boxes: NDArray[np.int64]
    ) -> None:
        ids, labels, scores = (column[rows].tolist() for column in (tracks.ids, tracks.labels, tracks.scores))
        stamps = [self._stamp(*values) for values in zip(ids, labels, scores, strict=True)]
        sizes = np.array([stamp.shape[:2] for stamp in stamps], np.int64).reshape(-1, 2)
        order = np.argsort(ids, kind="stable")  # by id, so that the choice does not change with the detector's order
        corners = place_labels(boxes, sizes, self._size, order)
        for stamp, (left, top) in zip(stamps, corners.tolist(), strict=True):
            area = canvas[top : top + stamp.shape[0], left : left + stamp.shape[1]]
            area[...] = stamp[: area.shape[0], : area.shape[1]]

    def _stamp(self, identity: int, label: int, score: float) -> NDArray[np.uint8]:
        """The label ``name id score`` as (h, w, 3) uint8 RGB."""
        texts = self._texts
        masks = [texts(f"{class_name(self._names, label)} {identity}")]
        if math.isfinite(score):
            masks.append((texts(f"{score:.2f}") * _SCORE_STRENGTH).astype(np.uint8))
        return np.take(self._palette(identity), np.concatenate(masks, axis=1), axis=0)

    def _palette(self, identity: int) -> NDArray[np.uint8]:
        """(256, 3) uint8: from the identity's colour to that of its text."""
        palette = self._palettes.get(identity)
        if palette is None:
            if len(self._palettes) >= _CACHED_PALETTES:
                self._palettes.clear()
            ground = track_colour(identity)
            mix = np.linspace(0, 1, 256)[:, None]
            palette = np.rint((1 - mix) * np.array(ground) + mix * np.array(text_colour(ground))).astype(np.uint8)
            self._palettes[identity] = palette
        return palette


def _shorten(name: str) -> str:
    """One line of at most 20 characters."""
    name = " ".join(name.split())
    return name if len(name) <= _LONGEST_NAME else name[: _LONGEST_NAME - 1].rstrip() + "…"


def _visible(tracks: Tracks, size: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows with a part inside the picture, and that part in whole px: rows (V,), xyxy (V, 4) int64."""
    finite = np.flatnonzero(np.isfinite(tracks.xyxy).all(axis=1))
    boxes = np.rint(clip(tracks.xyxy[finite], size)).astype(np.int64)
    inside = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    return finite[inside], boxes[inside]


def _paint_box_(canvas: NDArray[np.uint8], box: Sequence[int], line_px: int, colour: Colour) -> None:
    """Draw into ``canvas`` a frame whose outer border is ``box``, with a dark seam around it."""
    left, top, right, bottom = box
    for seam in _sides((max(left - 1, 0), max(top - 1, 0), right + 1, bottom + 1), 1):
        area = canvas[seam]
        np.right_shift(area, 1, out=area)
    for side in _sides((left, top, right, bottom), line_px):
        canvas[side] = colour


def _sides(box: tuple[int, int, int, int], thickness: int) -> tuple[tuple[slice, slice], ...]:
    """The four sides of a frame, as slices that do not overlap."""
    left, top, right, bottom = box
    inner_top, inner_bottom = min(top + thickness, bottom), max(bottom - thickness, top)
    inner_left, inner_right = min(left + thickness, right), max(right - thickness, left)
    across, down = slice(left, right), slice(inner_top, inner_bottom)
    return (
        (slice(top, inner_top), across),
        (slice(inner_bottom, bottom), across),
        (down, slice(left, inner_left)),
        (down, slice(inner_right, right)),
    )
