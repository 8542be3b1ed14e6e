"""Constant-velocity Kalman filters for many objects at once, in seconds.

Each object's centre has two independent filters of the same noise, x and y (state: place and velocity), and its width
and height, as logarithms, a scalar filter of a random walk. Noise is stated in longer sides of the box, so that it
holds near and far, for people and for trains; what is unseen slows down. With white acceleration of density q² the
exact covariance of the step dt is ``[[dt³/3, dt²/2], [dt²/2, dt]] q²`` (Bar-Shalom, Li and Kirubarajan, "Estimation
with applications to tracking and navigation", 6.2.2).

What comes nearer grows and speeds up. A filter of the size's logarithm tells how fast; its state is the level, which
is the mean over width and height, and the growth g, 1/s. A point ``p = f X / Z`` that moves with constant speed in
space has the velocity ``v = f X' / Z + g p`` in the picture, with ``g = -Z' / Z``, and so ``v' = 2 g v``: after dt it
has moved by ``v dt / (1 - g dt)``, its size is ``1 / (1 - g dt)`` times as large, its velocity the square of that.
Growth that may be noise is not believed: what is used of g is ``g max(0, 1 - var(g) / g²)``, the positive part after
James and Stein. That g itself would grow between detections is left out, because what passes by the camera would be
shot away; of unseen objects it fades as the velocity does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.tracking.motion_config import MotionConfig

__all__ = [
    "LOGARITHMS",
    "MOTION_ROWS",
    "VARIANCES",
    "Correction",
    "Motions",
    "box_states",
    "boxes_around",
    "log_sides",
    "moved",
    "squared_lengths",
]

_F = NDArray[np.float64]

_LARGEST_SIZE_VARIANCE = 0.25  # a box half or twice as large, after any gap
_MOST_GROWTH = 0.5  # in one step, as a share of the depth: more would lead through the camera
MOTION_ROWS = 15
VARIANCES, LOGARITHMS = (6, 7, 10, 11, 12), (2, 3, 14)  # of these rows


@dataclass(frozen=True, slots=True)
class Correction:
    """What M filters were corrected by.

    Attributes:
        surprise: (4, M) float64, the detection's ``box_states`` less the expected ones.
        gains: (2, M) float64, the share of it that the filters of place and size have taken over.
    """

    surprise: _F
    gains: _F


@dataclass(slots=True)
class Motions:
    """The filters of P objects.

    Attributes:
        values: (15, P) float64, a row for each number, so that a step is a few operations on long rows: place x and y,
            logarithms of width and height, velocity x and y; then by twos, of the place and of the level, the variance,
            the covariance with velocity and growth, and the variance of these; then the variance of the size, growth
            and level.
    """

    values: _F

    @property
    def place(self) -> _F:
        """(P, 2) centre x, y in px; this and the others are views."""
        return self.values[:2].T

    @property
    def log_size(self) -> _F:
        """(P, 2) logarithms of width and height in px."""
        return self.values[2:4].T

    @property
    def velocity(self) -> _F:
        """(P, 2) px / s."""
        return self.values[4:6].T

    @property
    def place_variance(self) -> _F:
        """(P,) of each coordinate, px²."""
        return self.values[6, :]

    @property
    def covariance(self) -> _F:
        """(P,) of place and velocity of each coordinate, px² / s."""
        return self.values[8, :]

    @property
    def velocity_variance(self) -> _F:
        """(P,) of each coordinate, px² / s²."""
        return self.values[10, :]

    @property
    def size_variance(self) -> _F:
        """(P,) of each logarithm."""
        return self.values[12, :]

    @property
    def growth(self) -> _F:
        """(P,) of the size's logarithm, 1 / s."""
        return self.values[13, :]

    @property
    def growth_variance(self) -> _F:
        """(P,) 1 / s²."""
        return self.values[11, :]

    @classmethod
    def begin(cls, states: _F, config: MotionConfig) -> Motions:
        """Filters of objects seen once, from ``box_states`` (P, 4)."""
        values = np.zeros((MOTION_ROWS, len(states)))
        values[:4] = states.T
        side = np.exp(log_sides(values))
        values[6], values[7] = (config.place_noise * side) ** 2, config.growth_noise**2
        values[10], values[11] = (config.new_speed * side) ** 2, config.growth**2
        values[12] = config.size_noise**2
        values[14] = _levels(values)
        return cls(values)

    def part(self, objects: NDArray[np.intp]) -> Motions:
        """Those of ``objects`` (M,)."""
        return Motions(self.values.take(objects, axis=1))

    def joined(self, others: Motions) -> Motions:
        """These, then the others."""
        return Motions(np.concatenate([self.values, others.values], axis=1))

    def predict_(self, step_s: float, is_unseen: NDArray[np.bool_], config: MotionConfig) -> None:
        """Changes the filters to what is to be expected ``step_s`` later; ``is_unseen`` (P,) before the step."""
        values, velocity = self.values, self.values[4:6]
        squared_side = np.exp(2 * log_sides(values))
        noise = np.empty((2, len(squared_side)))
        np.multiply(squared_side, config.acceleration**2, out=noise[0])
        noise[0] += (config.acceleration_share**2) * squared_lengths(velocity.T)
        noise[1] = config.growth_drift**2
        self._move_(step_s)
        unseen = is_unseen.nonzero()[0]
        if len(unseen):
            kept = np.exp(-step_s / config.slow_down_s)
            for speed in (values[4], values[5], values[13]):  # one by one: NumPy is slow with two dimensions
                speed[unseen] *= kept
        variance, covariance, rate_variance = values[6:8], values[8:10], values[10:12]
        grown = rate_variance * step_s
        variance += (2 * covariance + grown) * step_s
        variance += noise * (step_s**3 / 3)
        grown += noise * (step_s**2 / 2)
        covariance += grown
        noise *= step_s
        rate_variance += noise
        most = np.empty_like(noise)
        np.multiply(squared_side, config.new_speed**2, out=most[0])
        most[1] = config.growth**2
        beyond = (rate_variance > most).ravel().nonzero()[0]
        if len(beyond):  # the covariance goes with it, or the matrix would not be one of a distribution any more
            bound, rates = most.ravel()[beyond], rate_variance.reshape(-1)  # views: rows lie one after the other
            covariance.reshape(-1)[beyond] *= np.sqrt(bound / rates[beyond])
            rates[beyond] = bound
        values[12] += config.size_drift**2 * step_s
        np.minimum(values[12], _LARGEST_SIZE_VARIANCE, out=values[12])

    def _move_(self, step_s: float) -> None:
        """Places, sizes and speeds ``step_s`` later."""
        values = self.values
        growth, velocity = values[13], values[4:6]
        values[14] += growth * step_s
        squared = growth * growth
        is_sure = (squared > values[11]).nonzero()[0]
        if not len(is_sure):
            values[:2] += velocity * step_s
            return
        nearer = np.ones(len(growth))
        sure = growth[is_sure]
        sure *= 1.0 - values[11][is_sure] / squared[is_sure]
        nearer[is_sure] = 1.0 / (1.0 - np.minimum(np.maximum(sure * step_s, -_MOST_GROWTH), _MOST_GROWTH))
        values[:2] += velocity * (step_s * nearer)
        values[2:4] += np.log(nearer)
        nearer *= nearer
        velocity *= nearer

    def correct_(
        self,
        objects: NDArray[np.intp],
        states: _F,
        scores: _F,
        config: MotionConfig,
        shares: _F | None = None,
        before: _F | None = None,
    ) -> Correction:
        """Changes the filters of ``objects`` (M,) by what was seen of them, and says how.

        The product of two surprises in a row has the mean 0 if a filter fits (Mehra, "On the identification of
        variances and adaptive Kalman filtering", IEEE Transactions on Automatic Control 15, 1970). What it is above
        that widens what is expected by one factor, as in the strong tracking filter of Zhou and Frank (International
        Journal of Control 65, 1996), so that velocity follows at once where objects turn.

        Args:
            objects: places.
            states: (M, 4) ``box_states`` of the detections.
            scores: (M,) of them.
            config: the settings.
            shares: (M,) of what each may be, that of its own object; None: all are certain.
            before: (2, M) the surprise in x and y at the sighting before, boxes; infinite: there is none to go by.
        """
        values, seen = self.values.take(objects, axis=1), states.T
        variance, covariance, size_variance = values[6:8], values[8:10], values[12]
        noise = 1.0 + config.score_noise * (0.5 - scores)
        np.maximum(noise, 1.0 - 0.5 * config.score_noise, out=noise)  # as of score 1, whatever is above
        if shares is not None:
            noise /= shares**config.doubt
        noise *= noise
        surprise, side, total = seen - values[:4], np.exp(log_sides(seen)), variance.copy()
        total[0] += (config.place_noise * side) ** 2 * noise
        total[1] += config.growth_noise**2 * noise
        if before is not None:
            _widen_lagging_(
                values, total[0], surprise[:2], np.where(before < np.inf, before * side, 0.0), config.lag, shares
            )
        gain, rate_gain = variance / total, covariance / total
        size_gain = size_variance / (size_variance + config.size_noise**2 * noise)
        taller = _levels(seen) - values[14]
        for axis in (0, 1):  # one by one: NumPy is slow to repeat a row
            values[axis] += gain[0] * surprise[axis]
            values[2 + axis] += size_gain * surprise[2 + axis]
            values[4 + axis] += rate_gain[0] * surprise[axis]
        values[13] += rate_gain[1] * taller
        values[14] += gain[1] * taller
        values[10:12] -= rate_gain * covariance
        variance -= gain * variance
        covariance -= gain * covariance
        size_variance *= 1 - size_gain
        self.values[:, objects] = values
        gain[1] = size_gain
        return Correction(surprise, gain)

    def more_speed(self, is_new: NDArray[np.bool_], config: MotionConfig) -> _F:
        """(P,) px² / s², by how much the variance of the velocity is above that of the filter.

        Of objects seen once, ``is_new`` (P,), if they turn out to be fast, and of others if they turn.
        """
        of_new = max(0.0, config.jump_speed**2 - config.new_speed**2)
        more: _F = np.where(is_new, of_new, config.turn_speed**2) * np.exp(2 * log_sides(self.values))
        return more

    def widen_(self, objects: NDArray[np.intp], elapsed_s: _F, more: _F) -> None:
        """Changes the filters of ``objects`` (M,), seen ``elapsed_s`` (M,) ago, by ``more`` (M,) variance of speed."""
        self.place_variance[objects] += more * elapsed_s**2
        self.covariance[objects] += more * elapsed_s
        self.velocity_variance[objects] += more

    def move_camera_(self, affine: _F) -> None:
        """Changes the filters by an affine map (2, 3) of the picture before onto this one; variances grow as areas."""
        linear = affine[:, :2]
        (a, b), (c, d) = linear.tolist()
        area = abs(a * d - b * c)
        self.place[:] = moved(self.place, affine)
        self.velocity[:] = np.ascontiguousarray(self.velocity) @ linear.T
        for row in (6, 8, 10):
            self.values[row] *= area
        self.values[2:4] += 0.5 * np.log(area)
        self.values[14] += 0.5 * np.log(area)

    def boxes(self) -> _F:
        """(P, 4) float64 xyxy where the objects are believed to be."""
        return boxes_around(self.values[:2], np.exp(self.values[2:4]))


