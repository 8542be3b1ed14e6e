"""Lines that traffic follows, and where two of them come too close."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["STEP_M", "Path", "PathTable", "bend", "line", "make_path"]

Floats = NDArray[np.float64]
Point = tuple[float, float]

STEP_M = 1.0
_LATERAL_ACCELERATION = 2.2  # m/s^2 in bends
_COMFORTABLE_BRAKING = 1.8  # m/s^2 ahead of bends


@dataclass(frozen=True, slots=True)
class Path:
    """A line with a point each ``STEP_M``.

    Attributes:
        points: (K, 2) m.
        users: "car", "bicycle" or "foot".
        limit: (K,) m/s, what bends allow.
        stop_m: distance along the line of the stop line; infinite = none.
        signal: which signal group holds its users there; -1 = none.
        weight: how many enter here, relative to others.
        turn: 1 = left, -1 = right, 0 = straight on.
    """

    points: Floats
    users: str
    limit: Floats
    stop_m: float
    signal: int
    weight: float
    turn: int

    @property
    def length(self) -> float:
        """In m."""
        return (len(self.points) - 1) * STEP_M


def line(start: Point, end: Point) -> Floats:
    """A straight line ``(2, 2)``."""
    return np.array([start, end], np.float64)


def bend(start: Point, start_way: Point, end: Point, end_way: Point) -> Floats:
    """A smooth curve between two points with given ways (unit vectors), ``(17, 2)``."""
    p0, p3 = np.array(start), np.array(end)
    reach = float(np.hypot(*(p3 - p0))) * 0.42
    p1, p2 = p0 + reach * np.array(start_way), p3 - reach * np.array(end_way)
    t = np.linspace(0, 1, 17)[:, None]
    curve: Floats = (1 - t) ** 3 * p0 + 3 * (1 - t) ** 2 * t * p1 + 3 * (1 - t) * t**2 * p2 + t**3 * p3
    return curve


def make_path(
    parts: Sequence[Floats],
    users: str,
    *,
    stop_m: float = math.inf,
    signal: int = -1,
    weight: float = 1.0,
    turn: int = 0,
) -> Path:
    """A path along lines that join."""
    corners = np.concatenate(list(parts))
    steps = np.hypot(*np.diff(corners, axis=0).T)
    keep = np.concatenate([[True], steps > 1e-9])
    corners = corners[keep]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    places = np.arange(0.0, along[-1], STEP_M)
    points = np.stack([np.interp(places, along, corners[:, axis]) for axis in (0, 1)], axis=1)
    return Path(points, users, _speed_limit(points), stop_m, signal, weight, turn)


def _speed_limit(points: Floats) -> Floats:
    """What the bends allow, with room to brake ahead of them, (K,) m/s."""
    ways = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
    turning = np.abs(np.convolve(np.diff(ways), np.ones(3) / 3, mode="same")) / STEP_M
    curvature = np.concatenate([[0.0], turning, [0.0]])
    limit: Floats = np.sqrt(_LATERAL_ACCELERATION / np.maximum(curvature, 1e-5))
    for k in range(len(limit) - 2, -1, -1):
        limit[k] = min(limit[k], math.sqrt(limit[k + 1] ** 2 + 2 * _COMFORTABLE_BRAKING * STEP_M))
    return limit


class PathTable:
    """All paths as arrays, and for each point of each path its nearest place on every other path.

    Attributes:
        paths: in the order of their numbers.
        nearest_m: (P, P, K) float32, ``[a, b, k]`` = where along a lies the point of a next to point k of b.
        apart_m: (P, P, K) float32, how far the two are apart; infinite beyond the end of b and for paths on foot.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = tuple(paths)
        longest = max(len(path.points) for path in paths)
        count = len(paths)
        self.nearest_m = np.zeros((count, count, longest), np.float32)
        self.apart_m = np.full((count, count, longest), np.inf, np.float32)
        self._points = np.zeros((count, longest, 2))
        self._limits = np.full((count, longest), 99.0)
        for number, path in enumerate(paths):
            self._points[number, : len(path.points)] = path.points
            self._points[number, len(path.points) :] = path.points[-1]
            self._limits[number, : len(path.limit)] = path.limit
        for a, first in enumerate(paths):
            for b, second in enumerate(paths):
                if a == b or (first.users != "foot" and second.users != "foot"):
                    self._fill(a, b)

    def _fill(self, a: int, b: int) -> None:
        first, second = self.paths[a].points, self.paths[b].points
        if a == b:
            self.nearest_m[a, b, : len(first)] = np.arange(len(first)) * STEP_M
            self.apart_m[a, b, : len(first)] = 0
            return
        x = second[:, None, 0] - first[None, :, 0]
        y = second[:, None, 1] - first[None, :, 1]
        squares = x * x + y * y
        best = squares.argmin(axis=1)
        self.nearest_m[a, b, : len(second)] = best * STEP_M
        self.apart_m[a, b, : len(second)] = np.sqrt(squares[np.arange(len(second)), best])

    def place(self, paths: NDArray[np.int64], along_m: Floats) -> Floats:
        """Points ``(N, 2)`` on paths ``(N,)`` at distances ``(N,)``; straight on beyond the ends."""
        last = np.array([len(path.points) - 1 for path in self.paths])[paths]
        index = np.clip(np.floor(along_m / STEP_M).astype(np.int64), 0, last - 1)
        share = (along_m / STEP_M - index)[:, None]
        here, there = self._points[paths, index], self._points[paths, index + 1]
        placed: Floats = here + share * (there - here)
        return placed

    def limits(self, paths: NDArray[np.int64], along_m: Floats) -> Floats:
        """What bends allow at places, (N,) m/s."""
        index = np.clip(np.round(along_m / STEP_M).astype(np.int64), 0, self._limits.shape[1] - 1)
        allowed: Floats = self._limits[paths, index]
        return allowed
