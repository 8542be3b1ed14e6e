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

__all__ = ["MotionConfig", "Motions", "box_states", "squared_lengths"]

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


@dataclass(slots=True)
class Motions:
    """The filters of P objects.

    Attributes:
        place: (P, 2) float64, centre x, y in px.
        velocity: (P, 2) float64, px / s.
        place_variance, covariance, velocity_variance: (P,) float64, of each coordinate; px², px²/s, px²/s².
        log_size: (P, 2) float64, logarithm of width and height in px.
        size_variance: (P,) float64.
    """

    place: _F
    velocity: _F
    place_variance: _F
    covariance: _F
    velocity_variance: _F
    log_size: _F
    size_variance: _F

    @classmethod
    def begin(cls, states: _F, config: MotionConfig) -> Motions:
        """Filters of objects seen once, from ``box_states`` (P, 4)."""
        height = np.exp(states[:, 3])
        return cls(
            states[:, :2].copy(),
            np.zeros((len(states), 2)),
            (config.place_noise * height) ** 2,
            np.zeros(len(states)),
            (config.new_speed * height) ** 2,
            states[:, 2:].copy(),
            np.full(len(states), config.size_noise**2),
        )

    def predict_(self, step_s: float, is_unseen: NDArray[np.bool_], config: MotionConfig) -> None:
        """Changes the filters to what is to be expected ``step_s`` later; ``is_unseen`` (P,) before the step."""
        squared_height = np.exp(2 * self.log_size[:, 1])
        noise = (config.acceleration**2) * squared_height
        noise += (config.acceleration_share**2) * squared_lengths(self.velocity)
        self.place += self.velocity * step_s
        slowing = np.where(is_unseen, np.exp(-step_s / config.slow_down_s), 1.0)
        self.velocity *= slowing[:, None]
        self.place_variance += (2 * self.covariance + self.velocity_variance * step_s) * step_s
        self.place_variance += noise * (step_s**3 / 3)
        self.covariance += self.velocity_variance * step_s + noise * (step_s**2 / 2)
        self.velocity_variance += noise * step_s
        bound = config.new_speed**2 * squared_height
        is_beyond = self.velocity_variance > bound
        if is_beyond.any():  # the covariance goes with it, or the matrix would not be one of a distribution any more
            self.covariance[is_beyond] *= np.sqrt(bound[is_beyond] / self.velocity_variance[is_beyond])
            self.velocity_variance[is_beyond] = bound[is_beyond]
        self.size_variance += config.size_drift**2 * step_s
        np.minimum(self.size_variance, _LARGEST_SIZE_VARIANCE, out=self.size_variance)

    def correct_(self, objects: NDArray[np.intp], states: _F, config: MotionConfig) -> None:
        """Changes the filters of ``objects`` (M,) by what was seen of them, ``box_states`` (M, 4)."""
        variance, covariance = self.place_variance[objects], self.covariance[objects]
        total = variance + (config.place_noise * np.exp(states[:, 3])) ** 2
        place_gain, velocity_gain = variance / total, covariance / total
        place = self.place.take(objects, axis=0)
        surprise = states[:, :2] - place
        self.place[objects] = place + place_gain[:, None] * surprise
        self.velocity[objects] = self.velocity.take(objects, axis=0) + velocity_gain[:, None] * surprise
        self.place_variance[objects] = variance - place_gain * variance
        self.covariance[objects] = covariance - place_gain * covariance
        self.velocity_variance[objects] -= velocity_gain * covariance
        size_gain = self.size_variance[objects]
        size_gain = size_gain / (size_gain + config.size_noise**2)
        log_size = self.log_size.take(objects, axis=0)
        self.log_size[objects] = log_size + size_gain[:, None] * (states[:, 2:] - log_size)
        self.size_variance[objects] *= 1 - size_gain

    def widened(self, elapsed_s: _F, config: MotionConfig) -> _F:
        """(P,) place variance, px², of objects seen once, ``elapsed_s`` (P,) ago, that may be fast."""
        return self.place_variance + (config.jump_speed**2 - config.new_speed**2) * (
            elapsed_s**2 * np.exp(2 * self.log_size[:, 1])
        )

    def widen_(self, objects: NDArray[np.intp], elapsed_s: _F, config: MotionConfig) -> None:
        """Changes the filters of ``objects`` (M,), seen once, ``elapsed_s`` (M,) ago, to those of fast ones."""
        more = (config.jump_speed**2 - config.new_speed**2) * np.exp(2 * self.log_size[objects, 1])
        self.place_variance[objects] += more * elapsed_s**2
        self.covariance[objects] += more * elapsed_s
        self.velocity_variance[objects] += more

    def move_camera_(self, affine: _F) -> None:
        """Changes the filters by an affine map (2, 3) of the picture before onto this one; variances grow as areas."""
        linear = affine[:, :2]
        (a, b), (c, d) = linear.tolist()
        growth = abs(a * d - b * c)
        self.place = self.place @ linear.T + affine[:, 2]
        self.velocity = self.velocity @ linear.T
        self.place_variance *= growth
        self.covariance *= growth
        self.velocity_variance *= growth
        self.log_size += 0.5 * np.log(growth)

    def boxes(self, objects: NDArray[np.intp] | None = None) -> _F:
        """(M, 4) float64 xyxy where ``objects`` (M,), by default all, are believed to be."""
        log_size, place = self.log_size, self.place
        if objects is not None:
            log_size, place = log_size.take(objects, axis=0), place.take(objects, axis=0)
        half = np.exp(log_size) / 2
        boxes = np.empty((len(place), 4))
        np.subtract(place, half, out=boxes[:, :2])
        np.add(place, half, out=boxes[:, 2:])
        return boxes


def squared_lengths(vectors: _F) -> _F:
    """(N,) of N vectors (N, 2)."""
    x, y = vectors.T
    squared: _F = x * x
    squared += y * y
    return squared


def box_states(xyxy: NDArray[np.float32]) -> _F:
    """Boxes ``xyxy`` (N, 4) as (N, 4) float64: centre x, y in px, logarithms of width and height."""
    states = np.empty((len(xyxy), 4))
    low, high = xyxy[:, :2].astype(np.float64), xyxy[:, 2:].astype(np.float64)
    states[:, :2] = (low + high) / 2
    np.log(high - low, out=states[:, 2:])
    return states
