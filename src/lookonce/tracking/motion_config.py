"""Settings of the filters."""

from __future__ import annotations

from dataclasses import dataclass

from lookonce.config import check_numbers
from lookonce.errors import ConfigError

__all__ = ["MotionConfig"]

_LEAST_NOISE = 1e-6  # with less, variances are lost in rounding
_MOST_DOUBT = 20.0  # with more, noise has no square any more where many stand in one place


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """How objects move and how boxes err; "box" means the longer side of the object's box.

    Attributes:
        place_noise: standard deviation of a detection's centre, boxes.
        size_noise: of the logarithm of a detection's width and height.
        score_noise: weak boxes err more: where a detection of score s corrects a filter, all noise is
            ``1 + score_noise (0.5 - s)`` times as large, below 2 (after Du and others, "GIAOTracker", 2021).
        doubt: a detection near others errs more: where it shows its object with a share of only p of what it may be
            (``lookonce.tracking.doubt``), all noise is ``1 / p^doubt`` times as large; at most 20.
        lag: surprises of a filter that fits are independent. Where the product of two in a row is above so many times
            the variance of one, the filter lags behind what turns or speeds up, and is widened by what is above
            (``Motions.correct_``); a large number: never.
        acceleration: spectral density of the acceleration of an object at rest, boxes / s^1.5.
        acceleration_share: the same for a moving one, as a share of its speed, 1 / s^0.5.
        new_speed: standard deviation of the speed of an object seen once, and its bound later, boxes / s.
        size_drift: random walk of the logarithm of the size, 1 / s^0.5.
        jump_speed: of an object seen once that turns out to be fast, boxes / s;
        jump_share: this share of all new objects.
        turn_speed: what was seen in the frame before may have turned since: its velocity has changed by so much in x
            and in y, boxes / s, standard deviation;
        turn_share: in this share of all frames.
        alone_speed: an object that was seen in the frame before and is not found now, and a detection that is nobody's,
            are one if they are less than half a box and so many boxes / s apart and nobody else is near
            (``lookonce.tracking.alone``); 0: they are not.
        slow_down_s: an unseen object loses its speed and growth with this time constant, s.
        growth: standard deviation of the growth of an object seen once, and its bound later, 1 / s; 0: nothing grows.
        growth_drift: spectral density of its change, 1 / s^1.5.
        growth_noise: standard deviation of the logarithm of a detection's size, where growth is measured.
    """

    place_noise: float = 0.12
    size_noise: float = 0.4
    score_noise: float = 0.6
    doubt: float = 2.0
    lag: float = 1.0
    acceleration: float = 0.25
    acceleration_share: float = 0.25
    new_speed: float = 2.0
    size_drift: float = 0.2
    jump_speed: float = 16.0
    jump_share: float = 0.3
    turn_speed: float = 1.5
    turn_share: float = 0.1
    alone_speed: float = 8.0
    slow_down_s: float = 2.5
    growth: float = 0.3
    growth_drift: float = 0.15
    growth_noise: float = 0.2

    def __post_init__(self) -> None:
        check_numbers(self, above_zero=("place_noise", "size_noise", "slow_down_s", "growth_noise"))
        for name in ("jump_share", "turn_share"):
            if getattr(self, name) > 1:
                raise ConfigError(f"{name}={getattr(self, name)}: expected a share of at most 1")
        for name in ("place_noise", "size_noise", "growth_noise"):
            if getattr(self, name) < _LEAST_NOISE:
                raise ConfigError(f"{name}={getattr(self, name)}: expected at least {_LEAST_NOISE:g}")
        if self.score_noise >= 2:
            raise ConfigError(f"score_noise={self.score_noise}: expected below 2")
        if self.doubt > _MOST_DOUBT:
            raise ConfigError(f"doubt={self.doubt}: expected at most {_MOST_DOUBT:g}")
