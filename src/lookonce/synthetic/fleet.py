"""Which vehicles there are, and what each looks like; many look alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from lookonce.synthetic.body import Body, BodyBuilder
from lookonce.synthetic.cars import CAR_SHAPES, Livery, build_car
from lookonce.synthetic.heavy import HEAVY_SHAPES, build_bus, build_truck
from lookonce.synthetic.people import Person, dress_up, two_wheeler_body

__all__ = ["CLASSES", "UA_DETRAC_TYPES", "Fleet", "Member"]

CLASSES = ("person", "bicycle", "motorcycle", "car", "bus", "truck")
# What UA-DETRAC calls the classes that it has; vans are a type of their own there.
UA_DETRAC_TYPES = {"car": "car", "bus": "bus", "truck": "others"}

Colour = tuple[float, float, float]
T = TypeVar("T")

_PAINTS: tuple[tuple[Colour, float], ...] = (
    ((226, 228, 228), 0.22),
    ((162, 166, 170), 0.19),
    ((34, 36, 40), 0.18),
    ((98, 102, 108), 0.13),
    ((40, 62, 112), 0.08),
    ((150, 28, 32), 0.08),
    ((112, 20, 30), 0.03),
    ((70, 112, 156), 0.03),
    ((40, 84, 66), 0.02),
    ((196, 184, 160), 0.02),
    ((222, 176, 40), 0.01),
    ((206, 96, 36), 0.01),
)
_LOUD: tuple[Colour, ...] = (
    (208, 40, 44),
    (28, 98, 170),
    (240, 190, 36),
    (38, 140, 90),
    (230, 230, 226),
    (96, 52, 130),
    (238, 120, 30),
    (30, 150, 166),
)
_CAR_SHARES = (
    ("hatchback", 0.27),
    ("sedan", 0.24),
    ("estate", 0.12),
    ("suv", 0.17),
    ("small", 0.09),
    ("coupe", 0.03),
    ("pickup", 0.03),
    ("mpv", 0.05),
)
_KIND_SHARES = (("car", 0.72), ("van", 0.09), ("minibus", 0.02), ("truck", 0.08), ("bus", 0.05), ("motorcycle", 0.04))
_CACHED_BODIES = 300


@dataclass(frozen=True, slots=True)
class Member:
    """A vehicle or person to be put on the road.

    Attributes:
        label: index into ``CLASSES``.
        kind: in words; "van" and "minibus" are cars among the classes.
        body: as it stands; a person's limbs are drawn anew for each frame.
        person: who, for people on foot.
        length: m, on the ground.
        width: m.
    """

    label: int
    kind: str
    body: Body
    person: Person | None
    length: float
    width: float


class Fleet:
    """Draws vehicles and people.

    Args:
        rng: of this scene's fleet.
        look_alikes: share of the cars that are one model in one colour, 0 to 1.
    """

    def __init__(self, rng: np.random.Generator, look_alikes: float) -> None:
        self._rng = rng
        self._look_alikes = look_alikes
        self._usual = (_draw_by_share(rng, _CAR_SHARES), Livery(self._paint()))
        self._bus = (_draw_by_share(rng, (("bus", 0.7), ("midibus", 0.3))), self._loud("bus"))
        self._bodies: dict[tuple[str, Livery], Body] = {}

    def draw(self, users: str) -> Member:
        """Somebody for a path of ``users``."""
        if users == "foot":
            person = dress_up(self._rng)
            nobody = BodyBuilder().build((0.45, 0.5, person.height))
            return Member(CLASSES.index("person"), "pedestrian", nobody, person, 0.45, 0.5)
        if users == "bicycle":
            return self._two_wheeler(is_motorcycle=False)
        kind = _draw_by_share(self._rng, _KIND_SHARES)
        if kind == "motorcycle":
            return self._two_wheeler(is_motorcycle=True)
        if kind in ("truck", "bus"):
            return self._heavy(kind)
        if kind == "car":
            is_usual = self._rng.random() < self._look_alikes
            name, livery = self._usual if is_usual else (_draw_by_share(self._rng, _CAR_SHARES), self._car_livery())
        else:
            name, livery = kind, self._loud(kind)
        shape = CAR_SHAPES[name]
        body = self._bodies.get((name, livery)) or self._keep(name, livery, build_car(shape, livery))
        return Member(CLASSES.index("car"), shape.kind, body, None, shape.length, shape.width)

    def _keep(self, name: str, livery: Livery, body: Body) -> Body:
        if len(self._bodies) >= _CACHED_BODIES:
            self._bodies.clear()
        self._bodies[name, livery] = body
        return body

    def _heavy(self, kind: str) -> Member:
        if kind == "bus":
            city = self._rng.random() < 0.7
            name, livery = self._bus if city else ("coach", self._loud("coach"))
        else:
            names = ("box truck", "box truck", "lorry", "tipper", "tanker", "flatbed")
            name, livery = names[int(self._rng.integers(len(names)))], self._loud("truck")
        shape = HEAVY_SHAPES[name]
        build = build_bus if kind == "bus" else build_truck
        body = self._bodies.get((name, livery)) or self._keep(name, livery, build(shape, livery))
        return Member(CLASSES.index(kind), shape.kind, body, None, shape.length, shape.width)

    def _two_wheeler(self, *, is_motorcycle: bool) -> Member:
        person = dress_up(self._rng)
        paint = _LOUD[int(self._rng.integers(len(_LOUD)))] if self._rng.random() < 0.6 else self._paint()
        body = two_wheeler_body(person, paint, is_motorcycle=is_motorcycle)
        kind = "motorcycle" if is_motorcycle else "bicycle"
        return Member(CLASSES.index(kind), kind, body, None, body.size[0], body.size[1])

    def _paint(self) -> Colour:
        return _draw_by_share(self._rng, _PAINTS)

    def _car_livery(self) -> Livery:
        chance = self._rng.random()
        if chance < 0.04:
            return Livery((232, 196, 60) if self._rng.random() < 0.5 else (235, 232, 214), pattern="taxi")
        if chance < 0.10:
            return Livery(self._paint(), (28, 28, 30), "roof")
        if chance < 0.14:
            return Livery((230, 230, 228), _LOUD[int(self._rng.integers(len(_LOUD)))], "stripe")
        return Livery(self._paint())

    def _loud(self, kind: str) -> Livery:
        patterns = {"van": ("plain", "plain", "advert", "stripe"), "minibus": ("plain", "stripe")}
        pattern = str(self._rng.choice(patterns.get(kind, ("plain", "stripe", "band", "advert"))))
        first, second = self._rng.choice(len(_LOUD), 2, replace=False).tolist()
        white: Colour = (228, 230, 230)
        paint = white if kind == "van" and self._rng.random() < 0.6 else _LOUD[first]
        return Livery(paint, _LOUD[second] if kind != "truck" or self._rng.random() < 0.5 else white, pattern)


def _draw_by_share(rng: np.random.Generator, shares: Sequence[tuple[T, float]]) -> T:
    """One of some things, the likelier the larger its share; the shares need not sum up to 1."""
    weights = np.array([share for _, share in shares])
    return shares[int(rng.choice(len(shares), p=weights / weights.sum()))][0]
