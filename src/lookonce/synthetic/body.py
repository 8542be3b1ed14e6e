"""Bodies: things made of flat faces and of capsules, and a builder for them.

A body's own coordinates: x ahead, y left, z up, metres, (0, 0, 0) on the ground below its middle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

__all__ = ["Body", "BodyBuilder", "Capsules", "Surface", "patch"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Colour = tuple[float, float, float]
Point = tuple[float, float, float]


class Surface(IntEnum):
    """How a face takes the light."""

    PAINT = 0
    MATT = 1
    GLASS = 2
    HEADLIGHT = 3
    TAILLIGHT = 4
    BLINKER_LEFT = 5
    BLINKER_RIGHT = 6
    LIT_AT_NIGHT = 7
    GLOWING = 8


@dataclass(frozen=True, slots=True)
class Capsules:
    """Round limbs: C cylinders with round ends.

    Attributes:
        starts: (C, 3) m.
        ends: (C, 3) m.
        radii: (C, 2) m at start and end.
        colours: (C, 3), 0 to 255.
    """

    starts: Floats
    ends: Floats
    radii: Floats
    colours: Floats

    @classmethod
    def of(cls, rows: Sequence[tuple[Point, Point, float, float, Colour]]) -> Capsules:
        """From rows of start, end, radius at start, radius at end, colour."""
        return cls(
            np.array([row[0] for row in rows], np.float64).reshape(-1, 3),
            np.array([row[1] for row in rows], np.float64).reshape(-1, 3),
            np.array([row[2:4] for row in rows], np.float64).reshape(-1, 2),
            np.array([row[4] for row in rows], np.float64).reshape(-1, 3),
        )


NO_CAPSULES = Capsules(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 3)))


@dataclass(frozen=True, slots=True)
class Body:
    """F faces with L corners in all, in P convex parts.

    Attributes:
        corners: (L, 3) m, face after face.
        bounds: (F + 1,) int64; face f has the corners ``bounds[f]`` to ``bounds[f + 1]``.
        normals: (F, 3), outward, unit length.
        middles: (F, 3) m.
        colours: (F, 3), 0 to 255.
        surfaces: (F,) int64, ``Surface``.
        details: (F,) drawn only where the body is at least so many px long.
        parts: (F,) int64.
        layers: (P,) higher parts are painted later.
        part_middles: (P, 3) m; of one layer the part that is farther by these is painted first.
        capsules: painted after the faces, the far ones first.
        size: length, width and height in m.
    """

    corners: Floats
    bounds: Ints
    normals: Floats
    middles: Floats
    colours: Floats
    surfaces: Ints
    details: Floats
    parts: Ints
    layers: Ints
    part_middles: Floats
    capsules: Capsules
    size: tuple[float, float, float]

    def with_capsules(self, capsules: Capsules) -> Body:
        """The same with other capsules."""
        return replace(self, capsules=capsules)


class BodyBuilder:
    """Collects faces; their winding does not matter, since parts are convex."""

    def __init__(self) -> None:
        self._corners: list[Floats] = []
        self._normals: list[Floats] = []
        self._colours: list[Colour] = []
        self._surfaces: list[int] = []
        self._details: list[float] = []
        self._parts: list[int] = []
        self._layers: list[int] = []
        self._middles: list[Point] = []
        self._places: list[Point] = []

    def part(self, middle: Point, layer: int, place: Point | None = None) -> None:
        """Faces that follow belong to a new convex part around ``middle``, sorted as if it were at ``place``."""
        self._middles.append(middle)
        self._places.append(place or middle)
        self._layers.append(layer)

    def face(
        self,
        corners: Floats | Sequence[Point],
        colour: Colour,
        surface: Surface = Surface.PAINT,
        detail_px: float = 0.0,
    ) -> Floats:
        """A flat face; gives its corners, for ``patch``."""
        points = np.array(corners, np.float64)
        normal = _normal(points)
        if float(normal @ (points.sum(axis=0) / len(points) - np.array(self._middles[-1]))) < 0:
            normal = -normal
        self._corners.append(points)
        self._normals.append(normal)
        self._colours.append(colour)
        self._surfaces.append(int(surface))
        self._details.append(detail_px)
        self._parts.append(len(self._middles) - 1)
        return points

    def box(
        self,
        low: Point,
        high: Point,
        colour: Colour,
        layer: int,
        surface: Surface = Surface.PAINT,
        place: Point | None = None,
    ) -> list[Floats]:
        """A box as a part of its own; its faces: front, back, left, right, top.

        Corners of a face: seen from outside, left bottom, right bottom, right top, left top; of the top: back right,
        front right, front left, back left.
        """
        (x0, y0, z0), (x1, y1, z1) = low, high
        self.part(((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2), layer, place)
        faces = [
            [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
            [(x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)],
            [(x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)],
            [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
            [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
        ]
        return [self.face(face, colour, surface) for face in faces]

    def disc(self, middle: Point, radius: float, colour: Colour, detail_px: float = 0.0, sides: int = 12) -> None:
        """A disc that stands along x and faces to the side."""
        x, y, z = middle
        angles = [2 * math.pi * (k + 0.5) / sides for k in range(sides)]
        ring = [(x + radius * math.cos(angle), y, z + radius * math.sin(angle)) for angle in angles]
        self.face(ring, colour, Surface.MATT, detail_px)

    def build(self, size: tuple[float, float, float], capsules: Capsules = NO_CAPSULES) -> Body:
        """The body."""
        counts = [len(points) for points in self._corners]
        return Body(
            corners=np.concatenate([np.zeros((0, 3)), *self._corners]),
            bounds=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            normals=np.array(self._normals, np.float64).reshape(-1, 3),
            middles=np.array([points.mean(axis=0) for points in self._corners], np.float64).reshape(-1, 3),
            colours=np.array(self._colours, np.float64).reshape(-1, 3),
            surfaces=np.array(self._surfaces, np.int64),
            details=np.array(self._details, np.float64),
            parts=np.array(self._parts, np.int64),
            layers=np.array(self._layers, np.int64),
            part_middles=np.array(self._places, np.float64).reshape(-1, 3),
            capsules=capsules,
            size=size,
        )


def _normal(points: Floats) -> Floats:
    """The unit normal of a polygon ``(N, 3)``, after Newell."""
    x, y, z = points.T
    u, v, w = np.concatenate([points[1:], points[:1]]).T
    normal = np.array([(y * w - z * v).sum(), (z * u - x * w).sum(), (x * v - y * u).sum()])
    unit: Floats = normal / max(float(np.sqrt((normal**2).sum())), 1e-12)
    return unit


def patch(quad: Floats, left: float, right: float, bottom: float, top: float) -> Floats:
    """A piece of a quad ``(4, 3)`` (left bottom, right bottom, right top, left top), by shares of its sides, 0 to 1."""
    shares = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    u, v = shares[:, :1], shares[:, 1:]
    piece: Floats = (1 - v) * ((1 - u) * quad[0] + u * quad[1]) + v * ((1 - u) * quad[3] + u * quad[2])
    return piece
