"""A junction of three or four arms with signals, zebra crossings, cycle lanes, houses at its corners."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.paths import Path, bend, line, make_path
from lookonce.synthetic.site import Area, Phase, Site, Stroke, Thing, View

__all__ = ["make_junction"]

Floats = NDArray[np.float64]
Point = tuple[float, float]

LANE_M = 3.3
CYCLE_M = 1.7
PAVEMENT_M = 3.6
REACH_M = 125.0  # how long the arms are
_ZEBRA_M = 3.6
_GREEN_S, _WALK_S, _CLEARING_S = 13.0, 5.5, 13.5  # slow walkers need 16 s to cross


@dataclass(frozen=True, slots=True)
class _Arm:
    """One road out of the junction; u = m outwards from the middle, v = m to the left of that."""

    angle: float
    lanes: int
    core: float  # where the crossing's rounded corners begin, m
    group: int

    @property
    def half(self) -> float:
        """From the middle of the road to the kerb."""
        return self.lanes * LANE_M + CYCLE_M

    def at(self, u: float, v: float) -> Point:
        """A point of the world."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return u * cos - v * sin, u * sin + v * cos

    @property
    def out(self) -> Point:
        """The way out, a unit vector."""
        return math.cos(self.angle), math.sin(self.angle)

    @property
    def way_in(self) -> Point:
        """The way in, a unit vector."""
        return -math.cos(self.angle), -math.sin(self.angle)

    def quad(self, u0: float, u1: float, v0: float, v1: float) -> Floats:
        """A rectangle ``(4, 2)``."""
        return np.array([self.at(u0, v0), self.at(u1, v0), self.at(u1, v1), self.at(u0, v1)])


def make_junction(rng: np.random.Generator, *, arms: int) -> Site:
    """A place drawn by ``rng`` with three or four arms."""
    roads = _draw_arms(rng, arms)
    corner = int(rng.integers(4)) if arms == 4 else int(rng.choice(3, p=[0.25, 0.25, 0.5]))  # the camera's
    view = _draw_view(rng, roads, corner)
    strokes, wear = _draw_strokes(roads)
    paths = tuple(_draw_paths(rng, roads))
    turns = [path.points[int(REACH_M - 30) : -int(REACH_M - 30)] for path in paths if path.users == "car"]
    return Site(
        areas=tuple(_draw_areas(roads)),
        strokes=tuple(strokes),
        things=tuple(_draw_things(rng, roads, view)),
        paths=paths,
        phases=_draw_phases(len(roads)),
        view=view,
        ignored=tuple(_far_ends(roads, view)),
        bounds=(-REACH_M - 15, -REACH_M - 15, REACH_M + 15, REACH_M + 15),
        wear=(*wear, *(points for points in turns if len(points) > 1)),
    )


def _draw_arms(rng: np.random.Generator, count: int) -> list[_Arm]:
    main, side = 2, int(rng.choice([1, 2]))
    core = max(main, side) * LANE_M + CYCLE_M + float(rng.uniform(5.0, 7.0))
    numbers = range(4) if count == 4 else (0, 1, 2)
    return [_Arm(number * math.pi / 2, main if number % 2 == 0 else side, core, k) for k, number in enumerate(numbers)]


def _draw_view(rng: np.random.Generator, roads: list[_Arm], corner: int) -> View:
    first, second = roads[corner], roads[(corner + 1) % len(roads)]
    lean = float(rng.uniform(0.35, 0.65))
    between = first.angle + lean * ((second.angle - first.angle) % (2 * math.pi))
    away = first.core * 1.15 + float(rng.uniform(9, 19))
    height = float(rng.uniform(7.0, 13.0))
    position = (away * math.cos(between), away * math.sin(between), height)
    aim_x, aim_y = rng.uniform(-5, 5, 2).tolist()
    yaw = math.atan2(aim_y - position[1], aim_x - position[0])
    pitch = math.atan2(height, math.hypot(aim_x - position[0], aim_y - position[1])) * float(rng.uniform(0.66, 0.86))
    return View(position, yaw, pitch, math.radians(float(rng.uniform(58, 76))))


