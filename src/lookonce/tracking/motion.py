"""Constant-velocity Kalman filters for many objects at once, in seconds.

Each object's centre has two independent filters of the same noise, x and y (state: place and velocity), and its width
and height, as logarithms, a scalar filter of a random walk. Noise is stated in box heights, so that it holds near and
far; what is unseen slows down. With white acceleration of density q² the exact covariance of the step dt is
``[[dt³/3, dt²/2], [dt²/2, dt]] q²`` (Bar-Shalom, Li and Kirubarajan, "Estimation with applications to tracking and
navigation", 6.2.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.config import check_numbers

__all__ = ["Correction", "MotionConfig", "Motions", "box_states", "boxes_around", "moved", "squared_lengths"]

_F = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """How objects move and how boxes err; "box" means the height of the object's box.

    Attributes:
        place_noise: standard deviation of a detection's centre, boxes.
        size_noise: of the logarithm of a detection's width and height.
        acceleration: spectral density of the acceleration of an object at rest, boxes / s^1.5.
        acceleration_share: the same for a moving one, as a share of its speed, 1 / s^0.5.
        new_speed: standard deviation of the speed of an object seen once, and its bound later, boxes / s.
        size_drift: random walk of the logarithm of the size, 1 / s^0.5.
        jump_speed: of an object seen once that turns out to be fast, boxes / s;
        jump_share: this share of all new objects.
        slow_down_s: an unseen object loses its speed with this time constant, s.
    """

    place_noise: float = 0.12
    size_noise: float = 0.4
    acceleration: float = 0.25
    acceleration_share: float = 0.25
    new_speed: float = 2.0
    size_drift: float = 0.3
    jump_speed: float = 16.0
    jump_share: float = 0.3
    slow_down_s: float = 1.5

    def __post_init__(self) -> None:
        check_numbers(self, above_zero=("place_noise", "size_noise", "slow_down_s"))


_LARGEST_SIZE_VARIANCE = 0.25  # a box half or twice as large, after any gap


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
        values: (10, P) float64, a row for each number, so that a step is a few operations on long rows: place x and y,
            logarithms of width and height, velocity x and y, the three variances, and that of the size.
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
        return self.values[7, :]

    @property
    def velocity_variance(self) -> _F:
        """(P,) of each coordinate, px² / s²."""
        return self.values[8, :]

    @property
    def size_variance(self) -> _F:
        """(P,) of each logarithm."""
        return self.values[9, :]

    @classmethod
    def begin(cls, states: _F, config: MotionConfig) -> Motions:
        """Filters of objects seen once, from ``box_states`` (P, 4)."""
        values = np.zeros((10, len(states)))
        values[:4] = states.T
        height = np.exp(values[3])
        values[6] = (config.place_noise * height) ** 2
        values[8] = (config.new_speed * height) ** 2
        values[9] = config.size_noise**2
        return cls(values)

    def part(self, objects: NDArray[np.intp]) -> Motions:
        """Those of ``objects`` (M,)."""
        return Motions(self.values.take(objects, axis=1))

    def joined(self, others: Motions) -> Motions:
        """These, then the others."""
        return Motions(np.concatenate([self.values, others.values], axis=1))

    def predict_(self, step_s: float, is_unseen: NDArray[np.bool_], config: MotionConfig) -> None:
        """Changes the filters to what is to be expected ``step_s`` later; ``is_unseen`` (P,) before the step."""
        place, velocity = self.values[:2], self.values[4:6]
        variance, covariance, velocity_variance, size_variance = _variances(self.values)
        squared_height = np.exp(2 * self.values[3])
        noise = (config.acceleration**2) * squared_height
        noise += (config.acceleration_share**2) * squared_lengths(velocity.T)
        place += velocity * step_s
        unseen = is_unseen.nonzero()[0]
        if len(unseen):
            kept = np.exp(-step_s / config.slow_down_s)
            for speed in (self.values[4], self.values[5]):  # one by one: NumPy is slow with two dimensions
                speed[unseen] *= kept
        grown = velocity_variance * step_s
        variance += (2 * covariance + grown) * step_s
        variance += noise * (step_s**3 / 3)
        grown += noise * (step_s**2 / 2)
        covariance += grown
        noise *= step_s
        velocity_variance += noise
        bound = config.new_speed**2 * squared_height
        beyond = (velocity_variance > bound).nonzero()[0]
        if len(beyond):  # the covariance goes with it, or the matrix would not be one of a distribution any more
            bound = bound[beyond]
            covariance[beyond] *= np.sqrt(bound / velocity_variance[beyond])
            velocity_variance[beyond] = bound
        size_variance += config.size_drift**2 * step_s
        np.minimum(size_variance, _LARGEST_SIZE_VARIANCE, out=size_variance)

    def correct_(self, objects: NDArray[np.intp], states: _F, config: MotionConfig) -> Correction:
        """Changes the filters of ``objects`` (M,) by what was seen of them, ``box_states`` (M, 4), and says how."""
        values, seen = self.values.take(objects, axis=1), states.T
        variance, covariance, velocity_variance, size_variance = _variances(values)
        total = variance + (config.place_noise * np.exp(seen[3])) ** 2
        gains, velocity_gain = np.empty((2, len(objects))), covariance / total
        place_gain, size_gain = gains[0], gains[1]
        np.divide(variance, total, out=place_gain)
        np.divide(size_variance, size_variance + config.size_noise**2, out=size_gain)
        surprise = seen - values[:4]
        for axis in (0, 1):  # one by one: NumPy is slow to repeat a row
            values[axis] += place_gain * surprise[axis]
            values[2 + axis] += size_gain * surprise[2 + axis]
            values[4 + axis] += velocity_gain * surprise[axis]
        velocity_variance -= velocity_gain * covariance
        variance -= place_gain * variance
        covariance -= place_gain * covariance
        size_variance *= 1 - size_gain
        self.values[:, objects] = values
        return Correction(surprise, gains)

    def widened(self, elapsed_s: _F, config: MotionConfig) -> _F:
        """(P,) place variance, px², of objects seen once, ``elapsed_s`` (P,) ago, that may be fast."""
        more = config.jump_speed**2 - config.new_speed**2
        widened: _F = self.place_variance + more * (elapsed_s**2 * np.exp(2 * self.values[3]))
        return widened

    def widen_(self, objects: NDArray[np.intp], elapsed_s: _F, config: MotionConfig) -> None:
        """Changes the filters of ``objects`` (M,), seen once, ``elapsed_s`` (M,) ago, to those of fast ones."""
        more = (config.jump_speed**2 - config.new_speed**2) * np.exp(2 * self.values[3, objects])
        self.place_variance[objects] += more * elapsed_s**2
        self.covariance[objects] += more * elapsed_s
        self.velocity_variance[objects] += more

    def move_camera_(self, affine: _F) -> None:
        """Changes the filters by an affine map (2, 3) of the picture before onto this one; variances grow as areas."""
        linear = affine[:, :2]
        (a, b), (c, d) = linear.tolist()
        growth = abs(a * d - b * c)
        self.place[:] = moved(self.place, affine)
        self.velocity[:] = np.ascontiguousarray(self.velocity) @ linear.T
        self.values[6:9] *= growth
        self.values[2:4] += 0.5 * np.log(growth)

    def boxes(self) -> _F:
        """(P, 4) float64 xyxy where the objects are believed to be."""
        return boxes_around(self.values[:2], np.exp(self.values[2:4]))


def _variances(values: _F) -> tuple[_F, _F, _F, _F]:
    """Of place, place with velocity, velocity and size: the last rows of ``Motions.values``."""
    return values[6], values[7], values[8], values[9]  # unpacking an array is slow


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