def _widen_lagging_(values: _F, total: _F, now: _F, before: _F, lag: float, shares: _F | None) -> None:
    """Changes the filters ``values`` (15, M) of what lags, and the variance ``total`` (M,) of its surprise, px².

    Two surprises in a row (2, M), px, say who does; 0 where there were not two.
    """
    products = now * before
    excess = 0.5 * (products[0] + products[1]) - lag * total
    lagging = (excess > 0).nonzero()[0]
    if not len(lagging):
        return
    more = excess[lagging] if shares is None else excess[lagging] * shares[lagging]
    factor = 1.0 + more / values[6][lagging]
    for row in (6, 8, 10):
        values[row][lagging] *= factor
    total[lagging] += more


def log_sides(states: _F) -> _F:
    """(P,) logarithms of the longer sides of ``states`` (4 or more, P)."""
    sides: _F = np.maximum(states[2], states[3])
    return sides


def _levels(states: _F) -> _F:
    """(P,) means of the two logarithms of ``states`` (4, P)."""
    levels: _F = states[2] + states[3]
    levels *= 0.5
    return levels


def boxes_around(centre: _F, size: _F) -> _F:
    """Boxes xyxy (N, 4) of ``centre`` (2, N) and ``size`` (2, N), x before y."""
    half = size * 0.5
    boxes = np.empty((4, len(half[0])))
    np.subtract(centre, half, out=boxes[:2])
    np.add(centre, half, out=boxes[2:])
    return boxes.T


def moved(points: _F, affine: _F) -> _F:
    """Points (N, 2) under an affine map (2, 3)."""
    there: _F = np.ascontiguousarray(points) @ affine[:, :2].T + affine[:, 2]  # the same bytes in any layout
    return there


def squared_lengths(vectors: _F) -> _F:
    """(N,) of N vectors (N, 2)."""
    x, y = vectors[:, 0], vectors[:, 1]
    squared: _F = x * x
    squared += y * y
    return squared


def box_states(xyxy: NDArray[np.floating]) -> _F:
    """Boxes ``xyxy`` (N, 4) as (N, 4) float64: centre x, y in px, logarithms of width and height; long columns."""
    corners = np.ascontiguousarray(xyxy.T, np.float64)
    low, high = corners[:2], corners[2:]
    states = np.empty(corners.shape)
    np.add(low, high, out=states[:2])
    states[:2] *= 0.5
    np.subtract(high, low, out=states[2:])
    np.log(states[2:], out=states[2:])
    return states.T
