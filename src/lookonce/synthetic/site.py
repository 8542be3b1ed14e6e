"""A place where traffic flows: what lies on the ground, what stands on it, where one may go, whence it is seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.camera import Camera
from lookonce.synthetic.paths import Path

__all__ = ["Area", "Phase", "Site", "Stroke", "Thing", "View"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Area:
    """A piece of ground.

    Attributes:
        material: a name that ``ground.py`` knows.
        outline: (K, 2) m.
    """

    material: str
    outline: Floats


@dataclass(frozen=True, slots=True)
class Stroke:
    """A painted line.

    Attributes:
        points: (K, 2) m.
        width_m: of the paint.
        dash_m: length of a dash; 0 = unbroken.
        gap_m: between dashes.
        is_yellow: else white.
    """

    points: Floats
    width_m: float = 0.14
    dash_m: float = 0.0
    gap_m: float = 0.0
    is_yellow: bool = False


@dataclass(frozen=True, slots=True)
class Thing:
    """Something that stands.

    Attributes:
        kind: "tree", "lamp", "sign", "signal", "house", "barrier", "bush" or "parked".
        x: m.
        y: m.
        yaw: rad.
        size: length, width and height in m; zeros = as usual for its kind.
        group: signal group of a signal.
    """

    kind: str
    x: float
    y: float
    yaw: float = 0.0
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    group: int = -1


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of the signals' round.

    Attributes:
        seconds: how long.
        groups: which have green; for the last three seconds it is amber.
    """

    seconds: float
    groups: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class View:
    """Where the camera is, whatever the picture's size.

    Attributes:
        position: x, y, z in m.
        yaw_rad: where it looks.
        pitch_rad: how far down.
        field_rad: angle that the picture's width shows.
    """

    position: tuple[float, float, float]
    yaw_rad: float
    pitch_rad: float
    field_rad: float

    def camera(self, size: tuple[int, int]) -> Camera:
        """The camera for a picture of ``size`` (height, width) px."""
        focal = size[1] / 2 / float(np.tan(self.field_rad / 2))
        return Camera(self.position, self.yaw_rad, self.pitch_rad, focal, size)


@dataclass(frozen=True, slots=True)
class Site:
    """A place.

    Attributes:
        areas: painted one over the other.
        strokes: painted over them.
        things: what stands.
        paths: where one may go.
        phases: of the signals; none = there are none.
        view: of the camera.
        ignored: (K, 3) m each: corners of what lies in an ignored region.
        bounds: xyxy in m that the map of the ground covers.
        wear: (K, 2) m each: lines where wheels roll.
    """

    areas: tuple[Area, ...]
    strokes: tuple[Stroke, ...]
    things: tuple[Thing, ...]
    paths: tuple[Path, ...]
    phases: tuple[Phase, ...]
    view: View
    ignored: tuple[Floats, ...]
    bounds: tuple[float, float, float, float]
    wear: tuple[Floats, ...]
