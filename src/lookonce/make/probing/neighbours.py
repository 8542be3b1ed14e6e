"""A sheet of queries and their nearest neighbours, to see what descriptors take for the same."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from lookonce.make.probing.whole_file import write_whole

__all__ = ["Neighbourhood", "ShownObject", "draw_neighbours"]

_GROUND, _CELL_GROUND, _TEXT, _FAINT_TEXT = (24, 24, 24), (48, 48, 48), (240, 240, 240), (170, 170, 170)
_QUERY_COLOUR = (235, 235, 235)
# Bluish green and vermilion of Okabe and Ito's palette; the mark in the corner says the same without colour.
_SAME_COLOUR, _OTHER_COLOUR = (0, 158, 115), (213, 94, 0)
_CELL_AREA_PX = 14_000  # 118 px square; the shape follows the crops
_CELL_SIDES_PX = (92, 152)  # a distance and an identity of six figures fit into the least
_FRAME_PX = 5
_GAP_PX = 14
_MARK_PX = 18
_FONT_PX = 14
_LINE_PX = 18
_HEADER_PX = 34


@dataclass(frozen=True, slots=True)
class ShownObject:
    """One picture on the sheet, checked on construction.

    Attributes:
        crop: (H, W, 3) uint8 RGB, at least 1 x 1.
        identity: who it is.
        time_s: when, within its sequence.
        distance: to the query, 0 to 2; of no meaning for the query itself.
        is_same: the identity is the query's.
    """

    crop: NDArray[np.uint8]
    identity: int
    time_s: float
    distance: float = 0.0
    is_same: bool = True

    def __post_init__(self) -> None:
        crop = self.crop
        if crop.ndim != 3 or crop.shape[2] != 3 or crop.dtype != np.uint8 or crop.size == 0:
            raise ValueError(f"crop: expected (H, W, 3) uint8, not empty, got {crop.shape} {crop.dtype}")


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """A row of the sheet: a query and its neighbours, nearest first."""

    query: ShownObject
    neighbours: tuple[ShownObject, ...]


def draw_neighbours(path: Path, rows: Sequence[Neighbourhood]) -> None:
    """Write a PNG with one row for each query: the query on the left, then its neighbours as given.

    The frame is green with a tick where the neighbour is the query's identity, orange-red with a cross where not; below
    stand the distance, the identity and the time. The cells take the usual shape of the crops.

    Args:
        path: the file; an existing one is replaced.
        rows: drawn in this order; none give a sheet that says so.

    Raises:
        OutputError: the file cannot be written.
    """
    picture = io.BytesIO()
    _sheet(rows).save(picture, format="PNG")
    write_whole(path, picture.getvalue())


def _sheet(rows: Sequence[Neighbourhood]) -> Image.Image:
    cell_height, cell_width = _cell_size(rows)
    columns = 1 + max((len(row.neighbours) for row in rows), default=0)
    step_x = cell_width + 2 * _FRAME_PX + _GAP_PX
    step_y = cell_height + 2 * _FRAME_PX + 2 * _LINE_PX + _GAP_PX
    # The query stands a little apart, and the legend above needs room for itself.
    width = max(2 * _GAP_PX + columns * step_x, 620)
    sheet = Image.new("RGB", (width, _HEADER_PX + _GAP_PX + max(len(rows), 1) * step_y), _GROUND)
    brush = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(_FONT_PX)
    _draw_legend_(brush, font, step_x if rows else None)
    for number, row in enumerate(rows):
        top = _HEADER_PX + _GAP_PX + number * step_y
        for column, shown in enumerate((row.query, *row.neighbours)):
            left = _GAP_PX + column * step_x + (_GAP_PX if column else 0)
            _draw_cell_(sheet, (left, top), (cell_height, cell_width), shown, is_query=column == 0)
            _draw_caption_(brush, font, (left, top + cell_height + 2 * _FRAME_PX), shown, is_query=column == 0)
    return sheet


def _cell_size(rows: Sequence[Neighbourhood]) -> tuple[int, int]:
    """(height, width) in px of every picture: of one area, in the middle shape of the crops."""
    shapes = [shown.crop.shape for row in rows for shown in (row.query, *row.neighbours)]
    aspect = float(np.median([width / height for height, width, _ in shapes])) if shapes else 1.0
    least, most = _CELL_SIDES_PX
    width = min(max(round((_CELL_AREA_PX * aspect) ** 0.5), least), most)
    return min(max(round(_CELL_AREA_PX / width), least), most), width


def _draw_legend_(brush: ImageDraw.ImageDraw, font: _Font, step_x: int | None) -> None:
    """Draw the line above the rows into the sheet; without rows it says that there are none."""
    y = _HEADER_PX // 2 + 2
    if step_x is None:
        brush.text((_GAP_PX, y), "No queries to show.", fill=_TEXT, font=font, anchor="lm")
        return
    brush.text((_GAP_PX, y), "Query", fill=_TEXT, font=font, anchor="lm")
    x = 2 * _GAP_PX + step_x
    for is_same, text in ((None, "Nearest first:"), (True, "same object"), (False, "another object")):
        if is_same is not None:
            _draw_mark_(brush, (x, y - _MARK_PX // 2), is_same)
            x += _MARK_PX + 6
        brush.text((x, y), text, fill=_TEXT, font=font, anchor="lm")
        x += round(font.getlength(text)) + 18
    brush.text((x, y), "number = distance", fill=_FAINT_TEXT, font=font, anchor="lm")


def _draw_cell_(
    sheet: Image.Image, corner: tuple[int, int], size: tuple[int, int], shown: ShownObject, is_query: bool
) -> None:
    """Draw into the sheet the crop, as large as the cell allows, within its frame."""
    left, top = corner
    height, width = size
    brush = ImageDraw.Draw(sheet)
    colour = _QUERY_COLOUR if is_query else _SAME_COLOUR if shown.is_same else _OTHER_COLOUR
    brush.rectangle((left, top, left + width + 2 * _FRAME_PX - 1, top + height + 2 * _FRAME_PX - 1), fill=colour)
    inner_left, inner_top = left + _FRAME_PX, top + _FRAME_PX
    brush.rectangle((inner_left, inner_top, inner_left + width - 1, inner_top + height - 1), fill=_CELL_GROUND)
    scale = min(height / shown.crop.shape[0], width / shown.crop.shape[1])
    fitted = max(1, round(shown.crop.shape[1] * scale)), max(1, round(shown.crop.shape[0] * scale))
    crop = Image.fromarray(np.ascontiguousarray(shown.crop)).resize(fitted, Image.Resampling.BICUBIC)
    sheet.paste(crop, (inner_left + (width - fitted[0]) // 2, inner_top + (height - fitted[1]) // 2))
    if not is_query:
        _draw_mark_(brush, (left + width + 2 * _FRAME_PX - _MARK_PX, top), shown.is_same)


def _draw_mark_(brush: ImageDraw.ImageDraw, corner: tuple[int, int], is_same: bool) -> None:
    """Draw into the sheet a small square with a tick or a cross."""
    left, top = corner
    end = _MARK_PX - 1
    brush.rectangle((left, top, left + end, top + end), fill=_SAME_COLOUR if is_same else _OTHER_COLOUR)
    strokes = [((4, 9), (7, 13), (13, 5))] if is_same else [((5, 5), (12, 12)), ((5, 12), (12, 5))]
    for stroke in strokes:
        brush.line([(left + x, top + y) for x, y in stroke], fill=(255, 255, 255), width=2)


def _draw_caption_(
    brush: ImageDraw.ImageDraw, font: _Font, corner: tuple[int, int], shown: ShownObject, is_query: bool
) -> None:
    """Draw into the sheet the two lines below a cell: distance and identity, time."""
    x, y = corner
    middle = y + _LINE_PX // 2 + 2
    brush.text((x, middle + _LINE_PX), f"{shown.time_s:.1f} s", fill=_FAINT_TEXT, font=font, anchor="lm")
    if not is_query:
        distance = f"{shown.distance:.2f}"
        brush.text((x, middle), distance, fill=_TEXT, font=font, anchor="lm")
        x += round(font.getlength(distance)) + 8
    colour = _TEXT if is_query else _FAINT_TEXT
    brush.text((x, middle), f"id {shown.identity}", fill=colour, font=font, anchor="lm")


_Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
