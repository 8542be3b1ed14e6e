"""Crowds for descriptors to learn from: many people who look alike, seen again and again in other poses and places.

A still shows an object once, and what is done to the picture changes neither how somebody walks nor where they look.
Here a few dozen people stand before any picture, and in each frame of it elsewhere, turned otherwise, in another step,
partly behind each other. The camera, the light and the optics are those of one place, so what remains to tell them
apart is how they look.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from lookonce.synthetic.camera import Camera
from lookonce.synthetic.crowd_members import alike_people
from lookonce.synthetic.fleet import Member
from lookonce.synthetic.light import Light
from lookonce.synthetic.painting import Tile, paint_tile
from lookonce.synthetic.people import draw_person
from lookonce.synthetic.projecting import Placed, project

__all__ = ["MEMBERS", "Crowd", "CrowdPicture"]

MEMBERS = 28
"""People in a crowd."""

Floats = NDArray[np.float64]

# Pairs are ranges.
_SPREAD = (0.06, 0.35)  # standard deviation of a colour's logarithm among those of one colour
_PITCH_DEG = (6.0, 32.0)  # how far the camera looks down
_POLE_M = (3.0, 9.0)  # how high it hangs
_HEIGHT_M, _HEIGHT_PX = 1.72, (32.0, 95.0)  # of somebody in the middle of the picture
_LEAST_PX = 20.0  # of the farthest
_APART_M = 0.4  # nobody is nearer to somebody else
_MOST_OUTSIDE = 0.3  # share of somebody beyond the picture's border
_STILL = 0.2  # share of those who stand
_TURNED, _WOBBLE_RAD = 0.5, 0.4  # share of those who look anywhere; others look about where they did before
_SHADE = 0.15  # brightness of the sun in it
_MOTTLES, _MOTTLED = (9, 4), 0.12  # rows and columns of light and dark patches as cloth has, standard deviation


@dataclass(frozen=True, slots=True)
class CrowdPicture:
    """A crowd at a moment.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        xyxy: (N, 4) float64 px, cut at the border; NaN for members outside.
        visible: (N,) share of each that nobody stands before, 0 to 1.
    """

    image: NDArray[np.uint8]
    xyxy: Floats
    visible: Floats


@dataclass(frozen=True, slots=True)
class _Optics:
    """What the camera does to every frame of one place."""

    blur_px: float
    haze: float
    haze_grey: float
    gain: Floats
    noise: float

    @classmethod
    def draw(cls, rng: Generator) -> _Optics:
        gain = np.exp(rng.normal(0, 0.12) + rng.normal(0, 0.05, 3))
        return cls(rng.uniform(0.2, 1), rng.uniform(0, 0.25), rng.uniform(60, 180), gain, rng.uniform(1, 4))

    def __call__(self, image: Image.Image, rng: Generator) -> NDArray[np.uint8]:
        blurred = image.filter(ImageFilter.GaussianBlur(self.blur_px))
        pixels = np.asarray(blurred, np.float32) * self.gain.astype(np.float32)
        pixels = (pixels * np.float32(1 - self.haze) + np.float32(self.haze_grey * self.haze)) * np.float32(
            np.exp(rng.normal(0, 0.03))
        )
        pixels += rng.standard_normal(pixels.shape, np.float32) * np.float32(self.noise)
        return np.clip(pixels, 0, 255).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class Crowd:
    """N members in one place.

    Attributes:
        members: N of them.
        camera: where it is seen from.
        light: of the place.
        backdrop: the picture behind them, of the camera's size.
        depth_m: nearest and farthest distance on the ground.
        headings: (N,) where each usually looks, rad.
        mottles: (N, rows, columns) patches of light and dark.
        shade: share of the places that lie in the shade.
        optics: of the camera.
    """

    members: list[Member]
    camera: Camera
    light: Light
    backdrop: Image.Image
    depth_m: tuple[float, float]
    headings: Floats
    mottles: Floats
    shade: float
    optics: _Optics

    @classmethod
    def gather(cls, size: tuple[int, int], backdrop: Image.Image, rng: Generator) -> Crowd:
        """A crowd before a part of a picture.

        Args:
            size: (height, width) px.
            backdrop: RGB of any size.
            rng: source of all choices.
        """
        camera, depth_m = _look_down(size, rng)
        part = rng.uniform(0.5, 1, 2) * backdrop.size
        corner = rng.uniform(0, 1, 2) * (backdrop.size - part)
        box = (*corner.tolist(), *(corner + part).tolist())
        return cls(
            alike_people(MEMBERS, _by_factor(_SPREAD, rng), rng),
            camera,
            _daylight(rng),
            backdrop.resize(size[::-1], Image.Resampling.BILINEAR, box=box),
            depth_m,
            rng.uniform(-math.pi, math.pi, MEMBERS),
            np.clip(rng.normal(1, _MOTTLED, (MEMBERS, *_MOTTLES)), 0.6, 1.5),
            float(rng.uniform(0, 0.25)),
            _Optics.draw(rng),
        )

    def picture(self, rng: Generator) -> CrowdPicture:
        """The crowd at some moment: who is where, how turned, in which step, is drawn from ``rng``."""
        places = self._places(rng)
        placed = [self._place(number, *place, rng) for number, place in places.items()]
        outlines = dict(zip(places, project(placed, self.camera, self.light, (0.0, 0.0)), strict=True))
        image, owner = self.backdrop.copy(), np.full(self.camera.size, -1)
        xyxy, area = np.full((len(self.members), 4), np.nan), np.ones(len(self.members))
        for number in sorted(places, key=lambda one: -places[one][0]):
            tile = paint_tile(outlines[number], self.camera.size)
            if tile is None or tile.truncation > _MOST_OUTSIDE:
                continue
            painted = _mottled(tile, self.mottles[number])
            image.paste(painted, (tile.left, tile.top), painted.getchannel("A"))
            left, top, right, bottom = tile.box
            owner[top:bottom, left:right][tile.mask] = number
            xyxy[number], area[number] = tile.xyxy, max(tile.mask.sum(), 1)
        seen = np.bincount(owner[owner >= 0], minlength=len(self.members))
        return CrowdPicture(self.optics(image, rng), xyxy, seen / area)

    def _places(self, rng: Generator) -> dict[int, tuple[float, float]]:
        """Member -> x and y on the ground, m; those who would stand in somebody's place are not there."""
        count = len(self.members)
        ahead = np.exp(rng.uniform(math.log(self.depth_m[0]), math.log(self.depth_m[1]), count))
        half_width = 0.52 * self.camera.size[1] / self.camera.focal_px * np.hypot(ahead, self.camera.position[2])
        aside = rng.uniform(-1, 1, count) * half_width
        places: dict[int, tuple[float, float]] = {}
        for number, place in enumerate(zip(ahead.tolist(), aside.tolist(), strict=True)):
            if all(math.dist(place, other) > _APART_M for other in places.values()):
                places[number] = place
        return places

    def _place(self, number: int, x: float, y: float, rng: Generator) -> Placed:
        person, body = self.members[number].person, self.members[number].body
        assert person is not None
        is_turned = rng.random() < _TURNED
        yaw = rng.uniform(-math.pi, math.pi) if is_turned else self.headings[number] + rng.normal(0, _WOBBLE_RAD)
        limbs = draw_person(person, rng.uniform(0, 2 * math.pi), is_walking=bool(rng.random() > _STILL))
        sun = _SHADE if rng.random() < self.shade else 1.0
        return Placed(replace(body, capsules=limbs), x, y, float(yaw), sun)


