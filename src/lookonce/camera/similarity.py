"""Shift, turn and zoom from the shifts of blocks of which many may be wrong.

An affine here is (2, 3) float64: ``[x', y'] = A[:, :2] @ [x, y] + A[:, 2]``. Sums are over multiples of 1/1024 and
exact; what follows them is plain arithmetic on single numbers. So the result is the same on every machine.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["apply", "compose", "fit_similarity", "identity", "invert", "largest_shift", "residuals"]

Floats = NDArray[np.float64]

_NEAR_SHARE = 0.25  # of the picture's longer side: what two blocks of a guess are apart at least
_ROUNDS = 4
_ENOUGH_TO_TURN = 16  # points; fewer tell a shift only
_CLEAR_SHARE = 0.8  # of the points that agree: no other answer can have more
_CLOSEST_SHARE = 0.75  # of the points that agree: the last answer is theirs, some of the others are a little wrong
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
    (a, b, c), (d, e, f) = affine.tolist()
    corners = ((x, y) for x in (0, size[1]) for y in (0, size[0]))
    shifts = ((a * x + b * y + c - x, d * x + e * y + f - y) for x, y in corners)
    return math.sqrt(max(across * across + down * down for across, down in shifts))


def residuals(affine: Floats, points: Floats, shifts: Floats) -> Floats:
    """How far (N,) each moved point is from where its own shift takes it."""
    apart = apply(affine, points) - points - shifts
    distances: Floats = np.sqrt(apart[:, 0] * apart[:, 0] + apart[:, 1] * apart[:, 1])
    return distances


def fit_similarity(points: Floats, shifts: Floats, size: tuple[int, int], tolerance: float) -> tuple[Floats, Floats]:
    """The shift, turn and zoom with which most points agree.

    Least squares do where nearly all agree. Otherwise guesses are made from each point alone (a shift) and from pairs
    that lie far apart; the one with most points within twice the tolerance wins, the first of equals, and least squares
    over those points follow. The three quarters that agree best have the last word.

    Args:
        points: (N, 2) px, multiples of 1/2; N >= 1.
        shifts: (N, 2) px, multiples of 1/1024.
        size: (height, width) of the picture in px.
        tolerance: how far a point may be off, px.

    Returns:
        The affine, and how far each point (N,) is off that of all that agree.
    """
    table = np.concatenate([np.ones((len(points), 1)), points, shifts], axis=1)
    affine, off = _refine(table, max(size), tolerance, None)
    if np.count_nonzero(off <= tolerance) < _CLEAR_SHARE * len(points):
        guesses = _guesses(points, shifts, max(size))
        x, y = points[:, 0], points[:, 1]
        off_x = guesses[:, :1] * x - guesses[:, 1:2] * y + guesses[:, 2:3] - shifts[:, 0]
        off_y = guesses[:, 1:2] * x + guesses[:, :1] * y + guesses[:, 3:] - shifts[:, 1]
        agrees = off_x * off_x + off_y * off_y <= 4 * tolerance * tolerance  # (G, N)
        affine, off = _refine(table, max(size), tolerance, agrees[int(agrees.sum(axis=1).argmax())])
    agreeing = np.sort(off[off <= tolerance])
    count = int(_CLOSEST_SHARE * len(agreeing))
    if count >= _ENOUGH_TO_TURN:
        affine = _least_squares(table[off <= agreeing[count - 1]], max(size))
    return affine, off


def _refine(table: Floats, side: int, tolerance: float, chosen: NDArray[np.bool_] | None) -> tuple[Floats, Floats]:
    """Least squares over the chosen rows (None: all), then over those that agree with it, until these stay the same.

    A row of the table (N, 5) is 1, x, y, and the shift across and down.
    """
    affine, off = identity(), np.zeros(0)
    for _ in range(_ROUNDS):
        affine = _least_squares(table if chosen is None else table[chosen], side)
        off = residuals(affine, table[:, 1:3], table[:, 3:])
        earlier, chosen = chosen, off <= tolerance
        if not chosen.any() or (chosen.all() if earlier is None else np.array_equal(earlier, chosen)):
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


def _least_squares(table: Floats, side: int) -> Floats:
    """Over all rows; only the mean shift where they are too few or too close to tell more."""
    count = len(table)
    (_, sum_x, sum_y, sum_across, sum_down), of_x, of_y, *_ = (table.T @ table).tolist()  # exact, in any order
    spread = of_x[1] + of_y[2] - (sum_x * sum_x + sum_y * sum_y) / count
    zoom = turn = 0.0
    if count >= _ENOUGH_TO_TURN and spread >= count * (_WIDE_SPREAD * side) ** 2:
        zoom = (of_x[3] + of_y[4] - (sum_x * sum_across + sum_y * sum_down) / count) / spread
        turn = (of_x[4] - of_y[3] - (sum_x * sum_down - sum_y * sum_across) / count) / spread
    mean_x, mean_y = sum_x / count, sum_y / count
    across = sum_across / count - zoom * mean_x + turn * mean_y
    down = sum_down / count - turn * mean_x - zoom * mean_y
    return np.array([[1 + zoom, -turn, across], [turn, 1 + zoom, down]])