def _ring(roads: list[_Arm], core: float, extra: float) -> Floats:
    """The outline of the crossing with rounded corners, its sides ``extra`` m farther out than the kerbs."""
    parts = []
    for road, following in zip(roads, [*roads[1:], roads[0]], strict=True):
        start, end = road.at(core, road.half + extra), following.at(core, -following.half - extra)
        parts.append(bend(start, road.way_in, end, following.out))
    return np.concatenate(parts)


def _draw_areas(roads: list[_Arm]) -> list[Area]:
    core = roads[0].core
    far = REACH_M + 15
    areas = [
        Area("paving", road.quad(core - 1, far, -road.half - PAVEMENT_M, road.half + PAVEMENT_M)) for road in roads
    ]
    areas.append(Area("paving", _ring(roads, core, PAVEMENT_M)))
    areas += [Area("kerb", road.quad(core - 1, far, -road.half - 0.25, road.half + 0.25)) for road in roads]
    areas.append(Area("kerb", _ring(roads, core, 0.25)))
    areas += [Area("asphalt", road.quad(core - 1, far, -road.half, road.half)) for road in roads]
    areas.append(Area("asphalt", _ring(roads, core, 0.0)))
    for road in roads:
        for inner in (road.half - CYCLE_M, -road.half):
            areas.append(Area("cycleway", road.quad(core + _ZEBRA_M + 1, far, inner, inner + CYCLE_M)))
        bars = np.arange(-road.half + 0.35, road.half - 0.3, 1.0)
        areas += [Area("paint", road.quad(core + 0.4, core + 0.4 + _ZEBRA_M, v, v + 0.5)) for v in bars.tolist()]
        stop = core + _ZEBRA_M + 1.4
        areas.append(Area("paint", road.quad(stop, stop + 0.45, 0.15, road.half - CYCLE_M)))
    return areas


def _draw_strokes(roads: list[_Arm]) -> tuple[list[Stroke], list[Floats]]:
    strokes, wear = [], []
    for road in roads:
        near, far = road.core + _ZEBRA_M + 1.4, REACH_M + 15
        for v in (-0.12, 0.12):
            strokes.append(Stroke(line(road.at(near, v), road.at(far, v)), is_yellow=True))
        for lane in range(1, road.lanes):
            for v in (lane * LANE_M, -lane * LANE_M):
                strokes.append(Stroke(line(road.at(near, v), road.at(near + 18, v))))
                strokes.append(Stroke(line(road.at(near + 18, v), road.at(far, v)), 0.12, 3.0, 5.0))
        for v in (road.half - CYCLE_M, -road.half + CYCLE_M):
            strokes.append(Stroke(line(road.at(near, v), road.at(far, v)), 0.12))
        for lane in range(road.lanes):
            for v in ((lane + 0.5) * LANE_M, -(lane + 0.5) * LANE_M):
                wear.append(line(road.at(near, v), road.at(far, v)))
            strokes += _arrow(road, near + 7, (lane + 0.5) * LANE_M)
    return strokes, wear


def _arrow(road: _Arm, u: float, v: float) -> list[Stroke]:
    """An arrow on a lane, pointing inwards."""
    tip = road.at(u, v)
    return [
        Stroke(line(road.at(u + 3.4, v), tip), 0.22),
        Stroke(np.array([road.at(u + 1.0, v - 0.45), tip, road.at(u + 1.0, v + 0.45)]), 0.2),
    ]


