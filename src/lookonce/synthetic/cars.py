"""Cars and delivery vans as bodies: a lofted lower body, a cabin with windows, lamps and wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.body import Body, BodyBuilder, Surface, patch

__all__ = ["CAR_SHAPES", "CarShape", "Livery", "build_car", "darker", "wheels"]

Floats = NDArray[np.float64]
Colour = tuple[float, float, float]

_GLASS: Colour = (38, 46, 54)
_DARK: Colour = (28, 28, 30)
_TYRE: Colour = (24, 24, 25)
_HUB: Colour = (150, 152, 156)
_LAMP: Colour = (226, 230, 232)
_TAIL: Colour = (140, 18, 18)
_PLATE: Colour = (225, 225, 210)


@dataclass(frozen=True, slots=True)
class CarShape:
    """The measures of a model, m; x from the middle, ahead is positive.

    Attributes:
        length: bumper to bumper.
        width: without mirrors.
        height: of the roof.
        belt: height of the lower edge of the windows.
        nose: height of the bonnet's front edge.
        windscreen: x of its lower edge.
        roof_front: x of the roof's front edge.
        roof_rear: x of the roof's rear edge.
        rear_glass: x of the lower edge of the rear window.
        tail: height of the boot's rear edge.
        wheel: radius.
        side_windows: shares of the cabin's length where windows begin and end; none = a closed van.
        kind: type of the vehicle, in words.
    """

    length: float
    width: float
    height: float
    belt: float
    nose: float
    windscreen: float
    roof_front: float
    roof_rear: float
    rear_glass: float
    tail: float
    wheel: float
    side_windows: tuple[tuple[float, float], ...]
    kind: str


@dataclass(frozen=True, slots=True)
class Livery:
    """The colours of a vehicle.

    Attributes:
        paint: of the body, 0 to 255.
        second: of roof, stripe or advert.
        pattern: "plain", "stripe", "roof", "band", "advert" or "taxi".
    """

    paint: Colour
    second: Colour = (235, 235, 235)
    pattern: str = "plain"


_THREE = ((0.05, 0.34), (0.37, 0.66), (0.70, 0.93))
_TWO = ((0.06, 0.46), (0.50, 0.93))

CAR_SHAPES: dict[str, CarShape] = {
    "hatchback": CarShape(4.0, 1.75, 1.47, 0.92, 0.74, 0.95, 0.35, -1.45, -1.85, 0.90, 0.31, _TWO, "hatchback"),
    "sedan": CarShape(4.7, 1.82, 1.45, 0.92, 0.72, 0.95, 0.25, -1.05, -1.65, 0.92, 0.33, _TWO, "sedan"),
    "estate": CarShape(4.75, 1.82, 1.48, 0.92, 0.73, 1.00, 0.30, -1.95, -2.28, 0.92, 0.33, _THREE, "estate"),
    "suv": CarShape(4.55, 1.88, 1.70, 1.08, 0.95, 1.00, 0.45, -1.80, -2.20, 1.05, 0.37, _THREE, "suv"),
    "small": CarShape(3.5, 1.62, 1.50, 0.94, 0.80, 1.05, 0.55, -1.30, -1.62, 0.92, 0.29, _TWO, "small car"),
    "coupe": CarShape(4.45, 1.86, 1.32, 0.86, 0.64, 0.75, 0.05, -0.80, -1.75, 0.88, 0.34, ((0.08, 0.80),), "coupe"),
    "pickup": CarShape(5.3, 1.88, 1.78, 1.10, 0.98, 1.15, 0.60, -0.70, -0.80, 1.08, 0.38, _TWO, "pickup"),
    "mpv": CarShape(4.6, 1.84, 1.68, 0.98, 0.82, 1.45, 0.60, -1.85, -2.20, 0.96, 0.33, _THREE, "mpv"),
    "van": CarShape(5.2, 1.98, 2.15, 1.15, 0.98, 1.85, 1.15, -2.50, -2.56, 1.14, 0.35, ((0.03, 0.24),), "van"),
    "minibus": CarShape(5.4, 2.0, 2.2, 1.15, 0.98, 2.0, 1.35, -2.6, -2.66, 1.14, 0.35, _THREE, "minibus"),
}


def darker(colour: Colour, share: float) -> Colour:
    """The colour with only that share of its light."""
    return colour[0] * share, colour[1] * share, colour[2] * share


def build_car(shape: CarShape, livery: Livery) -> Body:
    """The body of a car or van."""
    builder = BodyBuilder()
    half = shape.length / 2
    builder.box(
        (-half + 0.25, -shape.width * 0.43, 0.06), (half - 0.25, shape.width * 0.43, 0.34), _DARK, 0, Surface.MATT
    )
    _lower_body(builder, shape, livery)
    axles = (half - 0.20 * shape.length, -half + 0.20 * shape.length)
    wheels(builder, axles, shape.width / 2 + 0.012, shape.wheel)
    _cabin(builder, shape, livery)
    _mirrors(builder, shape, livery)
    if livery.pattern == "taxi":
        builder.box((-0.15, -0.3, shape.height), (0.1, 0.3, shape.height + 0.16), (240, 214, 90), 3, Surface.GLOWING)
    top = shape.height + (0.16 if livery.pattern == "taxi" else 0.0)
    return builder.build((shape.length, shape.width, top))


def _plan(shape: CarShape, inset: float) -> list[tuple[float, float]]:
    """The outline from above, eight corners, the front edge's right corner first."""
    half, side = shape.length / 2 - inset * 0.6, shape.width / 2 - inset
    nose, bend = side * 0.76, 0.32
    return [
        (half, -nose),
        (half, nose),
        (half - bend, side),
        (-half + bend, side),
        (-half, nose),
        (-half, -nose),
        (-half + bend, -side),
        (half - bend, -side),
    ]


