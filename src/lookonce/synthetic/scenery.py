"""Things that stand: trees, houses, street lamps, signs, signals, barriers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.body import Body, BodyBuilder, Capsules, Surface, patch
from lookonce.synthetic.site import Thing

__all__ = ["SIGNAL_LAMPS", "build_thing", "shadow_of", "thing_footprint"]

Floats = NDArray[np.float64]
Colour = tuple[float, float, float]
Row = tuple[tuple[float, float, float], tuple[float, float, float], float, float, Colour]

SIGNAL_LAMPS = ("red", "amber", "green")
_STEEL: Colour = (118, 122, 124)
_BARK: Colour = (86, 68, 52)
_GREENS: tuple[Colour, ...] = ((74, 104, 48), (92, 116, 54), (62, 92, 50), (104, 118, 56), (118, 112, 52))
_WALLS: tuple[Colour, ...] = (
    (196, 180, 152),
    (168, 112, 88),
    (206, 200, 188),
    (150, 142, 132),
    (188, 160, 120),
    (126, 84, 70),
    (176, 184, 188),
    (214, 196, 150),
)
_ROOFS: tuple[Colour, ...] = ((112, 66, 52), (90, 88, 88), (74, 76, 82), (132, 84, 62))
_SIGNS: tuple[Colour, ...] = ((30, 80, 160), (190, 40, 40), (235, 200, 60), (30, 110, 70))
_LAMP_COLOURS: dict[str, Colour] = {"red": (250, 44, 36), "amber": (250, 170, 40), "green": (50, 230, 130)}


def build_thing(thing: Thing, rng: np.random.Generator) -> Body:
    """The body of a thing; signals come without light."""
    if thing.kind == "tree":
        return _tree(rng)
    if thing.kind == "bush":
        return _bush(rng)
    if thing.kind == "lamp":
        return _lamp(thing.size[2] or float(rng.uniform(6.5, 8.5)))
    if thing.kind == "sign":
        return _sign(rng)
    if thing.kind == "signal":
        return signal_body("")
    if thing.kind == "house":
        return _house(thing.size, rng)
    return _barrier(thing.size)


def thing_footprint(thing: Thing, body: Body) -> tuple[float, float]:
    """Length and width in m of what touches the ground."""
    return (body.size[0], body.size[1]) if thing.kind in ("house", "barrier") else (0.4, 0.4)


def shadow_of(thing: Thing, body: Body, towards_sun: Floats) -> list[Floats]:
    """Outlines ``(K, 2)`` in m that it shades on the ground."""
    reach = -towards_sun[:2] / towards_sun[2]
    if thing.kind in ("house", "barrier"):
        half = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * np.array(body.size[:2]) / 2
        cos, sin = math.cos(thing.yaw), math.sin(thing.yaw)
        base = half @ np.array([(cos, sin), (-sin, cos)]) + np.array([thing.x, thing.y])
        top = base + reach * body.size[2]
        sides = [np.array([base[k], base[k - 1], top[k - 1], top[k]]) for k in range(4)]
        return [base, top, *sides]
    limbs = body.capsules
    outlines = []
    turn = np.linspace(0, 2 * math.pi, 9)[:-1]
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    cos, sin = math.cos(thing.yaw), math.sin(thing.yaw)
    for start, end, radii in zip(limbs.starts, limbs.ends, limbs.radii, strict=True):
        places = []
        for point in (start, end):
            x, y = point[0] * cos - point[1] * sin, point[0] * sin + point[1] * cos
            places.append(np.array([thing.x + x, thing.y + y]) + reach * point[2])
        if (start == end).all():
            outlines.append(places[0] + circle * radii[0])
        else:
            way = places[1] - places[0]
            across = np.array([-way[1], way[0]]) / max(float(np.hypot(*way)), 1e-9)
            a, b = across * radii[0], across * radii[1]
            outlines.append(np.array([places[0] + a, places[1] + b, places[1] - b, places[0] - a]))
    return outlines


def _leaves(rng: np.random.Generator, middle: float, radius: float, height: float, count: int) -> list[Row]:
    green = np.array(_GREENS[int(rng.integers(len(_GREENS)))]) * rng.uniform(0.85, 1.15)
    rows: list[Row] = []
    for _ in range(count):
        way = rng.standard_normal(3)
        way /= np.sqrt((way**2).sum())
        share = float(rng.uniform(0.45, 1.0))
        x, y, z = (way * share * np.array([radius, radius, height])).tolist()
        tone = float(rng.uniform(0.78, 1.12)) * (0.86 + 0.16 * z / height)
        red, grass, blue = (green * tone).tolist()
        place = (x, y, middle + z)
        size = radius * float(rng.uniform(0.16, 0.30))
        rows.append((place, place, size, size, (red, grass, blue)))
    return rows


def _tree(rng: np.random.Generator) -> Body:
    radius = float(rng.uniform(1.5, 2.9))
    trunk = float(rng.uniform(2.2, 3.2))
    height = radius * float(rng.uniform(0.9, 1.35))
    rows: list[Row] = [((0.0, 0.0, 0.0), (0.1, 0.05, trunk + height * 0.6), 0.17, 0.12, _BARK)]
    rows += _leaves(rng, trunk + height * 0.8, radius * 0.85, height * 0.85, 110)
    return BodyBuilder().build((2 * radius, 2 * radius, trunk + 2 * height), Capsules.of(rows))


def _bush(rng: np.random.Generator) -> Body:
    radius = float(rng.uniform(0.8, 1.5))
    return BodyBuilder().build(
        (2 * radius, 2 * radius, 1.4 * radius), Capsules.of(_leaves(rng, radius * 0.6, radius, radius * 0.6, 46))
    )


def _lamp(height: float) -> Body:
    reach = 1.7
    rows: list[Row] = [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.11, 0.10, _STEEL),
        ((0.0, 0.0, 1.0), (0.0, 0.0, height - 0.5), 0.08, 0.055, _STEEL),
        ((0.0, 0.0, height - 0.5), (0.5, 0.0, height), 0.055, 0.05, _STEEL),
        ((0.5, 0.0, height), (reach, 0.0, height + 0.1), 0.05, 0.05, _STEEL),
    ]
    builder = BodyBuilder()
    builder.box((reach - 0.1, -0.16, height), (reach + 0.75, 0.16, height + 0.12), (150, 152, 154), 0)
    builder.face(
        [(reach, -0.13, height), (reach + 0.7, -0.13, height), (reach + 0.7, 0.13, height), (reach, 0.13, height)],
        (226, 214, 180),
        Surface.HEADLIGHT,
    )
    return builder.build((0.3, 0.3, height), Capsules.of(rows))


def _sign(rng: np.random.Generator) -> Body:
    height = float(rng.uniform(2.6, 3.2))
    builder = BodyBuilder()
    wide = float(rng.choice([0.35, 0.45, 0.8]))
    colour = _SIGNS[int(rng.integers(len(_SIGNS)))]
    for x, tone in ((0.05, 1.0), (-0.05, 0.0)):
        builder.part((0.0, 0.0, height), 0)
        plate = builder.face(
            [(x, -wide, height - 0.4), (x, wide, height - 0.4), (x, wide, height + 0.4), (x, -wide, height + 0.4)],
            (236, 236, 232) if tone else (140, 142, 144),
        )
        if tone:
            builder.face(patch(plate, 0.08, 0.92, 0.08, 0.92), colour)
            builder.face(patch(plate, 0.25, 0.75, 0.40, 0.60), (236, 236, 232), Surface.PAINT, 20)
    rows: list[Row] = [((0.0, 0.0, 0.0), (0.0, 0.0, height - 0.4), 0.045, 0.045, _STEEL)]
    return builder.build((0.2, 2 * wide, height + 0.4), Capsules.of(rows))


def signal_body(lit: str) -> Body:
    """A signal whose lamp ``lit`` ("red", "amber", "green" or none) shines; it looks ahead."""
    builder = BodyBuilder()
    low, high = 2.7, 3.75
    faces = builder.box((-0.13, -0.19, low), (0.13, 0.19, high), (34, 36, 38), 0)
    for place, name in enumerate(reversed(SIGNAL_LAMPS)):
        bottom = 0.06 + place * 0.31
        colour = _LAMP_COLOURS[name]
        dim: Colour = (colour[0] * 0.22, colour[1] * 0.22, colour[2] * 0.22)
        lamp = patch(faces[0], 0.15, 0.85, bottom, bottom + 0.27)
        builder.face(lamp, colour if name == lit else dim, Surface.GLOWING if name == lit else Surface.MATT)
    rows: list[Row] = [((0.0, 0.0, 0.0), (0.0, 0.0, low), 0.07, 0.06, (70, 74, 76))]
    return builder.build((0.3, 0.4, high), Capsules.of(rows))


def _house(size: tuple[float, float, float], rng: np.random.Generator) -> Body:
    length, depth, height = size
    wall = _WALLS[int(rng.integers(len(_WALLS)))]
    builder = BodyBuilder()
    x, y = length / 2, depth / 2
    faces = builder.box((-x, -y, 0.0), (x, y, height), wall, 0, Surface.MATT)
    floors = max(1, round(height / 3.1))
    glass: Colour = (54, 62, 72)
    for face, wide in ((faces[0], depth), (faces[1], depth), (faces[2], length), (faces[3], length)):
        count = max(2, round(wide / float(rng.uniform(2.4, 3.4))))
        builder.face(patch(face, 0, 1, 0, 0.5 / height), (96, 92, 88), Surface.MATT)
        for floor in range(floors):
            bottom, top = (floor + 0.32) / floors * 0.96, (floor + 0.80) / floors * 0.96
            for k in range(count):
                left, right = (k + 0.24) / count, (k + 0.76) / count
                is_lit = rng.random() < 0.35
                frame = patch(face, left - 0.04 / count, right + 0.04 / count, bottom - 0.008, top + 0.008)
                builder.face(frame, (222, 218, 210), Surface.MATT)
                surface = Surface.LIT_AT_NIGHT if is_lit else Surface.GLASS
                builder.face(patch(face, left, right, bottom, top), glass, surface)
        builder.face(patch(face, 0, 1, 0.975, 1.0), (116, 110, 104), Surface.MATT)
    ridge = 0.0 if floors > 3 else float(rng.uniform(1.8, 3.0))
    _roof(builder, (x, y, height), ridge, wall, _ROOFS[int(rng.integers(len(_ROOFS)))])
    return builder.build((length, depth, height + ridge))


def _roof(builder: BodyBuilder, top: tuple[float, float, float], ridge: float, wall: Colour, colour: Colour) -> None:
    x, y, z = top
    if not ridge:
        builder.box((-x * 0.4, -y * 0.4, z), (x * 0.1, y * 0.4, z + 1.2), (128, 124, 120), 1, Surface.MATT)
        return
    builder.part((0.0, 0.0, z), 1)
    over = 0.4
    for sign in (-1, 1):
        builder.face(
            [
                (-x, sign * (y + over), z - 0.1),
                (x, sign * (y + over), z - 0.1),
                (x, 0.0, z + ridge),
                (-x, 0.0, z + ridge),
            ],
            colour,
            Surface.MATT,
        )
        builder.face([(sign * x, -y, z), (sign * x, y, z), (sign * x, 0.0, z + ridge)], wall, Surface.MATT)


def _barrier(size: tuple[float, float, float]) -> Body:
    length, width, height = size
    builder = BodyBuilder()
    x, y = length / 2, width / 2
    colour: Colour = (162, 160, 154) if height < 2 else (136, 142, 130)
    faces = builder.box((-x, -y, 0.0), (x, y, height), colour, 0, Surface.MATT)
    for face in faces[2:4]:
        builder.face(patch(face, 0.0, 0.012, 0.0, 1.0), (110, 108, 104), Surface.MATT)
        if height > 2:
            for low in (0.25, 0.5, 0.75):
                builder.face(patch(face, 0.0, 1.0, low, low + 0.015), (112, 118, 108), Surface.MATT)
    return builder.build(size)
