"""The ground from above, as a map of colours and one of shadows and lamps, and its look from the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from lookonce.synthetic.site import Site, Stroke
from lookonce.synthetic.textures import cloudy_noise

__all__ = ["GroundMap", "draw_ground"]

Floats = NDArray[np.float64]
Pixels = NDArray[np.float32]

_LEAST_SCALE, _MOST_SCALE = 4.0, 12.0  # px of the map for a metre
_PICTURE_PX = 96.0  # of the picture's width for each px that a metre of the map has
_TILE_M = 0.6
_COARSE = 4  # shadows and lamps are drawn so many times coarser
_COLOURS: dict[str, tuple[int, int, int]] = {
    "asphalt": (92, 92, 94),
    "paving": (154, 150, 143),
    "kerb": (176, 174, 168),
    "grass": (88, 112, 58),
    "gravel": (132, 124, 110),
    "cycleway": (112, 82, 76),
    "patch": (76, 76, 79),
    "iron": (58, 54, 52),
    "paint": (216, 216, 210),
}
_WHITE, _YELLOW = (214, 214, 208), (208, 172, 60)
_LAMP_POOL_M = 13.0


@dataclass(frozen=True, slots=True)
class _Sheet:
    """How a map lies on the ground: ``bounds`` xyxy in m, ``scale`` px for a metre."""

    bounds: tuple[float, float, float, float]
    scale: float

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in px."""
        left, bottom, right, top = self.bounds
        return round((right - left) * self.scale), round((top - bottom) * self.scale)

    def coarser(self) -> _Sheet:
        """The same for shadows and lamps."""
        return _Sheet(self.bounds, self.scale / _COARSE)

    def place(self, points: Floats) -> list[float]:
        """Points ``(K, 2)`` in m as x, y, x, y... in px."""
        flat: list[float] = ((points - np.array(self.bounds[:2])) * self.scale - 0.5).ravel().tolist()
        return flat