def _draw_paths(rng: np.random.Generator, roads: list[_Arm]) -> list[Path]:
    paths = []
    stop_u = roads[0].core + _ZEBRA_M + 2.0
    for start, end in itertools.permutations(roads, 2):
        turn = _turn(start, end)
        for lane, out_lane in _lanes(start, end, turn):
            v, w = (lane + 0.5) * LANE_M, -(out_lane + 0.5) * LANE_M
            inner, outer = start.at(start.core, v), end.at(end.core, w)
            parts = [
                line(start.at(REACH_M, v), inner),
                bend(inner, start.way_in, outer, end.out),
                line(outer, end.at(REACH_M, w)),
            ]
            weight = (1.0 if turn == 0 else 0.5) * float(rng.uniform(0.7, 1.3)) * (4 / len(roads)) ** 2
            paths.append(make_path(parts, "car", stop_m=REACH_M - stop_u, signal=start.group, weight=weight, turn=turn))
        if turn == 0:
            v, w = start.half - CYCLE_M / 2, -end.half + CYCLE_M / 2
            parts = [line(start.at(REACH_M, v), end.at(REACH_M, w))]
            paths.append(make_path(parts, "bicycle", stop_m=REACH_M - stop_u, signal=start.group, weight=1.0))
    return paths + _foot_paths(roads)


def _turn(start: _Arm, end: _Arm) -> int:
    """1 = left, -1 = right, 0 = straight on."""
    change = round((end.angle - start.angle) % (2 * math.pi) / (math.pi / 2))
    return {1: -1, 2: 0, 3: 1}[change]


def _lanes(start: _Arm, end: _Arm, turn: int) -> list[tuple[int, int]]:
    """Pairs of lanes in and lanes out, counted from the road's middle."""
    if turn == 1:
        return [(0, 0)]
    if turn == -1:
        return [(start.lanes - 1, end.lanes - 1)]
    return [(lane, min(lane, end.lanes - 1)) for lane in range(start.lanes)]


def _foot_paths(roads: list[_Arm]) -> list[Path]:
    """Round the corners, and over the zebra crossings, both ways and in two files."""
    paths = []
    group = len(roads)
    far = 75.0
    for number, file in itertools.product(range(len(roads)), (0.9, 1.6, 2.3, 3.0)):
        road, following = roads[number], roads[(number + 1) % len(roads)]
        is_back = file > 2
        v, w = road.half + file, -following.half - file
        near, near_other = road.at(road.core, v), following.at(following.core, w)
        around = [
            line(road.at(far, v), near),
            bend(near, road.way_in, near_other, following.out),
            line(near_other, following.at(far, w)),
        ]
        u = road.core + 0.9 + 0.6 * file * (2.4 / 3.0)
        across = [
            line(road.at(far, v), road.at(u, v)),
            line(road.at(u, v), road.at(u, -v)),
            line(road.at(u, -v), road.at(far, -v)),
        ]
        kerb = far - u + file - 0.4
        if is_back:
            around = [part[::-1] for part in around[::-1]]
            across = [part[::-1] for part in across[::-1]]
        paths.append(make_path(around, "foot", weight=1.0))
        paths.append(make_path(across, "foot", stop_m=kerb, signal=group, weight=0.8))
    return paths


def _draw_phases(arms: int) -> tuple[Phase, ...]:
    phases = []
    for group in range(arms):
        phases += [Phase(_GREEN_S, (group,)), Phase(2.5, ())]
    return (*phases, Phase(_WALK_S, (arms,)), Phase(_CLEARING_S, ()))


def _far_ends(roads: list[_Arm], view: View) -> list[Floats]:
    """The far ends of the roads, as high as a lorry."""
    ends = []
    for road in roads:
        x, y = road.at(95.0, 0.0)
        if math.hypot(x - view.position[0], y - view.position[1]) > 60:
            flat = road.quad(85.0, REACH_M, -road.half - PAVEMENT_M, road.half + PAVEMENT_M)
            ends.append(np.concatenate([np.c_[flat, np.zeros(4)], np.c_[flat, np.full(4, 3.6)]]))
    return ends


