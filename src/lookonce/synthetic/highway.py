"""A straight road of many lanes, seen from a bridge or a pole beside it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.paths import Path, bend, line, make_path
from lookonce.synthetic.site import Area, Site, Stroke, Thing, View

__all__ = ["make_highway"]

Floats = NDArray[np.float64]

LANE_M = 3.6
_SHOULDER_M, _MEDIAN_M = 2.6, 3.0
_START_M, _END_M = -70.0, 250.0
_FAR_M = 165.0  # beyond this is an ignored region


def make_highway(rng: np.random.Generator) -> Site:
    """A place drawn by ``rng``: two to four lanes each way along y."""
    lanes = int(rng.integers(2, 5))
    half = _MEDIAN_M / 2 + 0.8 + lanes * LANE_M + _SHOULDER_M
    side = float(rng.choice([-1, 1]))
    x = side * float(rng.uniform(0.0, half + 4.0))
    height = float(rng.uniform(6.5, 12.0))
    yaw = math.pi / 2 + side * float(rng.uniform(0.02, 0.10)) + math.atan2(x, 90.0) * 0.9
    view = View(
        (x, -8.0, height), yaw, math.radians(float(rng.uniform(11, 19))), math.radians(float(rng.uniform(40, 58)))
    )
    far = np.array([(-half, _FAR_M), (half, _FAR_M), (half, _END_M), (-half, _END_M)])
    return Site(
        areas=tuple(_draw_areas(lanes, half)),
        strokes=tuple(_draw_strokes(lanes)),
        things=tuple(_draw_things(rng, half, x)),
        paths=tuple(_draw_paths(rng, lanes)),
        phases=(),
        view=view,
        ignored=(np.concatenate([np.c_[far, np.zeros(4)], np.c_[far, np.full(4, 3.6)]]),),
        bounds=(-95.0, _START_M, 95.0, _END_M + 60),
        wear=tuple(
            line((sign * _middle(lane), _START_M), (sign * _middle(lane), _END_M + 60))
            for lane in range(lanes)
            for sign in (-1, 1)
        ),
    )


def _middle(lane: int) -> float:
    """Of a lane, m from the road's middle; lane 0 is the innermost."""
    return _MEDIAN_M / 2 + 0.8 + (lane + 0.5) * LANE_M


def _strip(x0: float, x1: float) -> Floats:
    return np.array([(x0, _START_M), (x1, _START_M), (x1, _END_M + 60), (x0, _END_M + 60)])


def _draw_areas(lanes: int, half: float) -> list[Area]:
    areas = [Area("gravel", _strip(-half - 1.6, half + 1.6)), Area("asphalt", _strip(-half, half))]
    areas.append(Area("grass", _strip(-_MEDIAN_M / 2, _MEDIAN_M / 2)))
    return areas


def _draw_strokes(lanes: int) -> list[Stroke]:
    strokes = []
    for sign in (-1, 1):
        edges = [_middle(0) - LANE_M / 2, _middle(lanes - 1) + LANE_M / 2]
        for edge in edges:
            strokes.append(Stroke(line((sign * edge, _START_M), (sign * edge, _END_M + 60)), 0.2))
        for lane in range(1, lanes):
            x = sign * (_middle(lane) - LANE_M / 2)
            strokes.append(Stroke(line((x, _START_M), (x, _END_M + 60)), 0.15, 4.0, 8.0))
    return strokes


def _draw_paths(rng: np.random.Generator, lanes: int) -> list[Path]:
    """Straight lanes, and ways that change between neighbouring ones."""
    paths = []
    for sign in (1, -1):  # traffic keeps right: up at x > 0
        start, end = (_START_M, _END_M) if sign > 0 else (_END_M, _START_M)
        way = (0.0, float(sign))
        for lane in range(lanes):
            x = sign * _middle(lane)
            weight = (0.8 if lane == 0 else 1.0) * float(rng.uniform(0.7, 1.3))
            paths.append(make_path([line((x, start), (x, end))], "car", weight=weight))
            for other in (lane - 1, lane + 1):
                if 0 <= other < lanes:
                    begin = float(rng.uniform(15, 75))
                    low, high = (begin, begin + 48) if sign > 0 else (begin + 48, begin)
                    to = sign * _middle(other)
                    parts = [
                        line((x, start), (x, low)),
                        bend((x, low), way, (to, high), way),
                        line((to, high), (to, end)),
                    ]
                    paths.append(make_path(parts, "car", weight=0.18))
    return paths


def _draw_things(rng: np.random.Generator, half: float, eye_x: float) -> list[Thing]:
    things = [Thing("barrier", 0.0, y, math.pi / 2, (12.0, 0.5, 0.85)) for y in np.arange(_START_M, _END_M, 12.0)]
    for y in np.arange(14, _END_M, 34.0).tolist():
        things.append(Thing("lamp", 0.55, y + 6, 0.0, (0, 0, 10.5)))
        things.append(Thing("lamp", -0.55, y + 6, math.pi, (0, 0, 10.5)))
        if rng.random() < 0.5:
            things.append(Thing("sign", float(rng.choice([-1, 1])) * (half + 2.2), y, math.pi / 2))
    has_wall = bool(rng.random() < 0.4)
    for sign in (-1, 1):
        for y in np.arange(0, _END_M + 40, 7.0).tolist():
            x = sign * (half + float(rng.uniform(5, 11)))
            if rng.random() < 0.75 and abs(x - eye_x) + abs(y + 8) > 22:
                things.append(Thing("tree" if rng.random() < 0.7 else "bush", x, y))
            if rng.random() < 0.45:
                things.append(Thing("tree", sign * (half + float(rng.uniform(14, 38))), y))
        if has_wall:
            things += [
                Thing("barrier", sign * (half + 3.2), y, math.pi / 2, (10.0, 0.3, 3.2)) for y in range(10, 250, 10)
            ]
        for y in np.arange(30, _END_M + 30, 38.0).tolist():
            if rng.random() < 0.6:
                size = (float(rng.uniform(14, 34)), float(rng.uniform(12, 18)), 3.1 * int(rng.integers(2, 8)) + 0.8)
                things.append(
                    Thing("house", sign * (half + 50 + float(rng.uniform(0, 12))), y, -sign * math.pi / 2, size)
                )
    return things