class GroundMap:
    """A map of the ground around the site.

    Attributes:
        levels: colours 0 to 255, (h, w, 3) float32, each level half as fine as the one before.
        sun: (h, w) float32, share of the sun that reaches the ground.
        lamps: (h, w) float32, light of street lamps, 0 to 1.
    """

    def __init__(
        self,
        albedo: Image.Image,
        sun: Pixels,
        lamps: Pixels,
        bounds: tuple[float, float, float, float],
        scale: float,
    ) -> None:
        self._left, self._bottom, self._right, self._top = bounds
        self._scale = scale
        self.levels = [np.asarray(albedo)]
        while min(albedo.size) > 256 and len(self.levels) < 6:
            albedo = albedo.reduce(2)
            self.levels.append(np.asarray(albedo))
        self.sun, self.lamps = sun, lamps

    def colours(self, x: Floats, y: Floats, grain_m: Floats) -> Pixels:
        """The colours ``(K, 3)`` at places ``(K,)``, each averaged over about ``grain_m (K,)``."""
        result = np.zeros((len(x), 3), np.float32)
        wanted = np.clip(np.round(np.log2(np.maximum(grain_m * self._scale, 1e-3))), 0, len(self.levels) - 1).astype(
            np.int64
        )
        for number, level in enumerate(self.levels):
            rows = np.flatnonzero(wanted == number)
            if len(rows):
                scale = self._scale / 2**number
                result[rows] = _bilinear(
                    level, (x[rows] - self._left) * scale - 0.5, (y[rows] - self._bottom) * scale - 0.5
                )
        return result

    def covers(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Whether places ``(K,)`` are on the map."""
        on_it: NDArray[np.bool_] = (x > self._left) & (x < self._right) & (y > self._bottom) & (y < self._top)
        return on_it

    def light_at(self, x: Floats, y: Floats) -> tuple[Pixels, Pixels]:
        """Share of the sun and light of lamps at places ``(K,)``."""
        scale = self._scale / _COARSE
        column, row = (x - self._left) * scale - 0.5, (y - self._bottom) * scale - 0.5
        sun = _bilinear(self.sun[..., None], column, row)[:, 0]
        lamps = _bilinear(self.lamps[..., None], column, row)[:, 0]
        return sun, lamps


def _bilinear(pixels: NDArray[np.generic], column: Floats, row: Floats) -> Pixels:
    height, width = pixels.shape[:2]
    column, row = np.clip(column, 0, width - 1.001), np.clip(row, 0, height - 1.001)
    x, y = column.astype(np.int64), row.astype(np.int64)
    u, v = (column - x).astype(np.float32)[:, None], (row - y).astype(np.float32)[:, None]
    flat = pixels.reshape(height * width, -1)
    at = y * width + x
    upper = flat[at] * (1 - u) + flat[at + 1] * u
    lower = flat[at + width] * (1 - u) + flat[at + width + 1] * u
    mixed: Pixels = upper * (1 - v) + lower * v
    return mixed


def draw_ground(
    site: Site,
    rng: np.random.Generator,
    shadows: Sequence[Floats],
    lamps: Sequence[tuple[float, float]],
    width_px: int,
) -> GroundMap:
    """The map of a site.

    Args:
        site: what lies on the ground.
        rng: for textures.
        shadows: outlines (K, 2) in m that standing things shade.
        lamps: where street lamps shine.
        width_px: of the picture, for which the map is to be fine enough.
    """
    sheet = _Sheet(site.bounds, min(_MOST_SCALE, max(_LEAST_SCALE, width_px / _PICTURE_PX)))
    size, coarse = sheet.size, sheet.coarser()
    names = list(_COLOURS)
    materials = Image.new("L", size, names.index("grass"))
    brush = ImageDraw.Draw(materials)
    for area in site.areas:
        brush.polygon(sheet.place(area.outline), fill=names.index(area.material))
    for outline, material in _blemishes(site, rng):
        brush.polygon(sheet.place(outline), fill=names.index(material))
    wear = _wear_mask(coarse, site.wear).resize(size, Image.Resampling.BILINEAR)
    worn = np.asarray(wear).astype(np.float32) / np.float32(255)
    image = Image.fromarray(_textured(np.asarray(materials), names, rng, worn, sheet.scale))
    _paint_strokes_(image, sheet, site.strokes, rng)
    return GroundMap(image, _sun_map(coarse, shadows), _lamp_map(coarse, lamps), site.bounds, sheet.scale)


def _blemishes(site: Site, rng: np.random.Generator) -> list[tuple[Floats, str]]:
    """Mended places and manholes on the ways of wheels."""
    found = []
    turn = np.linspace(0, 2 * np.pi, 13)[:-1]
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for points in site.wear:
        length = float(np.hypot(*(points[-1] - points[0])))
        for _ in range(rng.poisson(length / 90)):
            start = int(rng.integers(len(points) - 1))
            step = points[start + 1] - points[start]
            place = points[start] + step * rng.random()
            way = step / max(float(np.hypot(*step)), 1e-9)
            across = np.array([-way[1], way[0]])
            if rng.random() < 0.5:
                found.append((place + rng.uniform(-1, 1) * across + 0.34 * circle, "iron"))
            else:
                long, wide = rng.uniform(1, 7) * way, rng.uniform(0.5, 1.5) * across
                found.append((np.array([place, place + long, place + long + wide, place + wide]), "patch"))
    return found


def _wear_mask(sheet: _Sheet, lines: Sequence[Floats]) -> Image.Image:
    """Where wheels roll along lines, "L"."""
    mask = Image.new("L", sheet.size)
    brush = ImageDraw.Draw(mask)
    for points in lines:
        way = np.gradient(points, axis=0)
        across = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.maximum(np.hypot(way[:, :1], way[:, 1:]), 1e-9)
        for offset in (-0.8, 0.8):
            brush.line(sheet.place(points + offset * across), fill=255, width=max(1, round(0.8 * sheet.scale)))
    return mask.filter(ImageFilter.GaussianBlur(0.5 * sheet.scale))


def _textured(
    materials: NDArray[np.uint8], names: list[str], rng: np.random.Generator, wear: Pixels, scale: float
) -> NDArray[np.uint8]:
    """Colours of a map of materials, roughened."""
    shape = materials.shape
    tint = rng.uniform(0.97, 1.03, (len(names), 3)) * rng.uniform(0.9, 1.08, (len(names), 1))
    tint[names.index("paint")] = 1
    table = np.array([_COLOURS[name] for name in names], np.float32) * tint.astype(np.float32)
    tile = (min(shape[0], 1024), min(shape[1], 1024))
    fine = _repeated(rng.standard_normal(tile).astype(np.float32), shape)
    middle = _repeated(cloudy_noise(rng, tile, 3.2 * scale, 4), shape)
    large = cloudy_noise(rng, shape, 30 * scale, 3)
    rough = {
        "asphalt": (5, 4, 5),
        "paving": (4, 3, 5),
        "grass": (8, 13, 11),
        "gravel": (11, 7, 5),
        "cycleway": (4, 4, 4),
        "patch": (4, 3, 2),
    }
    albedo = table[materials]
    weights = np.array([rough.get(name, (4, 3, 3)) for name in names], np.float32)
    change = fine * weights[materials, 0] + middle * weights[materials, 1] + large * weights[materials, 2]
    is_road = materials == names.index("asphalt")
    change -= np.where(is_road, 13 * wear, 0)
    cracks = (np.abs(middle + 0.35 * large) < 0.018) & is_road & (large > 0.2)
    change -= np.where(cracks, 22, 0)
    rows, columns = np.arange(shape[0])[:, None], np.arange(shape[1])[None]
    tile_px = round(_TILE_M * scale)
    joints = ((rows % tile_px == 0) | (columns % tile_px == 0)) & (materials == names.index("paving"))
    change -= np.where(joints, 11, 0)
    is_grass = materials == names.index("grass")
    albedo += change[..., None]
    albedo[..., 0] += np.where(is_grass, 14 * large, 0)
    return np.clip(albedo, 0, 255).astype(np.uint8)


def _repeated(tile: Pixels, shape: tuple[int, ...]) -> Pixels:
    times = -(-shape[0] // tile.shape[0]), -(-shape[1] // tile.shape[1])
    return np.tile(tile, times)[: shape[0], : shape[1]]


def _paint_strokes_(image: Image.Image, sheet: _Sheet, strokes: Sequence[Stroke], rng: np.random.Generator) -> None:
    """Draw into ``image`` the painted lines."""
    brush = ImageDraw.Draw(image)
    for stroke in strokes:
        for piece in _dashes(stroke):
            worn = float(rng.uniform(0.82, 1.0))
            colour = _YELLOW if stroke.is_yellow else _WHITE
            fill = (round(colour[0] * worn), round(colour[1] * worn), round(colour[2] * worn))
            brush.line(sheet.place(piece), fill=fill, width=max(1, round(stroke.width_m * sheet.scale)))


def _dashes(stroke: Stroke) -> list[Floats]:
    if not stroke.dash_m:
        return [stroke.points]
    start, end = stroke.points[0], stroke.points[-1]
    length = float(np.hypot(*(end - start)))
    starts = np.arange(0.0, length, stroke.dash_m + stroke.gap_m).tolist()
    return [
        np.array([start + (end - start) * at / length, start + (end - start) * min(1.0, (at + stroke.dash_m) / length)])
        for at in starts
    ]


def _sun_map(sheet: _Sheet, shadows: Sequence[Floats]) -> Pixels:
    mask = Image.new("L", sheet.size, 255)
    brush = ImageDraw.Draw(mask)
    for outline in shadows:
        brush.polygon(sheet.place(outline), fill=0)
    return np.asarray(mask.filter(ImageFilter.GaussianBlur(0.3 * sheet.scale))).astype(np.float32) / np.float32(255)


def _lamp_map(sheet: _Sheet, lamps: Sequence[tuple[float, float]]) -> Pixels:
    size, scale = sheet.size, sheet.scale
    light = np.zeros((size[1], size[0]), np.float32)
    reach = round(3 * _LAMP_POOL_M * scale)
    grid = np.arange(-reach, reach + 1, dtype=np.float32) / scale
    pool = 1 / (1 + (grid[:, None] ** 2 + grid[None] ** 2) / _LAMP_POOL_M**2 * 2.2) ** 2
    for x, y in lamps:
        column, row = round((x - sheet.bounds[0]) * scale), round((y - sheet.bounds[1]) * scale)
        top, left = max(0, row - reach), max(0, column - reach)
        bottom, right = min(size[1], row + reach + 1), min(size[0], column + reach + 1)
        if top < bottom and left < right:
            dy, dx = top - row + reach, left - column + reach
            light[top:bottom, left:right] += pool[dy : dy + bottom - top, dx : dx + right - left]
    return np.minimum(light, np.float32(1.1))
