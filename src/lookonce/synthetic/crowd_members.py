"""Who is in a crowd: people, or vehicles, of few colours and models, so that many differ by a shade only."""

from __future__ import annotations

import colorsys
from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from lookonce.synthetic.body import BodyBuilder
from lookonce.synthetic.cars import CAR_SHAPES, Livery, build_car
from lookonce.synthetic.fleet import CAR_SHARES, CLASSES, PAINTS, Member, draw_by_share
from lookonce.synthetic.heavy import HEAVY_SHAPES, build_bus, build_truck
from lookonce.synthetic.people import HAIRS, SKINS, Person

__all__ = ["alike_people", "alike_vehicles"]

Colour = tuple[float, float, float]

_KINDS = (("car", 0.8), ("van", 0.08), ("bus", 0.02), ("truck", 0.1))
_TRUCKS = ("box truck", "lorry", "tipper", "tanker", "flatbed")
_PATTERNS = (("plain", 0.4), ("stripe", 0.3), ("advert", 0.3))
_WHITE: Colour = (228, 230, 230)


def alike_people(count: int, spread: float, rng: Generator) -> list[Member]:
    """People who share a few colours of clothes.

    Args:
        count: how many.
        spread: standard deviation of a colour's logarithm from person to person; 0.06 is a shade, 0.35 another colour.
        rng: source of all choices.
    """
    tops = [_any_colour(rng) for _ in range(rng.integers(3, 9))]
    trousers = [_any_colour(rng) for _ in range(rng.integers(2, 6))]
    skins = [SKINS[index] for index in rng.integers(len(SKINS), size=3)]
    members = []
    for _ in range(count):
        hair = HAIRS[rng.integers(len(HAIRS))] if rng.random() < 0.8 else _any_colour(rng)
        person = Person(
            height=float(rng.normal(1.72, 0.09)),
            skin=_shade(skins[rng.integers(len(skins))], 0.1, rng),
            hair=_shade(hair, 0.15, rng),
            top=_shade(tops[rng.integers(len(tops))], spread, rng),
            trousers=_shade(trousers[rng.integers(len(trousers))], spread, rng),
            shoes=_any_colour(rng),
            has_skirt=bool(rng.random() < 0.15),
            has_pack=bool(rng.random() < 0.25),
            pack=_any_colour(rng),
            girth=float(rng.uniform(0.85, 1.3)),
        )
        nobody = BodyBuilder().build((0.45, 0.5, person.height))
        members.append(Member(CLASSES.index("person"), "pedestrian", nobody, person, 0.45, 0.5))
    return members


def alike_vehicles(count: int, spread: float, rng: Generator) -> list[Member]:
    """Vehicles of a few models and paints; the arguments are those of ``alike_people``."""
    usual = rng.integers(2, 8)
    paints = [draw_by_share(rng, PAINTS) if rng.random() < 0.75 else _any_colour(rng) for _ in range(usual)]
    models = [draw_by_share(rng, CAR_SHARES) for _ in range(rng.integers(2, 6))]
    makers: dict[str, Callable[[Colour], Member]] = {
        "car": lambda paint: _car(models[rng.integers(len(models))], _car_livery(paint, rng)),
        "van": lambda paint: _car("van", _livery(paint if rng.random() < 0.5 else _shade(_WHITE, 0.05, rng), rng)),
        "bus": lambda paint: _heavy("bus", "bus", _livery(paint, rng)),
        "truck": lambda paint: _heavy("truck", _TRUCKS[rng.integers(len(_TRUCKS))], _livery(paint, rng)),
    }
    return [
        makers[draw_by_share(rng, _KINDS)](_shade(paints[rng.integers(len(paints))], spread, rng)) for _ in range(count)
    ]


def _car(name: str, livery: Livery) -> Member:
    shape = CAR_SHAPES[name]
    return Member(CLASSES.index("car"), shape.kind, build_car(shape, livery), None, shape.length, shape.width)


def _heavy(kind: str, name: str, livery: Livery) -> Member:
    shape, build = HEAVY_SHAPES[name], build_bus if kind == "bus" else build_truck
    return Member(CLASSES.index(kind), shape.kind, build(shape, livery), None, shape.length, shape.width)


def _car_livery(paint: Colour, rng: Generator) -> Livery:
    chance = rng.random()
    return Livery(paint) if chance < 0.85 else Livery(paint, _any_colour(rng), "roof" if chance < 0.93 else "stripe")


def _livery(paint: Colour, rng: Generator) -> Livery:
    return Livery(paint, _any_colour(rng), draw_by_share(rng, _PATTERNS))


def _any_colour(rng: Generator) -> Colour:
    """A colour as clothes have it, 0 to 255: rather dark and rather grey."""
    red, green, blue = colorsys.hsv_to_rgb(rng.random(), rng.beta(1, 2.2), 0.05 + 0.9 * rng.beta(1.2, 1.6))
    return 255 * red, 255 * green, 255 * blue


def _shade(colour: Colour, spread: float, rng: Generator) -> Colour:
    """A colour near another."""
    brightness = np.exp(rng.normal(0, spread))
    red, green, blue = np.clip(np.array(colour) * brightness + rng.normal(0, 60 * spread, 3), 4, 250).tolist()
    return red, green, blue