def _lower_body(builder: BodyBuilder, shape: CarShape, livery: Livery) -> None:
    builder.part((0.0, 0.0, 0.6), 1)
    waist = 0.62 * shape.belt
    paint = livery.paint
    rings = [
        [(x, y, front if x > 0 else min(height, shape.tail)) for x, y in _plan(shape, inset)]
        for inset, height, front in ((0.10, 0.22, 0.22), (0.0, waist, waist), (0.07, shape.belt, shape.nose))
    ]
    for lower, upper in ((0, 1), (1, 2)):
        for k in range(8):
            ends = (k + 1) % 8
            quad = np.array([rings[lower][k], rings[lower][ends], rings[upper][ends], rings[upper][k]])
            if k in (2, 6) and upper == 2:  # the side's upper edge follows bonnet and belt
                _side(builder, quad, shape, paint)
                continue
            colour = darker(paint, 0.92) if lower == 0 else paint
            face = builder.face(quad, colour)
            if k == 0:
                _front(builder, face, lower)
            elif k == 4:
                _rear(builder, face, lower)
            elif lower == 1 and k in (1, 7):
                builder.face(patch(face, 0.0, 1.0, 0.30, 0.85), _LAMP, Surface.HEADLIGHT, 26)
            elif lower == 1 and k in (3, 5):
                builder.face(patch(face, 0.0, 1.0, 0.30, 0.90), _TAIL, Surface.TAILLIGHT, 26)
            if livery.pattern == "stripe" and lower == 0 and k in (2, 6):
                builder.face(patch(face, 0.02, 0.98, 0.60, 1.0), livery.second, Surface.PAINT, 20)
    _tops(builder, rings[2], shape, paint)


def _side(builder: BodyBuilder, quad: Floats, shape: CarShape, paint: Colour) -> None:
    """The upper strip of a side, with the bonnet falling off ahead of the windscreen."""
    order = quad if quad[0][0] > quad[1][0] else quad[[1, 0, 3, 2]]  # front first
    share = (shape.windscreen + 0.15 - order[3][0]) / (order[2][0] - order[3][0])
    knee = order[3] + share * (order[2] - order[3])
    knee[2] = shape.belt
    builder.face(np.array([order[0], order[1], order[2], knee, order[3]]), paint)
    for place in (0.36, 0.60):
        builder.face(patch(order, place, place + 0.035, 0.55, 0.68), darker(paint, 0.55), Surface.MATT, 70)
        builder.face(patch(order, place + 0.10, place + 0.105, -0.9, 0.95), darker(paint, 0.5), Surface.MATT, 90)


def _front(builder: BodyBuilder, face: Floats, strip: int) -> None:
    if strip == 0:
        builder.face(patch(face, 0.08, 0.92, 0.05, 0.42), _DARK, Surface.MATT, 24)
        builder.face(patch(face, 0.34, 0.66, 0.45, 0.72), _PLATE, Surface.MATT, 40)
    else:
        builder.face(patch(face, 0.26, 0.74, 0.12, 0.70), _DARK, Surface.MATT, 30)
        for low, high in ((0.0, 0.22), (0.78, 1.0)):
            builder.face(patch(face, low, high, 0.28, 0.85), _LAMP, Surface.HEADLIGHT, 16)


def _rear(builder: BodyBuilder, face: Floats, strip: int) -> None:
    if strip == 0:
        builder.face(patch(face, 0.06, 0.94, 0.02, 0.35), _DARK, Surface.MATT, 24)
    else:
        builder.face(patch(face, 0.34, 0.66, 0.15, 0.55), _PLATE, Surface.MATT, 36)
        for low, high in ((0.0, 0.21), (0.79, 1.0)):
            builder.face(patch(face, low, high, 0.30, 0.90), _TAIL, Surface.TAILLIGHT, 14)


