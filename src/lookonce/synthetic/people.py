"""People on foot, and people on two wheels, as capsules that move."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lookonce.synthetic.body import Body, BodyBuilder, Capsules, Surface

__all__ = ["HAIRS", "SKINS", "Person", "draw_person", "dress_up", "two_wheeler_body"]

Colour = tuple[float, float, float]
Point = tuple[float, float, float]
Row = tuple[Point, Point, float, float, Colour]

SKINS: tuple[Colour, ...] = ((236, 198, 170), (222, 178, 146), (188, 136, 104), (142, 98, 72), (96, 66, 50))
HAIRS: tuple[Colour, ...] = ((34, 28, 26), (62, 44, 32), (112, 80, 48), (190, 160, 96), (170, 170, 172))
_CLOTHES: tuple[Colour, ...] = (
    (38, 40, 48),
    (60, 74, 110),
    (150, 36, 42),
    (210, 208, 200),
    (120, 122, 126),
    (46, 96, 70),
    (216, 170, 60),
    (92, 60, 96),
    (70, 140, 180),
    (224, 120, 60),
    (172, 146, 112),
)
_TROUSERS: tuple[Colour, ...] = ((36, 38, 46), (44, 56, 92), (96, 92, 84), (150, 138, 112), (62, 48, 40), (24, 24, 26))


@dataclass(frozen=True, slots=True)
class Person:
    """How somebody looks.

    Attributes:
        height: m.
        skin: colour, as the others 0 to 255.
        hair: of the head's top; a hat or a helmet too.
        top: of the upper body and sleeves.
        trousers: of the legs.
        shoes: of the feet.
        has_skirt: a skirt or a long coat in the top's colour.
        has_pack: a rucksack.
        pack: its colour.
        girth: 1 = usual.
    """

    height: float
    skin: Colour
    hair: Colour
    top: Colour
    trousers: Colour
    shoes: Colour
    has_skirt: bool
    has_pack: bool
    pack: Colour
    girth: float


def dress_up(rng: np.random.Generator) -> Person:
    """Somebody."""

    def choice(colours: tuple[Colour, ...]) -> Colour:
        tint = float(rng.uniform(0.85, 1.1))
        red, green, blue = colours[int(rng.integers(len(colours)))]
        return red * tint, green * tint, blue * tint

    is_child = rng.random() < 0.1
    return Person(
        height=float(rng.uniform(1.15, 1.4) if is_child else rng.normal(1.72, 0.08)),
        skin=choice(SKINS),
        hair=choice(HAIRS if rng.random() < 0.8 else _CLOTHES),
        top=choice(_CLOTHES),
        trousers=choice(_TROUSERS),
        shoes=choice(_TROUSERS) if rng.random() < 0.7 else (225.0, 225.0, 225.0),
        has_skirt=bool(rng.random() < 0.22),
        has_pack=bool(rng.random() < 0.25),
        pack=choice(_CLOTHES),
        girth=float(rng.uniform(0.9, 1.2)),
    )


def draw_person(person: Person, stride: float, *, is_walking: bool) -> Capsules:
    """Somebody on foot at a moment.

    Args:
        person: who.
        stride: phase of the walk in rad; 2 pi is two steps.
        is_walking: else standing.
    """
    tall, wide = person.height, person.girth
    swing = (0.42 if is_walking else 0.05) * math.sin(stride)
    lift = 0.5 if is_walking else 0.0
    hip, shoulder, head = 0.50 * tall, 0.80 * tall, 0.925 * tall
    rows: list[Row] = []
    for sign in (-1, 1):
        angle = sign * swing
        bend = max(0.0, -math.sin(stride + (0.9 if sign > 0 else 0.9 + math.pi))) * lift
        rows += _leg(person, sign * 0.085 * wide, hip, angle, bend)
        rows += _arm(person, sign * 0.20 * wide, shoulder, -0.8 * angle)
    waist = 0.135 * wide * tall / 1.72
    lower = hip - (0.16 * tall if person.has_skirt else 0.01)
    rows.append(
        ((0.0, 0.0, lower), (0.0, 0.0, hip + 0.06), waist * (1.25 if person.has_skirt else 0.95), waist, person.top)
    )
    rows.append(((0.0, 0.0, hip + 0.04), (0.01, 0.0, shoulder - 0.05), waist, waist * 1.18, person.top))
    if person.has_pack:
        rows.append(((-0.17, 0.0, hip + 0.15), (-0.16, 0.0, shoulder - 0.05), 0.12, 0.13, person.pack))
    rows.append(((0.01, 0.0, shoulder), (0.02, 0.0, head), 0.055, 0.06, person.skin))
    rows += _head(person, (0.02, 0.0, head))
    return Capsules.of(rows)


def _head(person: Person, at: Point) -> list[Row]:
    x, y, z = at
    radius = 0.062 * person.height
    return [
        ((x + 0.02, y, z - 0.015), (x + 0.02, y, z + 0.02), radius * 0.9, radius * 0.92, person.skin),
        ((x - 0.035, y, z), (x - 0.02, y, z + 0.045), radius, radius * 0.98, person.hair),
    ]


def _leg(person: Person, y: float, hip: float, angle: float, bend: float) -> list[Row]:
    thigh = shin = 0.5 * hip - 0.03
    knee = (thigh * math.sin(angle), y, hip - thigh * math.cos(angle))
    low = angle - bend
    foot = (knee[0] + shin * math.sin(low), y, max(0.05, knee[2] - shin * math.cos(low)))
    colour = person.trousers
    return [
        ((0.0, y, hip), knee, 0.088 * person.girth, 0.066, colour),
        (knee, foot, 0.064, 0.048, colour if not person.has_skirt else person.skin),
        (foot, (foot[0] + 0.15, y, max(0.04, foot[2] - 0.02)), 0.05, 0.042, person.shoes),
    ]


def _arm(person: Person, y: float, shoulder: float, angle: float) -> list[Row]:
    upper, lower = 0.165 * person.height, 0.15 * person.height
    elbow = (upper * math.sin(angle), y * 1.12, shoulder - 0.04 - upper * math.cos(angle))
    low = angle + 0.35
    hand = (elbow[0] + lower * math.sin(low), y * 1.1, elbow[2] - lower * math.cos(low))
    return [
        ((0.0, y, shoulder - 0.04), elbow, 0.056, 0.045, person.top),
        (elbow, hand, 0.043, 0.036, person.top),
        (hand, (hand[0] + 0.02, hand[1], hand[2] - 0.06), 0.04, 0.035, person.skin),
    ]


def two_wheeler_body(person: Person, paint: Colour, *, is_motorcycle: bool) -> Body:
    """A bicycle or motorcycle with its rider; the pedals stand still."""
    builder = BodyBuilder()
    radius = 0.31 if is_motorcycle else 0.34
    base = 0.72 if is_motorcycle else 0.53
    builder.part((0.0, 0.0, radius), 0)
    thick = 0.05 if is_motorcycle else 0.015
    for sign in (-1, 1):
        for x in (-base, base):
            builder.disc((x, sign * thick, radius), radius, (26, 26, 28), sides=14)
            grey: Colour = (96, 98, 100) if is_motorcycle else (128, 130, 128)
            builder.disc((x, sign * (thick + 0.001), radius), radius * (0.68 if is_motorcycle else 0.86), grey, 9, 14)
    rows = _motorcycle(paint, base, radius) if is_motorcycle else _bicycle(paint, base, radius)
    rows += _rider(person, is_motorcycle=is_motorcycle)
    if is_motorcycle:
        builder.part((0.0, 0.0, 0.8), 1)
        x = base + 0.12
        builder.face(
            [(x, -0.09, 0.78), (x, 0.09, 0.78), (x, 0.09, 0.93), (x, -0.09, 0.93)], (226, 230, 232), Surface.HEADLIGHT
        )
        x = -base - 0.18
        builder.face(
            [(x, -0.08, 0.72), (x, 0.08, 0.72), (x, 0.08, 0.80), (x, -0.08, 0.80)], (150, 20, 20), Surface.TAILLIGHT
        )
    length = 2 * (base + radius)
    return builder.build((length, 0.75 if is_motorcycle else 0.6, 1.6 if is_motorcycle else 1.75), Capsules.of(rows))


def _motorcycle(paint: Colour, base: float, radius: float) -> list[Row]:
    dark: Colour = (36, 36, 38)
    steel: Colour = (130, 132, 136)
    return [
        ((base, 0.0, radius), (base - 0.22, 0.0, 0.92), 0.05, 0.05, steel),
        ((-base, 0.0, radius), (-0.1, 0.0, 0.45), 0.07, 0.12, dark),
        ((-0.15, 0.0, 0.42), (0.25, 0.0, 0.45), 0.17, 0.17, steel),
        ((0.02, 0.0, 0.78), (0.38, 0.0, 0.84), 0.15, 0.17, paint),
        ((-0.10, 0.0, 0.76), (-0.62, 0.0, 0.80), 0.12, 0.08, dark),
        ((-0.55, 0.0, 0.72), (-base - 0.12, 0.0, 0.76), 0.09, 0.06, paint),
        ((base - 0.24, -0.33, 1.0), (base - 0.24, 0.33, 1.0), 0.03, 0.03, dark),
        ((base - 0.18, 0.0, 0.80), (base + 0.02, 0.0, 0.86), 0.14, 0.10, paint),
        ((base - 0.05, 0.0, 0.62), (base + 0.22, 0.0, 0.58), 0.07, 0.05, paint),
    ]


def _bicycle(paint: Colour, base: float, radius: float) -> list[Row]:
    dark: Colour = (34, 34, 36)
    tube = 0.022
    seat, crank, head = (-0.2, 0.0, 0.86), (-0.05, 0.0, 0.30), (0.38, 0.0, 0.82)
    return [
        (crank, seat, tube, tube, paint),
        (crank, head, tube, tube, paint),
        (seat, head, tube, tube, paint),
        ((-base, 0.0, radius), seat, tube * 0.8, tube * 0.8, paint),
        ((-base, 0.0, radius), crank, tube * 0.8, tube * 0.8, paint),
        ((base, 0.0, radius), head, tube, tube, paint),
        (head, (0.40, 0.0, 1.0), tube, tube, dark),
        ((0.40, -0.27, 1.02), (0.40, 0.27, 1.02), 0.02, 0.02, dark),
        ((-0.30, 0.0, 0.92), (-0.08, 0.0, 0.92), 0.06, 0.03, dark),
    ]


def _rider(person: Person, *, is_motorcycle: bool) -> list[Row]:
    hip = (-0.25, 0.0, 0.90) if is_motorcycle else (-0.2, 0.0, 0.98)
    shoulder = (0.05, 0.0, 1.36) if is_motorcycle else (0.06, 0.0, 1.42)
    grip_x, grip_z = (0.46, 1.02) if is_motorcycle else (0.40, 1.05)
    rows: list[Row] = []
    for sign in (-1, 1):
        knee = (0.18, sign * 0.20, 0.80) if is_motorcycle else (0.14, sign * 0.11, 0.72 + 0.1 * sign)
        foot = (-0.08, sign * 0.22, 0.36) if is_motorcycle else (-0.05, sign * 0.12, 0.30 + 0.14 * sign)
        rows.append(((hip[0], sign * 0.09, hip[2] - 0.02), knee, 0.09, 0.07, person.trousers))
        rows.append((knee, foot, 0.065, 0.05, person.trousers))
        rows.append((foot, (foot[0] + 0.16, foot[1], foot[2] - 0.01), 0.05, 0.04, person.shoes))
        elbow = (0.16, sign * 0.30, 1.12)
        rows.append(((shoulder[0], sign * 0.19, shoulder[2] - 0.03), elbow, 0.058, 0.048, person.top))
        rows.append((elbow, (grip_x, sign * 0.27, grip_z), 0.045, 0.04, person.top))
    rows.append(
        (hip, (shoulder[0] - 0.03, 0.0, shoulder[2] - 0.08), 0.14 * person.girth, 0.16 * person.girth, person.top)
    )
    if person.has_pack:
        rows.append(
            ((hip[0] - 0.08, 0.0, hip[2] + 0.22), (shoulder[0] - 0.2, 0.0, shoulder[2] - 0.02), 0.12, 0.12, person.pack)
        )
    head = (shoulder[0] + 0.08, 0.0, shoulder[2] + 0.18)
    if is_motorcycle:
        rows.append((head, (head[0] - 0.03, 0.0, head[2] + 0.03), 0.13, 0.13, person.hair))
        rows.append(
            ((head[0] + 0.07, 0.0, head[2] + 0.01), (head[0] + 0.08, 0.0, head[2] + 0.02), 0.08, 0.08, (30, 32, 36))
        )
    else:
        rows += _head(person, head)
    return rows
