"""Shift, turn and zoom from the shifts of blocks of which many may be wrong.

An affine here is (2, 3) float64: ``[x', y'] = A[:, :2] @ [x, y] + A[:, 2]``. Sums are over multiples of 1/1024 and
exact; what follows them is plain arithmetic on single numbers. So the result is the same on every machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["apply", "compose", "fit_similarity", "identity", "invert", "largest_shift", "residuals"]

Floats = NDArray[np.float64]

_NEAR_SHARE = 0.25  # of the picture's longer side: what two blocks of a guess are apart at least
_ROUNDS = 4
_ENOUGH_TO_TURN = 16  # points; fewer tell a shift only
_CLEAR_SHARE = 0.8  # of the points that agree: no other answer can have more
_WIDE_SPREAD = 0.12  # standard deviation of the places over the longer side; below, turn and zoom cannot be told


def identity() -> Floats:
    """The affine that moves nothing."""
    return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def apply(affine: Floats, points: Floats) -> Floats:
    """Points (N, 2) moved."""
    (a, b, c), (d, e, f) = affine.tolist()
    x, y = points[:, 0], points[:, 1]
    moved = np.empty((len(points), 2))
    moved[:, 0] = a * x + b * y + c
    moved[:, 1] = d * x + e * y + f
    return moved


def compose(second: Floats, first: Floats) -> Floats:
    """The affine that does ``first``, then ``second``."""
    (a, b, c), (d, e, f) = first.tolist()
    rows = [(p * a + q * d, p * b + q * e, p * c + q * f + r) for p, q, r in second.tolist()]
    return np.array(rows)


def invert(affine: Floats) -> Floats:
    """The way back; the affine must not flatten the plane."""
    (a, b, c), (d, e, f) = affine.tolist()
    determinant = a * e - b * d
    return np.array(
        [
            [e / determinant, -b / determinant, (b * f - e * c) / determinant],
            [-d / determinant, a / determinant, (d * c - a * f) / determinant],
        ]
    )


def largest_shift(affine: Floats, size: tuple[int, int]) -> float:
    """How far the farthest corner of a picture of ``size`` (height, width) moves, px."""
    height, width = size
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
    moved = apply(affine, corners) - corners
    return float(np.sqrt((moved * moved).sum(axis=1)).max())


def residuals(affine: Floats, points: Floats, shifts: Floats) -> Floats:
    """How far (N,) each moved point is from where its own shift takes it."""
    apart = apply(affine, points) - points - shifts
    distances: Floats = np.sqrt(apart[:, 0] * apart[:, 0] + apart[:, 1] * apart[:, 1])
    return distances


def fit_similarity(points: Floats, shifts: Floats, size: tuple[int, int], tolerance: float) -> tuple[Floats, Floats]:
    """The shift, turn and zoom with which most points agree.

    Least squares do where nearly all agree. Otherwise guesses are made from each point alone (a shift) and from pairs
    that lie far apart; the one with most points within twice the tolerance wins, the first of equals, and least squares
    over those points end it.

    Args:
        points: (N, 2) px, multiples of 1/2; N >= 1.
        shifts: (N, 2) px, multiples of 1/1024.
        size: (height, width) of the picture in px.
        tolerance: how far a point may be off, px.

    Returns:
        The affine, and how far each point (N,) is off.
    """
    everything = np.ones(len(points), np.bool_)
    affine, off = _refine(points, shifts, max(size), tolerance, everything)
    if int((off <= tolerance).sum()) >= _CLEAR_SHARE * len(points):
        return affine, off
    guesses = _guesses(points, shifts, max(size))
    x, y = points[:, 0], points[:, 1]
    off_x = guesses[:, :1] * x - guesses[:, 1:2] * y + guesses[:, 2:3] - shifts[:, 0]
    off_y = guesses[:, 1:2] * x + guesses[:, :1] * y + guesses[:, 3:] - shifts[:, 1]
    agrees = off_x * off_x + off_y * off_y <= 4 * tolerance * tolerance  # (G, N)
    return _refine(points, shifts, max(size), tolerance, agrees[int(agrees.sum(axis=1).argmax())])


def _refine(
    points: Floats, shifts: Floats, side: int, tolerance: float, chosen: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Least squares over the chosen points, then over those that agree with it, until these stay the same."""
    affine, off = identity(), np.zeros(0)
    for _ in range(_ROUNDS):
        affine = _least_squares(points[chosen], shifts[chosen], side)
        off = residuals(affine, points, shifts)
        earlier, chosen = chosen, off <= tolerance
        if not chosen.any() or np.array_equal(earlier, chosen):
            break
    return affine, off


def _guesses(points: Floats, shifts: Floats, side: int) -> Floats:
    """(G, 4): zoom and turn less identity, shift across and down."""
    count = len(points)
    alone = np.zeros((count, 4))
    alone[:, 2:] = shifts
    steps = np.array([max(1, count // 4), max(1, count // 3), max(1, count // 2), max(1, 2 * count // 3)])
    first = np.tile(np.arange(count), len(steps))
    second = (first + np.repeat(steps, count)) % count
    between = points[second] - points[first]
    squared = between[:, 0] * between[:, 0] + between[:, 1] * between[:, 1]
    is_far = squared >= (_NEAR_SHARE * side) ** 2
    first, second, between, squared = first[is_far], second[is_far], between[is_far], squared[is_far]
    change = shifts[second] - shifts[first]
    (x, y), (across, down) = points[first].T, shifts[first].T
    pairs = np.empty((len(first), 4))
    zoom = pairs[:, 0] = (between[:, 0] * change[:, 0] + between[:, 1] * change[:, 1]) / squared
    turn = pairs[:, 1] = (between[:, 0] * change[:, 1] - between[:, 1] * change[:, 0]) / squared
    pairs[:, 2] = across - zoom * x + turn * y
    pairs[:, 3] = down - turn * x - zoom * y
    return np.concatenate([alone, pairs])


def _affine(parameters: Floats) -> Floats:
    zoom, turn, across, down = parameters.tolist()
    return np.array([[1 + zoom, -turn, across], [turn, 1 + zoom, down]])


def _least_squares(points: Floats, shifts: Floats, side: int) -> Floats:
    """Over all points; only the mean shift where they are too few or too close to tell more."""
    count = len(points)
    x, y = points[:, 0], points[:, 1]
    across, down = shifts[:, 0], shifts[:, 1]
    sum_x, sum_y, sum_across, sum_down = (float(values.sum()) for values in (x, y, across, down))
    spread = float((x * x + y * y).sum()) - (sum_x * sum_x + sum_y * sum_y) / count
    zoom = turn = 0.0
    if count >= _ENOUGH_TO_TURN and spread >= count * (_WIDE_SPREAD * side) ** 2:
        zoom = float((x * across + y * down).sum()) - (sum_x * sum_across + sum_y * sum_down) / count
        turn = float((x * down - y * across).sum()) - (sum_x * sum_down - sum_y * sum_across) / count
        zoom, turn = zoom / spread, turn / spread
    mean_x, mean_y = sum_x / count, sum_y / count
    return _affine(
        np.array(
            [
                zoom,
                turn,
                sum_across / count - zoom * mean_x + turn * mean_y,
                sum_down / count - turn * mean_x - zoom * mean_y,
            ]
        )
    )
