"""Who is in a crowd: people with clothes of few colours, so that many differ by a shade only."""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.random import Generator

from lookonce.synthetic.body import BodyBuilder
from lookonce.synthetic.fleet import CLASSES, Member
from lookonce.synthetic.people import HAIRS, SKINS, Person

__all__ = ["alike_people"]

Colour = tuple[float, float, float]


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


def _any_colour(rng: Generator) -> Colour:
    """A colour as clothes have it, 0 to 255: rather dark and rather grey."""
    red, green, blue = colorsys.hsv_to_rgb(rng.random(), rng.beta(1, 2.2), 0.05 + 0.9 * rng.beta(1.2, 1.6))
    return 255 * red, 255 * green, 255 * blue


def _shade(colour: Colour, spread: float, rng: Generator) -> Colour:
    """A colour near another."""
    brightness = np.exp(rng.normal(0, spread))
    red, green, blue = np.clip(np.array(colour) * brightness + rng.normal(0, 60 * spread, 3), 4, 250).tolist()
    return red, green, blue