def _draw_things(rng: np.random.Generator, roads: list[_Arm], view: View) -> list[Thing]:
    things: list[Thing] = []
    eye = np.array(view.position[:2])
    for number, road in enumerate(roads):
        v = road.half + 0.7
        stop = road.core + _ZEBRA_M + 1.6
        things.append(Thing("signal", *road.at(stop, v), yaw=road.angle, group=road.group))
        corner = road.at(road.core + 0.5, -v - 1.6)
        if math.hypot(corner[0] - eye[0], corner[1] - eye[1]) > 24:
            things.append(Thing("lamp", *corner, yaw=road.angle + math.pi * 0.75))
        for u in (road.core + 16, road.core + 42, road.core + 68):
            things.append(Thing("lamp", *road.at(u, v + 0.1), yaw=road.angle - math.pi / 2))
            things.append(Thing("lamp", *road.at(u + 13, -v - 0.1), yaw=road.angle + math.pi / 2))
        things.append(Thing("sign", *road.at(road.core + 9.5, v), yaw=road.angle))
        for side in (-1, 1):
            for u in np.arange(road.core + 11, 110, 12.0).tolist():
                place = road.at(u + float(rng.uniform(-2, 2)), side * (road.half + PAVEMENT_M - 0.5))
                if rng.random() < 0.55 and math.hypot(place[0] - eye[0], place[1] - eye[1]) > 15:
                    things.append(Thing("tree", *place))
        things += _houses(rng, roads, number, eye)
    return things + _groves(rng, roads, eye)


def _groves(rng: np.random.Generator, roads: list[_Arm], eye: Floats) -> list[Thing]:
    """Trees and bushes anywhere off the roads."""
    things = []
    for _ in range(90):
        x, y = rng.uniform(-150, 150, 2).tolist()
        beside = [abs(x * road.out[1] - y * road.out[0]) - road.half - PAVEMENT_M for road in roads]
        is_near = math.hypot(x - eye[0], y - eye[1]) < 22
        is_before = abs(x * eye[1] - y * eye[0]) / float(np.hypot(*eye)) < 24 and x * eye[0] + y * eye[1] > 0
        if min(beside) > 3 and not is_near and not is_before:
            things.append(Thing("tree" if rng.random() < 0.7 else "bush", x, y))
    return things


def _houses(rng: np.random.Generator, roads: list[_Arm], number: int, eye: Floats) -> list[Thing]:
    """Rows of houses along both sides of an arm, but not where they would stand before the camera."""
    road = roads[number]
    following = roads[(number + 1) % len(roads)]
    before = roads[number - 1]
    houses = []
    for side, neighbour in ((1, following), (-1, before)):
        is_open = round((side * (neighbour.angle - road.angle)) % (2 * math.pi) / (math.pi / 2)) != 1
        u = road.core + road.half + PAVEMENT_M - 2 if not is_open else 1.0
        setback = road.half + PAVEMENT_M + float(rng.uniform(2.5, 9))
        while u < REACH_M:
            length, depth = float(rng.uniform(11, 24)), float(rng.uniform(9, 14))
            height = 3.1 * int(rng.integers(2, 6)) + 0.8
            x, y = road.at(u + length / 2, side * (setback + depth / 2))
            if not _stands_before(eye, x, y, max(length, depth), roads):
                yaw = road.angle + (0 if side > 0 else math.pi)
                houses.append(Thing("house", x, y, yaw, (length, depth, height)))
            u += length + float(rng.choice([0.0, 3.0, 12.0]))
    return houses


def _stands_before(eye: Floats, x: float, y: float, size: float, roads: list[_Arm]) -> bool:
    """Whether a house is near the camera, or between it and the crossing."""
    if math.hypot(x - eye[0], y - eye[1]) < 16 + size:
        return True
    core = roads[0].core
    along = (x - eye[0]) * -eye[0] + (y - eye[1]) * -eye[1]
    reach = float(np.hypot(*eye))
    across = abs((x - eye[0]) * eye[1] - (y - eye[1]) * eye[0]) / reach
    if 0 < along / reach < reach and across < core + size:
        return True
    inside = [abs(x * road.out[1] - y * road.out[0]) < road.half + PAVEMENT_M + size * 0.5 for road in roads]
    ahead = [x * road.out[0] + y * road.out[1] > 0 for road in roads]
    return any(is_inside and is_ahead for is_inside, is_ahead in zip(inside, ahead, strict=True))
