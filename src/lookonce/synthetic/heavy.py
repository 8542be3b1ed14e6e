"""Buses and lorries as bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.body import Body, BodyBuilder, Surface, patch
from lookonce.synthetic.cars import Livery, darker, wheels

__all__ = ["HEAVY_SHAPES", "HeavyShape", "build_bus", "build_truck"]

Floats = NDArray[np.float64]
Colour = tuple[float, float, float]

_GLASS: Colour = (36, 44, 52)
_DARK: Colour = (34, 34, 36)
_GREY: Colour = (120, 122, 126)
_LAMP: Colour = (226, 230, 232)
_TAIL: Colour = (140, 18, 18)
_AMBER_TEXT: Colour = (236, 160, 40)


@dataclass(frozen=True, slots=True)
class HeavyShape:
    """The measures of a bus or lorry, m.

    Attributes:
        length: over all.
        width: over all.
        height: over all.
        cab: length of a lorry's cab; 0 = a bus.
        load: "box", "tipper", "tank" or "flat"; "" = a bus.
        kind: in words.
    """

    length: float
    width: float
    height: float
    cab: float
    load: str
    kind: str


HEAVY_SHAPES: dict[str, HeavyShape] = {
    "bus": HeavyShape(11.6, 2.5, 3.1, 0.0, "", "bus"),
    "coach": HeavyShape(12.0, 2.5, 3.5, 0.0, "", "coach"),
    "midibus": HeavyShape(8.6, 2.35, 2.9, 0.0, "", "midibus"),
    "box truck": HeavyShape(7.4, 2.4, 3.3, 1.9, "box", "box truck"),
    "lorry": HeavyShape(9.8, 2.5, 3.7, 2.2, "box", "lorry"),
    "tipper": HeavyShape(7.8, 2.5, 2.9, 2.2, "tipper", "tipper"),
    "tanker": HeavyShape(8.8, 2.45, 3.1, 2.2, "tank", "tanker"),
    "flatbed": HeavyShape(7.0, 2.3, 2.6, 1.9, "flat", "flatbed"),
}


def build_bus(shape: HeavyShape, livery: Livery) -> Body:
    """A bus: window bands, doors, a display, a livery."""
    builder = BodyBuilder()
    half, side = shape.length / 2, shape.width / 2
    builder.box((-half + 0.3, -side + 0.15, 0.08), (half - 0.3, side - 0.15, 0.4), _DARK, 0, Surface.MATT)
    faces = builder.box((-half, -side, 0.32), (half, side, shape.height), livery.paint, 1)
    front, back, left, right, top = faces
    _bus_ends(builder, front, back, livery)
    for face, is_kerb_side in ((left, False), (right, True)):
        _bus_side(builder, face, livery, is_kerb_side=is_kerb_side, is_coach=shape.kind == "coach")
    builder.face(
        patch(top, 0.02, 0.98, 0.04, 0.96), darker(livery.paint, 0.97) if livery.pattern != "roof" else livery.second
    )
    for start in (0.18, 0.62):
        builder.face(patch(top, start, start + 0.1, 0.35, 0.65), _GREY, Surface.MATT, 50)
    wheels(builder, (half - 2.3, -half + 2.9), side + 0.012, 0.48)
    builder.box(
        (-half + 1.5, -0.75, shape.height), (-half + 4.0, 0.75, shape.height + 0.22), darker(livery.paint, 0.85), 2
    )
    return builder.build((shape.length, shape.width, shape.height + 0.22))


def _bus_ends(builder: BodyBuilder, front: Floats, back: Floats, livery: Livery) -> None:
    builder.face(patch(front, 0.05, 0.95, 0.36, 0.84), _GLASS, Surface.GLASS)
    builder.face(patch(front, 0.14, 0.86, 0.87, 0.97), (22, 22, 22), Surface.MATT, 14)
    builder.face(patch(front, 0.22, 0.62, 0.89, 0.95), _AMBER_TEXT, Surface.GLOWING, 36)
    for low, high in ((0.04, 0.20), (0.80, 0.96)):
        builder.face(patch(front, low, high, 0.10, 0.20), _LAMP, Surface.HEADLIGHT, 12)
        builder.face(patch(back, low, high, 0.10, 0.26), _TAIL, Surface.TAILLIGHT, 12)
    builder.face(patch(front, 0.38, 0.62, 0.06, 0.12), (225, 225, 210), Surface.MATT, 60)
    builder.face(patch(back, 0.12, 0.88, 0.58, 0.88), _GLASS, Surface.GLASS, 12)
    if livery.pattern in ("advert", "band", "stripe"):
        builder.face(patch(back, 0.08, 0.92, 0.28, 0.54), livery.second, Surface.PAINT, 16)


def _bus_side(builder: BodyBuilder, face: Floats, livery: Livery, *, is_kerb_side: bool, is_coach: bool) -> None:
    bottom = 0.50 if is_coach else 0.42
    if livery.pattern == "band":
        builder.face(patch(face, 0.0, 1.0, 0.0, 0.22), livery.second)
    elif livery.pattern == "stripe":
        builder.face(patch(face, 0.0, 1.0, 0.28, 0.36), livery.second)
        builder.face(patch(face, 0.0, 1.0, 0.90, 1.0), livery.second)
    elif livery.pattern == "advert":
        builder.face(patch(face, 0.24, 0.72, 0.06, 0.40), livery.second)
        builder.face(patch(face, 0.30, 0.52, 0.16, 0.30), darker(livery.paint, 0.6), Surface.MATT, 40)
        builder.face(patch(face, 0.56, 0.68, 0.12, 0.34), (240, 210, 60), Surface.PAINT, 40)
    builder.face(patch(face, 0.01, 0.99, bottom, 0.85), _DARK, Surface.MATT)
    count = 7
    for k in range(count):
        start = 0.02 + 0.96 * k / count
        builder.face(
            patch(face, start, start + 0.96 / count - 0.012, bottom + 0.02, 0.83),
            (62, 70, 78),
            Surface.LIT_AT_NIGHT,
            10,
        )
    if is_kerb_side and not is_coach:
        for start in (0.40, 0.86):
            builder.face(patch(face, start, start + 0.10, 0.05, 0.80), (56, 62, 70), Surface.GLASS, 18)
            builder.face(patch(face, start + 0.047, start + 0.053, 0.05, 0.80), livery.paint, Surface.MATT, 40)


def build_truck(shape: HeavyShape, livery: Livery) -> Body:
    """A lorry: cab and load."""
    builder = BodyBuilder()
    half, side = shape.length / 2, shape.width / 2
    joint = half - shape.cab
    builder.box((-half + 0.1, -side + 0.25, 0.42), (half - 0.2, side - 0.25, 0.95), _DARK, 0, Surface.MATT)
    wheels(builder, (half - 1.3, -half + 1.5, -half + 2.7), side - 0.02, 0.5)
    _load(builder, shape, livery, joint)
    _cab(builder, shape, livery, joint)
    return builder.build((shape.length, shape.width, shape.height))


def _cab(builder: BodyBuilder, shape: HeavyShape, livery: Livery, joint: float) -> None:
    half, side = shape.length / 2, shape.width / 2 - 0.05
    height = min(shape.height - 0.35, 2.75)
    low, high = 0.45, height
    builder.part((joint + 0.8, 0.0, 1.4), 1)
    knee = 1.35
    front_low = np.array([(half, -side, low), (half, side, low), (half, side, knee), (half, -side, knee)])
    front_high = np.array(
        [(half, -side, knee), (half, side, knee), (half - 0.3, side - 0.08, high), (half - 0.3, -side + 0.08, high)]
    )
    builder.face(front_low, livery.paint)
    builder.face(patch(front_low, 0.2, 0.8, 0.35, 0.85), _DARK, Surface.MATT, 24)
    builder.face(patch(front_low, 0.0, 1.0, 0.0, 0.22), _GREY, Surface.MATT, 18)
    for left, right in ((0.03, 0.18), (0.82, 0.97)):
        builder.face(patch(front_low, left, right, 0.08, 0.30), _LAMP, Surface.HEADLIGHT, 12)
    builder.face(front_high, livery.paint)
    builder.face(patch(front_high, 0.05, 0.95, 0.05, 0.78), _GLASS, Surface.GLASS)
    for sign in (-1, 1):
        outer, inner = sign * side, sign * (side - 0.08)
        builder.face(
            [
                (joint, outer, low),
                (half, outer, low),
                (half, outer, knee),
                (half - 0.3, inner, high),
                (joint, inner, high),
            ],
            livery.paint,
        )
        window = np.array(
            [
                (joint + 0.5, outer, knee),
                (half - 0.12, outer, knee),
                (half - 0.36, inner, high),
                (joint + 0.5, inner, high),
            ]
        )
        builder.face(patch(window, 0.05, 0.95, 0.06, 0.75), _GLASS, Surface.GLASS, 12)
        builder.disc((half - 1.3, outer * 1.01, 0.5), 0.5, (24, 24, 25))
        builder.disc((half - 1.3, outer * 1.012, 0.5), 0.3, _GREY, 18)
    builder.face(
        [(joint, -side, low), (joint, side, low), (joint, side - 0.08, high), (joint, -side + 0.08, high)],
        darker(livery.paint, 0.8),
    )
    builder.face(
        [
            (joint, -side + 0.08, high),
            (half - 0.3, -side + 0.08, high),
            (half - 0.3, side - 0.08, high),
            (joint, side - 0.08, high),
        ],
        livery.paint,
    )


def _load(builder: BodyBuilder, shape: HeavyShape, livery: Livery, joint: float) -> None:
    half, side = shape.length / 2, shape.width / 2
    rear, front = -half, joint - 0.12
    if shape.load == "tank":
        _tank(builder, shape, livery, rear, front)
        return
    low = 0.95
    high = shape.height if shape.load == "box" else (shape.height - 0.55 if shape.load == "tipper" else low + 0.15)
    colour = livery.second if shape.load != "flat" else (110, 92, 70)
    faces = builder.box((rear, -side, low), (front, side, high), colour, 1, place=(joint - 0.8, 0.0, 1.4))
    _decorate_load(builder, shape, livery, faces, colour)
    for sign in (-1, 1):
        for x in (-half + 1.5, -half + 2.7):
            builder.disc((x, sign * (side + 0.006), 0.5), 0.5, (24, 24, 25))
            builder.disc((x, sign * (side + 0.008), 0.5), 0.3, _GREY, 18)


def _decorate_load(
    builder: BodyBuilder, shape: HeavyShape, livery: Livery, faces: list[Floats], colour: Colour
) -> None:
    _, back, left, right, top = faces
    if shape.load == "box":
        builder.face(patch(back, 0.48, 0.52, 0.03, 0.97), darker(colour, 0.6), Surface.MATT, 30)
        for face in (left, right):
            if livery.pattern in ("advert", "stripe", "band"):
                builder.face(patch(face, 0.10, 0.80, 0.30, 0.72), livery.paint, Surface.PAINT, 16)
                builder.face(patch(face, 0.18, 0.50, 0.44, 0.58), colour, Surface.PAINT, 30)
            builder.face(patch(face, 0.0, 1.0, 0.0, 0.05), darker(colour, 0.6), Surface.MATT, 24)
    elif shape.load == "tipper":
        builder.face(patch(top, 0.03, 0.97, 0.05, 0.95), (104, 88, 66), Surface.MATT)
        for face in (left, right):
            for start in (0.2, 0.4, 0.6, 0.8):
                builder.face(patch(face, start, start + 0.03, 0.0, 1.0), darker(colour, 0.75), Surface.PAINT, 30)
    for low_share, high_share in ((0.02, 0.16), (0.84, 0.98)):
        builder.face(patch(back, low_share, high_share, 0.0, 0.08), _TAIL, Surface.TAILLIGHT, 12)


def _tank(builder: BodyBuilder, shape: HeavyShape, livery: Livery, rear: float, front: float) -> None:
    radius = (shape.height - 0.95) / 2
    centre, sides = 0.95 + radius, 12
    builder.part(((rear + front) / 2, 0.0, centre), 1, (front - 0.7, 0.0, 1.4))
    ring = [
        (
            shape.width / 2 * np.cos(2 * np.pi * (k + 0.5) / sides),
            centre + radius * np.sin(2 * np.pi * (k + 0.5) / sides),
        )
        for k in range(sides)
    ]
    for k in range(sides):
        (y0, z0), (y1, z1) = ring[k], ring[(k + 1) % sides]
        quad = builder.face([(rear, y0, z0), (front, y0, z0), (front, y1, z1), (rear, y1, z1)], livery.second)
        if livery.pattern != "plain":
            builder.face(patch(quad, 0.35, 0.65, 0.0, 1.0), livery.paint)
    builder.face([(rear, y, z) for y, z in ring], darker(livery.second, 0.9))
    builder.part((rear + 1.5, 0.0, 0.8), 1)
    for sign in (-1, 1):
        for x in (rear + 1.5, rear + 2.7):
            builder.disc((x, sign * (shape.width / 2 + 0.006), 0.5), 0.5, (24, 24, 25))
            builder.disc((x, sign * (shape.width / 2 + 0.008), 0.5), 0.3, _GREY, 18)
