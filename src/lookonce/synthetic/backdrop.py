"""All that does not move, painted once for each kind of light, and mixed for the light of a moment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.synthetic.camera import Camera
from lookonce.synthetic.footprints import paint_order
from lookonce.synthetic.ground import GroundMap
from lookonce.synthetic.light import Light, Weather
from lookonce.synthetic.painting import paint_tile
from lookonce.synthetic.projecting import Placed, project
from lookonce.synthetic.textures import cloudy_noise

__all__ = ["Backdrop", "Standing"]

Floats = NDArray[np.float64]
Pixels = NDArray[np.float32]

_HAZE_M = 700.0
_BAND = 96  # rows at a time, to bound memory
_HEADLIGHT = np.array([0.95, 0.88, 0.74])  # what headlights add to a white ground
_FIELD = np.array([98.0, 114.0, 70.0])
_WOODS = np.array([62.0, 82.0, 52.0])


@dataclass(frozen=True, slots=True)
class Standing:
    """A body that never moves.

    Attributes:
        placed: where.
        corners: (4, 2) m, of what touches the ground.
    """

    placed: Placed
    corners: Floats


class Backdrop:
    """The picture without traffic.

    Args:
        camera: where it is seen from; its size is the picture's.
        ground: the map.
        standing: what stands.
        weather: of the scene.
        rng: for sky and woods.
        margin_px: how far the camera may shake.
    """

    def __init__(
        self,
        camera: Camera,
        ground: GroundMap,
        standing: Sequence[Standing],
        weather: Weather,
        rng: np.random.Generator,
        margin_px: int,
    ) -> None:
        self._size, self._margin = camera.size, margin_px
        height, width = camera.size
        fine = (2 * (height + 2 * margin_px + 2), 2 * (width + 2 * margin_px + 2))
        self._camera = Camera(camera.position, camera.yaw_rad, camera.pitch_rad, 2 * camera.focal_px, fine)
        self._patches = cloudy_noise(rng, (128, 128), 24, 4)
        lights = (weather.light(1, 0), weather.light(0, 0), weather.light(0, 1))
        images = self._paint_land(ground, lights, rng)
        for image, light in zip(images, (*lights, lights[1]), strict=True):
            self._paint_standing_(image, standing, light)
        phases = [(x, y) for y in (0, 1) for x in (0, 1)] if margin_px else [(0, 0)]
        self._images = {phase: [_reduced(image, phase) for image in images] for phase in phases}
        self._mixed: dict[tuple[int, int], tuple[tuple[int, int], Image.Image, Image.Image]] = {}

    def mix(self, light: Light, shift: tuple[int, int]) -> tuple[Image.Image, Image.Image, Image.Image]:
        """The picture in this light, in this light without sun, and in headlights.

        Args:
            light: of the moment.
            shift: half px right and down by which the picture is off.
        """
        phase = shift[0] % 2, shift[1] % 2
        lit, shade, night, headlit = self._images[phase]
        known = self._mixed.get(phase)
        if known is None or known[0] != light.key:
            clear = light.sun / (1 - light.night) if light.night < 1 else 0.0
            day = Image.blend(shade, lit, clear)
            mixed = (Image.blend(day, night, light.night), Image.blend(shade, night, light.night))
            known = (light.key, *mixed)
            self._mixed[phase] = known
        left = self._margin - (shift[0] - phase[0]) // 2
        top = self._margin - (shift[1] - phase[1]) // 2
        box = (left, top, left + self._size[1], top + self._size[0])
        return known[1].crop(box), known[2].crop(box), headlit.crop(box)

    def _paint_land(self, ground: GroundMap, lights: Sequence[Light], rng: np.random.Generator) -> list[Image.Image]:
        """Ground and sky for each light, and the ground in headlights."""
        height, width = self._camera.size
        sky = _Sky(self._camera, rng)
        pictures = [np.zeros((height, width, 3), np.uint8) for _ in range(4)]
        columns = np.arange(width, dtype=np.float64) + 0.5
        for top in range(0, height, _BAND):
            rows = np.arange(top, min(height, top + _BAND), dtype=np.float64) + 0.5
            bands = self._land_band(ground, lights, sky, columns, rows)
            for picture, band in zip(pictures, bands, strict=True):
                picture[top : top + len(rows)] = np.clip(band, 0, 255).astype(np.uint8)
        return [Image.fromarray(picture) for picture in pictures]

    def _land_band(
        self, ground: GroundMap, lights: Sequence[Light], sky: _Sky, columns: Floats, rows: Floats
    ) -> list[Floats]:
        x, y, distance = self._camera.ground_rays(columns, rows)
        bands = [sky.colours(columns, rows, light) for light in lights]
        bands.append(bands[1].copy())
        near = np.isfinite(distance) & (distance < 3000)
        if not near.any():
            return bands
        slant = np.hypot(distance[near], self._camera.position[2])
        albedo = ground.colours(x[near], y[near], 1.2 * slant / self._camera.focal_px).astype(np.float64)
        inside = ground.covers(x[near], y[near])[:, None]
        albedo = np.where(inside, albedo, self._fields(x[near], y[near]))
        sun, lamps = (values.astype(np.float64)[:, None] for values in ground.light_at(x[near], y[near]))
        sun, lamps = np.where(inside, sun, 1), np.where(inside, lamps, 0)
        haze = (1 - np.exp(-np.maximum(distance[near] - 40, 0) / _HAZE_M))[:, None]
        for band, light in zip(bands, lights, strict=False):
            received = light.sky_colour + max(float(light.towards_sun[2]), 0) * sun * light.sun_colour
            received = received + lamps * light.night * np.array([0.62, 0.50, 0.34])
            band[near] = albedo * received * 1.18 * (1 - haze) + haze * sky.horizon(light)
        bands[3][near] = albedo * _HEADLIGHT
        return bands

    def _fields(self, x: Floats, y: Floats) -> Floats:
        """The land beyond the map, (K, 3)."""
        noise = self._patches[_folded(y / 6, 128), _folded(x / 6, 128)][:, None]
        mixed: Floats = _FIELD + noise * np.array([13.0, 9.0, 8.0])
        return mixed

    def _paint_standing_(self, image: Image.Image, standing: Sequence[Standing], light: Light) -> None:
        """Draw into ``image`` all that stands."""
        outlines = project([one.placed for one in standing], self._camera, light, (0.0, 0.0))
        boxes = np.array([outline.xyxy for outline in outlines]).reshape(-1, 4)
        eye = np.array(self._camera.position[:2])
        distances = np.array([np.hypot(*(one.corners.mean(axis=0) - eye)) for one in standing])
        corners = np.array([one.corners for one in standing]).reshape(-1, 4, 2)
        for number in paint_order(corners, (float(eye[0]), float(eye[1])), boxes, distances):
            tile = paint_tile(outlines[number], self._camera.size)
            if tile is not None:
                image.paste(tile.image, (tile.left, tile.top), tile.image)


def _reduced(image: Image.Image, phase: tuple[int, int]) -> Image.Image:
    """At half the size, moved right and down by ``phase`` px of the full size; the outermost px is lost."""
    left, top = 2 - phase[0], 2 - phase[1]
    return image.crop((left, top, left + image.width - 4, top + image.height - 4)).reduce(2)


def _folded(places: Floats, size: int) -> NDArray[np.int64]:
    """Indices below ``size`` that go to and fro, so that a texture has no seams."""
    folded: NDArray[np.int64] = np.abs((places.astype(np.int64) % (2 * size - 1)) - size + 1)
    return folded


class _Sky:
    """Sky, clouds and the woods on the horizon."""

    def __init__(self, camera: Camera, rng: np.random.Generator) -> None:
        height, width = camera.size
        self._horizon_row = height / 2 - camera.focal_px * math.tan(camera.pitch_rad)
        self._focal = camera.focal_px
        self._clouds = cloudy_noise(rng, (256, 512), 90, 5)
        self._cover = float(rng.uniform(-0.6, 1.0))
        woods = cloudy_noise(rng, (1, width), width / 6, 7, 0.6)[0]
        self._woods_px = camera.focal_px * (0.022 + 0.007 * woods)
        grain = cloudy_noise(rng, (1, width), width / 40, 4)[0]
        self._woods_tone = 1 + 0.07 * grain

    def horizon(self, light: Light) -> Floats:
        """The colour of haze, (3,)."""
        day = np.array([196.0, 206.0, 214.0]) * (0.86 + 0.14 * light.sun)
        mixed: Floats = day * (1 - light.night) + np.array([30.0, 30.0, 38.0]) * light.night
        return mixed

    def colours(self, columns: Floats, rows: Floats, light: Light) -> Floats:
        """What is behind the ground, (H, W, 3)."""
        up = np.maximum(self._horizon_row - rows, 0)[:, None] / self._focal
        height = np.clip(up * 2.2, 0, 1)[..., None]
        zenith = np.array([96.0, 142.0, 196.0]) * (0.75 + 0.25 * light.sun) * (1 - light.night)
        zenith = zenith + np.array([10.0, 13.0, 26.0]) * light.night
        sky = self.horizon(light) * (1 - height) + zenith * height
        scale = 60 / (up + 0.09)
        u = _folded(((columns[None] - columns.mean()) / self._focal) * scale * 2.2, 512)
        v = _folded(scale * 1.6 + 0 * columns[None], 256)
        noise = self._clouds[v, u]
        cloud = np.clip(0.35 * (noise + self._cover), 0, 0.85)[..., None] * np.clip(up * 9, 0, 1)[..., None]
        white = (np.array([236.0, 238.0, 240.0]) * (0.8 + 0.2 * light.sun)) * (1 - light.night) + 26 * light.night
        sky = sky * (1 - cloud) + white * cloud
        tops = self._horizon_row - self._woods_px[None]
        is_wood = (rows[:, None] > tops)[..., None]
        haze = 0.45
        wood = _WOODS * self._woods_tone[None, :, None] * (light.sky_colour + 0.35 * light.sun_colour) * 1.2
        behind: Floats = np.where(is_wood, wood * (1 - haze) + haze * self.horizon(light), sky)
        return behind