def _look_down(size: tuple[int, int], rng: Generator) -> tuple[Camera, tuple[float, float]]:
    """A camera, and between which distances on the ground its objects are in the picture and large enough, m."""
    pitch, pole_m = math.radians(_between(_PITCH_DEG, rng)), _between(_POLE_M, rng)
    size_px = _by_factor(_HEIGHT_PX, rng)
    focal_px = size_px * math.hypot(pole_m / math.tan(pitch), pole_m) / _HEIGHT_M
    half_view = math.atan(size[0] / 2 / focal_px)
    near = pole_m / math.tan(min(pitch + 0.8 * half_view, 1.5))
    far = pole_m / max(math.tan(pitch - 0.65 * half_view), 0.04)
    far = max(min(far, focal_px * _HEIGHT_M / _LEAST_PX), near + 4)
    return Camera((0.0, 0.0, pole_m), 0.0, pitch, focal_px, size), (near, far)


def _daylight(rng: Generator) -> Light:
    """Any sun, or none."""
    height, azimuth = math.radians(rng.uniform(20, 65)), rng.uniform(-math.pi, math.pi)
    sun = float(rng.choice([0.0, 0.25, 1.0]))
    flat = math.cos(height)
    return Light(
        sun=sun,
        night=0.0,
        towards_sun=np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(height)]),
        sun_colour=1.12 * sun * np.array([1.0, 0.93, 0.82]),
        sky_colour=np.array([0.49, 0.535, 0.60]) * rng.uniform(0.8, 1.3) * (1 + 0.45 * (1 - sun)),
        ground_colour=np.array([0.32, 0.305, 0.28]) * (0.5 + 0.5 * sun),
    )


def _mottled(tile: Tile, mottles: Floats) -> Image.Image:
    """The tile's picture with patches of light and dark, as cloth has."""
    grey = Image.fromarray((mottles * 128).astype(np.uint8)).resize(tile.image.size, Image.Resampling.BICUBIC)
    pixels = np.asarray(tile.image, np.float32).copy()
    pixels[..., :3] *= np.asarray(grey, np.float32)[..., None] / 128
    return Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))


def _between(limits: tuple[float, float], rng: Generator) -> float:
    return float(rng.uniform(*limits))


def _by_factor(limits: tuple[float, float], rng: Generator) -> float:
    """Between two limits, evenly by factors rather than by differences."""
    return math.exp(rng.uniform(math.log(limits[0]), math.log(limits[1])))
