"""What a synthetic scene is to be like."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lookonce.errors import ConfigError

__all__ = ["LIGHTS", "PLACES", "SceneConfig"]

PLACES = ("junction", "tee", "highway")
LIGHTS = ("day", "night", "change")
_LARGEST_SIDE_PX = 4096
_SMALLEST_SIDE_PX = 64


@dataclass(frozen=True, slots=True)
class SceneConfig:
    """The settings of one scene, checked on construction.

    Attributes:
        seconds: length of the video, above 0 and up to a day.
        fps: frames per second, 1 to 120.
        height: of the picture in px, 64 to 4096, even.
        width: of the picture in px, 64 to 4096, even.
        seed: 0 or more; everything random follows from it.
        place: "junction", "tee" or "highway"; "" = drawn by the seed.
        light: "day" (clouds come and go), "night" (street lamps and headlights) or "change" (dusk falls half way).
        density: of the traffic, 0 to 5; 1 = busy, with queues.
        look_alikes: share of the cars that are one model in one colour, 0 to 1.
        shake_px: how far the camera wobbles (standard deviation, for a picture 960 px wide), 0 to 10.
        exposure_s: of a frame by day, 0 to 1/fps; at night it is three times that. Objects blur along their way.
        noise: of the sensor by day, standard deviation in grey levels, 0 to 6; at night it is twice that.
        jpeg_quality: each picture goes through JPEG of this quality, 1 to 95; 0 = it does not.
        ignored_regions: whether far roads and car parks are ignored regions, without truth.
        min_px: objects whose box is lower or narrower than this are left out and counted, 1 to 64.

    Raises:
        ConfigError: a setting is out of its range.
    """

    seconds: float = 60.0
    fps: float = 15.0
    height: int = 540
    width: int = 960
    seed: int = 0
    place: str = ""
    light: str = "day"
    density: float = 1.0
    look_alikes: float = 0.3
    shake_px: float = 0.5
    exposure_s: float = 0.006
    noise: float = 2.0
    jpeg_quality: int = 0
    ignored_regions: bool = True
    min_px: float = 6.0

    def __post_init__(self) -> None:
        _check_range("seconds", self.seconds, 1e-3, 86_400)
        _check_range("fps", self.fps, 1, 120)
        for name, side in (("height", self.height), ("width", self.width)):
            _check_whole(name, side, _SMALLEST_SIDE_PX, _LARGEST_SIDE_PX)
            if side % 2:
                raise ConfigError(f"{name} = {side}: expected an even number of px, for the sake of H.264")
        _check_whole("seed", self.seed, 0, 2**32 - 1)
        _check_choice("place", self.place, ("", *PLACES))
        _check_choice("light", self.light, LIGHTS)
        _check_range("density", self.density, 0, 5)
        _check_range("look_alikes", self.look_alikes, 0, 1)
        _check_range("shake_px", self.shake_px, 0, 10)
        _check_range("exposure_s", self.exposure_s, 0, 1 / self.fps)
        _check_range("noise", self.noise, 0, 6)
        _check_whole("jpeg_quality", self.jpeg_quality, 0, 95)
        _check_range("min_px", self.min_px, 1, 64)

    @property
    def frames(self) -> int:
        """How many frames there are, at least one."""
        return max(1, round(self.seconds * self.fps))


def _check_range(name: str, value: float, low: float, high: float) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise ConfigError(f"{name} = {value:g}: expected a number from {low:g} to {high:g}")


def _check_whole(name: str, value: int, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ConfigError(f"{name} = {value}: expected a whole number from {low} to {high}")


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ConfigError(f"{name} = {value!r}: expected one of {', '.join(choice for choice in choices if choice)}")
