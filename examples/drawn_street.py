"""Draws a street with traffic as a video, so that there is something to track without anybody's footage.

python examples/drawn_street.py street.mp4
lookonce track street.mp4 -m model.onnx --classes car,bus,truck --iou 0.3
python examples/drawn_street.py --gif runs/street/annotated.mp4 docs/images/track.gif
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from lookonce.video import VideoWriter, open_video

WIDTH, HEIGHT, RATE, SECONDS = 640, 360, 25, 14
FINE: Final = 4  # everything is drawn so many times larger, then scaled down
SPRITE_SCALE: Final = 30 * FINE  # px in a sprite for a metre
FAR_KERB, NEAR_KERB = 205, 338  # rows of the picture

Colour = tuple[int, int, int]
Points = list[tuple[float, float]]  # metres from the rear bumper and above the ground
GLASS: Final[Colour] = (38, 46, 54)


@dataclass(frozen=True)
class Shape:
    """A kind of vehicle, seen from its right side: outlines in metres."""

    body: Points
    glass: list[Points]
    wheels: tuple[float, ...]
    radius: float = 0.33
    doors: tuple[float, ...] = ()
    belt: float = 0.9  # height of the crease along the side

    @property
    def size(self) -> tuple[float, float]:
        """Length and height in metres."""
        points = np.array(self.body)
        return float(points[:, 0].max()), float(points[:, 1].max())


SHAPES: Final = {
    "sedan": Shape(
        body=[
            (0.05, 0.3),
            (0, 0.75),
            (0.1, 0.97),
            (0.7, 1.04),
            (1.4, 1.4),
            (2.0, 1.47),
            (2.65, 1.42),
            (3.3, 1.02),
            (4.2, 0.9),
            (4.6, 0.74),
            (4.7, 0.5),
            (4.62, 0.26),
            (0.2, 0.26),
        ],
        glass=[
            [(0.85, 1.04), (1.45, 1.33), (1.98, 1.39), (1.98, 1.02)],
            [(2.06, 1.02), (2.06, 1.39), (2.6, 1.35), (3.1, 1.0)],
        ],
        wheels=(0.95, 3.78),
        doors=(1.25, 2.02, 3.12),
        belt=0.92,
    ),
    "hatchback": Shape(
        body=[
            (0.05, 0.35),
            (0, 0.8),
            (0.1, 1.05),
            (0.45, 1.43),
            (1.0, 1.53),
            (1.95, 1.5),
            (2.75, 1.06),
            (3.5, 0.95),
            (3.9, 0.75),
            (3.98, 0.5),
            (3.9, 0.27),
            (0.2, 0.27),
        ],
        glass=[
            [(0.45, 1.08), (0.66, 1.38), (1.35, 1.44), (1.35, 1.05)],
            [(1.43, 1.05), (1.43, 1.44), (1.93, 1.41), (2.55, 1.03)],
        ],
        wheels=(0.72, 3.2),
        doors=(1.39, 2.55),
        belt=0.94,
    ),
    "bus": Shape(
        body=[
            (0.03, 0.35),
            (0, 2.8),
            (0.12, 2.98),
            (8.3, 2.98),
            (8.5, 2.8),
            (8.6, 1.2),
            (8.58, 0.3),
            (0.15, 0.3),
        ],
        glass=[
            *([(x, 1.35), (x, 2.5), (x + 1.2, 2.5), (x + 1.2, 1.35)] for x in (0.3, 1.58, 2.86, 4.14, 5.42)),
            [(6.75, 0.5), (6.75, 2.5), (7.55, 2.5), (7.55, 0.5)],
            [(7.7, 1.2), (7.7, 2.5), (8.4, 2.5), (8.48, 1.2)],
        ],
        wheels=(1.9, 6.2),
        radius=0.48,
        doors=(6.68, 7.15, 7.62),
        belt=1.1,
    ),
}


@dataclass(frozen=True)
class Trip:
    """One vehicle's way through the picture; a negative speed goes to the left."""

    shape: str
    colour: Colour
    row: float  # where the wheels touch the road, px
    scale: float  # px for a metre
    start: float  # where the middle is at time 0, px
    speed: float  # px a second


TRIPS: Final = (
    Trip("sedan", (150, 156, 164), 232, 25, 440, -36),
    Trip("bus", (226, 170, 44), 232, 25, 720, -36),
    Trip("hatchback", (196, 38, 34), 232, 25, 980, -36),
    Trip("sedan", (44, 120, 78), 316, 25, 180, 48),
    Trip("hatchback", (232, 232, 228), 316, 25, -100, 48),
)


