"""The light of a moment: sun, sky, clouds, dusk, and the camera's answer to them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.config import SceneConfig

__all__ = ["Light", "Weather"]

Floats = NDArray[np.float64]

_STEPS = 32  # light changes in so many steps, so that the background need not be mixed anew for each frame
_DUSK_SHARE = 0.25  # of the scene's length that dusk takes
_LEAST_SUN = 0.12  # behind a cloud


@dataclass(frozen=True, slots=True)
class Light:
    """The light of a moment.

    Attributes:
        sun: share of the direct sun, 0 to 1.
        night: 0 = day, 1 = night.
        towards_sun: unit vector.
        sun_colour: (3,) what full sun adds to a white face that looks at it.
        sky_colour: (3,) what the sky adds to a white face that looks up.
        ground_colour: (3,) what comes back from the ground.
    """

    sun: float
    night: float
    towards_sun: Floats
    sun_colour: Floats
    sky_colour: Floats
    ground_colour: Floats

    @property
    def key(self) -> tuple[int, int]:
        """The step of sun and night: equal keys look equal."""
        return round(self.sun * _STEPS), round(self.night * _STEPS)

    @property
    def lamps(self) -> float:
        """How far lamps are lit, 0 to 1."""
        return min(1.0, max(0.0, (self.night - 0.3) / 0.3))


class Weather:
    """The light by time; a pure function of the settings.

    Args:
        config: the scene's settings.
        rng: draws the sun's place and the clouds.
        ahead_rad: where the camera looks; the sun is rather behind it.
    """

    def __init__(self, config: SceneConfig, rng: np.random.Generator, ahead_rad: float) -> None:
        self._kind, self._seconds = config.light, config.seconds
        self._azimuth = ahead_rad + math.pi + float(rng.uniform(-2.2, 2.2))
        self._height = math.radians(float(rng.uniform(24, 58)))
        self._warmth = float(rng.uniform(0, 1))
        self._base = float(rng.choice([1.0, 0.85, 0.25], p=[0.6, 0.25, 0.15]))
        self._phases = rng.uniform(0, 2 * math.pi, 3)
        self._periods_s = np.array([17.0, 41.0, 97.0]) * rng.uniform(0.8, 1.25, 3)

    @property
    def towards_sun(self) -> Floats:
        """Unit vector."""
        flat = math.cos(self._height)
        return np.array([flat * math.cos(self._azimuth), flat * math.sin(self._azimuth), math.sin(self._height)])

    def at(self, time_s: float) -> Light:
        """The light at a time of the scene."""
        return self.light(self._sun(time_s), self._night(time_s))

    def light(self, sun: float, night: float) -> Light:
        """The light for shares of sun and night, rounded to steps."""
        sun, night = round(sun * _STEPS) / _STEPS, round(night * _STEPS) / _STEPS
        day = 1 - night
        warm = np.array([1.0, 0.95 - 0.06 * self._warmth, 0.86 - 0.14 * self._warmth])
        sky = np.array([0.49, 0.535, 0.60]) * day + np.array([0.15, 0.165, 0.215]) * night
        return Light(
            sun=sun * day,
            night=night,
            towards_sun=self.towards_sun,
            sun_colour=1.12 * sun * day * warm,
            sky_colour=sky * (1 + 0.45 * (1 - sun) * day),
            ground_colour=np.array([0.32, 0.305, 0.28]) * day * (0.5 + 0.5 * sun) + 0.02 * night,
        )

    def _sun(self, time_s: float) -> float:
        waves = np.sin(2 * math.pi * time_s / self._periods_s + self._phases) @ np.array([0.25, 0.35, 0.4])
        passing = 1 / (1 + math.exp(-9 * (float(waves) + 0.25)))
        return _LEAST_SUN + (1 - _LEAST_SUN) * self._base * passing

    def _night(self, time_s: float) -> float:
        if self._kind != "change":
            return 1.0 if self._kind == "night" else 0.0
        share = (time_s / self._seconds - 0.5 + _DUSK_SHARE / 2) / _DUSK_SHARE
        share = min(1.0, max(0.0, share))
        return share * share * (3 - 2 * share)