def _tops(builder: BodyBuilder, ring: list[tuple[float, float, float]], shape: CarShape, paint: Colour) -> None:
    """Bonnet, the plane under the cabin, and boot."""
    side = shape.width / 2 - 0.07
    cowl, deck = shape.windscreen + 0.15, shape.rear_glass
    front = [(cowl, side, shape.belt), (cowl, -side, shape.belt)]
    bonnet = [ring[0], ring[1], ring[2], *front, ring[7]]
    builder.face(bonnet, paint)
    inner = np.array([ring[7], ring[2], front[0], front[1]])
    builder.face(patch(inner, 0.30, 0.70, 0.05, 0.95), darker(paint, 0.94), Surface.PAINT, 60)
    back = [(deck, side, shape.belt), (deck, -side, shape.belt)]
    builder.face([*front, back[1], back[0]], darker(paint, 0.8))
    boot = [back[0], ring[3], ring[4], ring[5], ring[6], back[1]]
    if shape.kind == "pickup":
        builder.face(boot, darker(paint, 0.9))
        bed = np.array([(deck - 0.1, -side + 0.14, shape.belt), (ring[4][0] + 0.15, -side + 0.14, shape.belt)])
        builder.face([*bed, *(bed[::-1] * [1, -1, 1])], _DARK, Surface.MATT)
    else:
        builder.face(boot, paint)


def _cabin(builder: BodyBuilder, shape: CarShape, livery: Livery) -> None:
    low, high = shape.width / 2 - 0.08, shape.width / 2 - (0.12 if shape.height > 2 else 0.27)
    belt, top = shape.belt, shape.height
    builder.part((-0.4, 0.0, belt), 2)
    roof_paint = livery.second if livery.pattern == "roof" else livery.paint
    base = [(shape.windscreen, -low), (shape.windscreen, low), (shape.rear_glass, low), (shape.rear_glass, -low)]
    roof = [(shape.roof_front, -high), (shape.roof_front, high), (shape.roof_rear, high), (shape.roof_rear, -high)]
    quads = []
    for k in range(4):
        ends = (k + 1) % 4
        quads.append(np.array([(*base[k], belt), (*base[ends], belt), (*roof[ends], top), (*roof[k], top)]))
    builder.face(quads[0], livery.paint)
    builder.face(patch(quads[0], 0.04, 0.96, 0.04, 0.93), _GLASS, Surface.GLASS)
    builder.face(quads[2], livery.paint)
    if shape.kind != "van":
        builder.face(patch(quads[2], 0.08, 0.92, 0.12, 0.88), _GLASS, Surface.GLASS, 8)
    else:
        for left in (0.10, 0.55):
            builder.face(patch(quads[2], left, left + 0.35, 0.35, 0.85), _GLASS, Surface.GLASS, 20)
    for k in (1, 3):
        builder.face(quads[k], livery.paint)
        for start, end in shape.side_windows:
            u0, u1 = (start, end) if k == 1 else (1 - end, 1 - start)
            builder.face(patch(quads[k], u0, u1, 0.08, 0.86), _GLASS, Surface.GLASS, 12)
        if shape.kind == "van":
            _van_side(builder, quads[k], livery, mirrored=k == 3)
    builder.face([(x, y, top) for x, y in roof], roof_paint)
    if livery.pattern == "roof" or shape.kind in ("suv", "estate", "mpv"):
        roof_quad = np.array([(x, y, top) for x, y in roof])
        builder.face(patch(roof_quad, 0.1, 0.9, 0.12, 0.4), _GLASS, Surface.GLASS, 40)


def _van_side(builder: BodyBuilder, quad: Floats, livery: Livery, *, mirrored: bool) -> None:
    def place(start: float, end: float) -> tuple[float, float]:
        return (1 - end, 1 - start) if mirrored else (start, end)

    if livery.pattern in ("advert", "band"):
        builder.face(patch(quad, *place(0.36, 0.94), 0.15, 0.80), livery.second, Surface.PAINT, 16)
        builder.face(patch(quad, *place(0.42, 0.70), 0.40, 0.58), darker(livery.paint, 0.55), Surface.MATT, 36)
    builder.face(patch(quad, *place(0.345, 0.35), 0.0, 0.9), darker(livery.paint, 0.5), Surface.MATT, 60)


def _mirrors(builder: BodyBuilder, shape: CarShape, livery: Livery) -> None:
    belt = shape.belt
    x, y, z = shape.windscreen - 0.32, shape.width / 2 - 0.02, belt
    for sign in (-1, 1):
        low, high = sorted((sign * y, sign * (y + 0.16)))
        place = (-0.4, sign * y, belt)
        builder.box((x - 0.08, low, z - 0.02), (x + 0.08, high, z + 0.14), darker(livery.paint, 0.8), 2, place=place)


def wheels(builder: BodyBuilder, axles: tuple[float, ...], y: float, radius: float) -> None:
    """Wheels as discs on both sides, belonging to the part under way."""
    for sign in (-1, 1):
        for x in axles:
            builder.disc((x, sign * (y - 0.004), radius * 1.04), radius * 1.16, _DARK, 10)
            builder.disc((x, sign * y, radius), radius, _TYRE)
            builder.disc((x, sign * (y + 0.002), radius), radius * 0.62, _HUB, 16, sides=10)
            builder.disc((x, sign * (y + 0.004), radius), radius * 0.20, _DARK, 60, sides=6)