def shaded(size: tuple[int, int], colour: Colour, rows: list[float], lights: list[float]) -> Image.Image:
    """A plane of one colour whose brightness goes from light to light over the rows (parts of the height)."""
    light = np.interp(np.linspace(0, 1, size[1]), rows, lights)[:, None, None]
    plane = np.broadcast_to(np.array(colour) * light, (size[1], size[0], 3))
    return Image.fromarray(np.clip(plane, 0, 255).astype(np.uint8))


class Sprite:
    """A vehicle drawn once, large, with its shadow; heading right."""

    def __init__(self, shape: Shape, colour: Colour) -> None:
        length, height = shape.size
        self.shape = shape
        self.margin = round(0.4 * SPRITE_SCALE)
        self.ground = round(height * SPRITE_SCALE) + self.margin
        self.image = Image.new("RGBA", (round(length * SPRITE_SCALE) + 2 * self.margin, self.ground + self.margin))
        self._draw_shadow()
        self._draw_underside()
        self._fill(shape.body, colour, 0.09)
        self._draw_glass()
        self._draw_details(colour)
        for x in shape.wheels:
            self._draw_wheel(x)

    def _px(self, points: Points) -> Points:
        return [(self.margin + x * SPRITE_SCALE, self.ground - y * SPRITE_SCALE) for x, y in points]

    def _mask(self, points: Points, rounding: float) -> Image.Image:
        """A polygon with round corners."""
        mask = Image.new("L", self.image.size)
        ImageDraw.Draw(mask).polygon(self._px(points), fill=255)
        mask = mask.filter(ImageFilter.GaussianBlur(rounding * SPRITE_SCALE))
        return mask.point([min(255, max(0, (value - 118) * 13)) for value in range(256)])

    def _fill(self, points: Points, colour: Colour, rounding: float) -> None:
        """A polygon as bent metal: bright at the shoulder, dark at the sill."""
        top, belt = max(y for _, y in points), self.shape.belt
        rows = [1 - y / (self.ground / SPRITE_SCALE) for y in (top, top - 0.12, belt + 0.05, belt - 0.05, 0.5, 0.25)]
        plane = shaded((self.image.width, self.ground), colour, rows, [1.3, 1.08, 1.12, 0.92, 0.72, 0.4])
        canvas = Image.new("RGB", self.image.size)
        canvas.paste(plane)
        self.image.paste(canvas, mask=self._mask(points, rounding))

    def _lines(self, lines: list[Points], colour: Colour, width: float) -> None:
        draw = ImageDraw.Draw(self.image)
        for line in lines:
            draw.line(self._px(line), fill=(*colour, 255), width=max(1, round(width * SPRITE_SCALE)), joint="curve")

    def _ellipse(self, x: float, y: float, radii: tuple[float, float], colour: tuple[int, ...]) -> None:
        corners = self._px([(x - radii[0], y + radii[1]), (x + radii[0], y - radii[1])])
        ImageDraw.Draw(self.image).ellipse(corners, fill=colour)

    def _draw_shadow(self) -> None:
        length, _ = self.shape.size
        self._ellipse(length / 2, -0.02, (length / 2 + 0.15, 0.17), (8, 8, 12, 205))
        self.image = self.image.filter(ImageFilter.GaussianBlur(0.07 * SPRITE_SCALE))

    def _draw_underside(self) -> None:
        length, _ = self.shape.size
        ends = (0.15, length - 0.15)
        corners = self._px([(ends[0], 0.75), (ends[1], 0.2)])
        ImageDraw.Draw(self.image).rectangle([*corners[0], *corners[1]], fill=(18, 18, 20, 255))

    def _draw_glass(self) -> None:
        size = self.image.size
        plane = shaded(size, GLASS, [0, 0.35, 0.6, 1], [2.6, 1.8, 0.9, 0.9])
        for points in self.shape.glass:
            self.image.paste(plane, mask=self._mask(points, 0.03))
            self._lines([[*points, points[0]]], (16, 16, 18), 0.025)

    def _draw_details(self, colour: Colour) -> None:
        """Joints of the doors, handles, lights."""
        dark = (colour[0] * 2 // 5, colour[1] * 2 // 5, colour[2] * 2 // 5)
        shape, belt = self.shape, self.shape.belt
        nose = max(x for x, _ in shape.body)
        tail = min(x for x, _ in shape.body)
        self._lines([[(x, 0.42), (x, belt + 0.08)] for x in shape.doors], dark, 0.022)
        self._lines([[(x - 0.3, belt - 0.08), (x - 0.12, belt - 0.08)] for x in shape.doors[:2]], dark, 0.04)
        self._lines([[(tail + 0.2, belt), (nose - 0.3, belt - 0.06)]], dark, 0.012)
        self._lines([[(nose - 0.3, 0.72), (nose - 0.1, 0.68)]], (250, 248, 232), 0.13)
        self._lines([[(0.05, 0.85), (0.24, 0.86)]], (168, 16, 18), 0.16)
        self._lines([[(tail + 0.1, 0.33), (nose - 0.1, 0.33)]], (30, 30, 32), 0.07)

    def _draw_wheel(self, x: float) -> None:
        radius = self.shape.radius
        self._ellipse(x, radius + 0.03, (radius * 1.18, radius * 1.18), (10, 10, 12, 255))
        self._ellipse(x, radius, (radius, radius), (30, 30, 33, 255))
        self._ellipse(x, radius, (radius * 0.68, radius * 0.68), (186, 188, 192, 255))
        self._ellipse(x, radius, (radius * 0.58, radius * 0.58), (92, 94, 100, 255))
        for angle in np.arange(5) * 2 * np.pi / 5 + np.pi / 2:
            end = (x + 0.6 * radius * np.cos(angle), radius + 0.6 * radius * np.sin(angle))
            self._lines([[(x, radius), end]], (192, 194, 198), 0.07)
        self._ellipse(x, radius, (radius * 0.16, radius * 0.16), (150, 152, 156, 255))


@cache
def sprite(shape: str, colour: Colour, is_left: bool) -> tuple[Image.Image, int]:
    """A vehicle's picture, and the row in it that stands on the road."""
    drawn = Sprite(SHAPES[shape], colour)
    image = drawn.image.transpose(Image.Transpose.FLIP_LEFT_RIGHT) if is_left else drawn.image
    return image, drawn.ground


def paste(scene: Image.Image, trip: Trip, time_s: float) -> None:
    """Put a vehicle where it is at a time, to a fraction of a pixel."""
    image, ground = sprite(trip.shape, trip.colour, trip.speed < 0)
    fine = SPRITE_SCALE / trip.scale  # px of the sprite for one of the scene
    left = trip.start + trip.speed * time_s - image.width / fine / 2
    top = trip.row - ground / fine
    column, row = int(np.floor(left)), int(np.floor(top))
    size = int(image.width / fine) + 2, int(image.height / fine) + 2
    if not -size[0] < column < scene.width:
        return
    wide = Image.new("RGBA", (round((size[0] + 1) * fine), round((size[1] + 1) * fine)))
    wide.paste(image, (round((left - column) * fine), round((top - row) * fine)))
    small = wide.resize(size, Image.Resampling.BOX, box=(0, 0, size[0] * fine, size[1] * fine))
    scene.paste(small, (column, row), small)


def draw_buildings(scene: Image.Image, rng: np.random.Generator) -> None:
    """A row of houses with windows, and trees before them."""
    draw = ImageDraw.Draw(scene)
    left, base = -20, (FAR_KERB - 18) * FINE
    while left < WIDTH:
        width, top = int(rng.integers(90, 150)), int(rng.integers(12, 70))
        wall = tuple(
            int(value) for value in np.array([168, 150, 132]) + rng.integers(-26, 26) + rng.integers(-12, 12, 3)
        )
        draw.rectangle([left * FINE, top * FINE, (left + width) * FINE, base], fill=wall)
        for x in range(left + 10, left + width - 14, 24):
            for y in range(top + 12, FAR_KERB - 50, 30):
                pane = int(rng.integers(60, 110))
                draw.rectangle([x * FINE, y * FINE, (x + 12) * FINE, (y + 18) * FINE], fill=(214, 208, 198))
                draw.rectangle(
                    [(x + 1) * FINE, (y + 1) * FINE, (x + 11) * FINE, (y + 17) * FINE],
                    fill=(pane - 12, pane, pane + 12),
                )
        left += width + int(rng.integers(0, 12))
    for x in range(30, WIDTH, 150):
        draw_tree(draw, x + int(rng.integers(-20, 20)), rng)


def draw_tree(draw: ImageDraw.ImageDraw, x: int, rng: np.random.Generator) -> None:
    """A trunk and a crown of many leaves."""
    draw.rectangle([(x - 3) * FINE, 130 * FINE, (x + 3) * FINE, (FAR_KERB - 6) * FINE], fill=(74, 60, 48))
    for _ in range(260):
        angle, reach, size = rng.uniform(0, 2 * np.pi), 34 * np.sqrt(rng.uniform()), rng.uniform(2, 7)
        px, py = x + reach * np.cos(angle), 100 + 1.1 * reach * np.sin(angle)
        shade = 1.15 - 0.012 * (py - 60) + rng.uniform(-0.15, 0.15)
        colour = (int(62 * shade), int(98 * shade), int(46 * shade))
        draw.ellipse([(px - size) * FINE, (py - size) * FINE, (px + size) * FINE, (py + size) * FINE], fill=colour)


def draw_background(rng: np.random.Generator) -> Image.Image:
    """Sky, houses, sidewalks and a road of two lanes, without traffic."""
    size = (WIDTH * FINE, HEIGHT * FINE)
    scene = shaded(size, (172, 200, 232), [0, 0.5], [0.92, 1.12])
    draw_buildings(scene, rng)
    draw = ImageDraw.Draw(scene)
    walk, road = (158, 154, 148), (98, 99, 102)
    draw.rectangle([0, (FAR_KERB - 18) * FINE, *size], fill=walk)
    draw.rectangle([0, FAR_KERB * FINE, size[0], NEAR_KERB * FINE], fill=road)
    for row in (FAR_KERB, NEAR_KERB):
        draw.rectangle([0, row * FINE, size[0], (row + 4) * FINE], fill=(188, 186, 180))
    draw.rectangle([0, 243 * FINE, size[0], 245 * FINE], fill=(206, 180, 92))
    for x in range(-20, WIDTH, 90):
        draw.polygon(
            [(px * FINE, py * FINE) for px, py in ((x, 283), (x + 40, 283), (x + 40, 286), (x, 286))],
            fill=(214, 214, 208),
        )
    small = np.asarray(scene.resize((WIDTH, HEIGHT), Image.Resampling.BOX), np.float32)
    grain = rng.normal(0, 1, (HEIGHT, WIDTH, 1)).astype(np.float32)
    rough = np.where(np.arange(HEIGHT) > FAR_KERB, 7, 3)[:, None, None]
    return Image.fromarray(np.clip(small + rough * grain, 0, 255).astype(np.uint8))


def draw_frame(background: Image.Image, time_s: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """The street at a time, (H, W, 3) uint8 RGB, as a camera would give it: a little soft, a little noisy."""
    scene = background.copy()
    for trip in sorted(TRIPS, key=lambda trip: trip.row):
        paste(scene, trip, time_s)
    soft = np.asarray(scene.filter(ImageFilter.GaussianBlur(0.6)), np.float32)
    noise = rng.normal(0, 2, (HEIGHT, WIDTH, 1)).astype(np.float32)
    return np.clip(soft + noise, 0, 255).astype(np.uint8)


def draw_street(path: Path, seed: int) -> None:
    """Write the clip; a seed gives the same one each time."""
    rng = np.random.default_rng(seed)
    background = draw_background(rng)
    with VideoWriter(path, RATE) as writer:
        for index in range(RATE * SECONDS):
            writer.write(draw_frame(background, index / RATE, rng), index / RATE)


def make_gif(video: Path, path: Path, start_s: float, end_s: float) -> None:
    """Write a part of a video as a small GIF; pixels that hardly change stay as they were, which packs better."""
    pictures: list[NDArray[np.uint8]] = []
    with open_video(video, start_s=start_s, end_s=end_s, every=3) as frames:
        for frame in frames:
            small = Image.fromarray(frame.image).resize((480, 270), Image.Resampling.LANCZOS)
            picture = np.array(small)
            if pictures:
                change = np.abs(picture.astype(np.int16) - pictures[-1]).max(axis=2, keepdims=True)
                picture = np.where(change < 14, pictures[-1], picture)
            pictures.append(picture)
    palette = Image.fromarray(np.concatenate(pictures[::10])).quantize(255, dither=Image.Dither.NONE)
    images = [Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    images[0].save(path, save_all=True, append_images=images[1:], duration=round(3000 / RATE), loop=0, optimize=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "files", type=Path, nargs="+", help="the clip to write; with --gif: a video and the GIF to write"
    )
    parser.add_argument("--gif", action="store_true", help="make a GIF from a video instead")
    parser.add_argument("--start", type=float, default=5.0, help="where the GIF begins, seconds")
    parser.add_argument("--end", type=float, default=9.5, help="where the GIF ends, seconds")
    parser.add_argument("--seed", type=int, default=0, help="of the clip's noise, houses and trees")
    given = parser.parse_args()
    if len(given.files) != 1 + given.gif:
        parser.error("expected one file, or two with --gif")
    if given.gif:
        make_gif(*given.files, given.start, given.end)
    else:
        draw_street(given.files[0], given.seed)


if __name__ == "__main__":
    main()
