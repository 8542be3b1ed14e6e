"""Which settings are searched, and between which values."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lookonce.config import setting_types
from lookonce.errors import ConfigError
from lookonce.tracking import DefaultConfig, TrackerConfig

__all__ = ["SearchRange", "choose_ranges", "lowest_score", "setting_value", "values_of"]

_DIGITS = 3


@dataclass(frozen=True, slots=True)
class SearchRange:
    """The values of one setting that are tried.

    Attributes:
        name: of the setting, such as ``motion.place_noise``.
        low, high: the smallest and the largest value.
        is_log: whether factors count instead of differences.
        is_whole: whether it is a whole number.
    """

    name: str
    low: float
    high: float
    is_log: bool = False
    is_whole: bool = False

    def tidy(self, value: float) -> float:
        """The value inside the range, with few digits: what is written is what was tried."""
        if self.is_whole:
            return int(min(max(round(value), self.low), self.high))
        return min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)


def _log(name: str, low: float, high: float) -> SearchRange:
    return SearchRange(name, low, high, is_log=True)


def _whole(name: str, low: int, high: int) -> SearchRange:
    return SearchRange(name, low, high, is_whole=True)


_THRESHOLD = SearchRange("match_threshold", 0.3, 1.5)
_APPEARANCE = (
    _THRESHOLD,
    _log("appearance_weight", 0.75, 12.0),
    _log("appearance_limit", 0.75, 12.0),
    _whole("views", 0, 12),
    SearchRange("view_apart", 0.1, 1.2),
    _log("view_interval_s", 0.03, 2.0),
    SearchRange("clean_overlap", 0.03, 0.9),
    SearchRange("hidden_overlap", 0.03, 0.8),
    _log("hidden_s", 0.3, 10.0),
)
_DETECTIONS = (
    SearchRange("low_score", 0.05, 0.3),
    SearchRange("birth_score", 0.1, 0.6),
    SearchRange("high_score", 0.2, 0.8),
    SearchRange("low_overlap", 0.1, 0.8),
    _log("recent_s", 0.05, 10.0),
    SearchRange("safe_overlap", 0.2, 0.95),
    SearchRange("same_overlap", 0.3, 0.95),
    SearchRange("duplicate_overlap", 0.1, 0.9),
    _log("crowd_box", 0.5, 32.0),
    SearchRange("place_limit", 0.0, 6.0),
    SearchRange("appearance_absent", 0.0, 6.0),
    SearchRange("class_penalty", 0.0, 8.0),
    _log("memory_s", 0.5, 60.0),
    _log("tentative_s", 0.1, 4.0),
    _log("leave_s", 0.1, 8.0),
    SearchRange("fill_s", 0.0, 8.0),
)
_MOTION = (
    _log("motion.place_noise", 0.03, 0.5),
    _log("motion.size_noise", 0.08, 1.2),
    _log("motion.acceleration", 0.05, 2.0),
    _log("motion.acceleration_share", 0.05, 2.0),
    _log("motion.new_speed", 0.3, 16.0),
    _log("motion.size_drift", 0.05, 1.5),
    _log("motion.jump_speed", 4.0, 64.0),
    SearchRange("motion.jump_share", 0.02, 0.8),
    _log("motion.turn_speed", 0.2, 8.0),
    SearchRange("motion.turn_share", 0.0, 0.5),
    SearchRange("motion.alone_speed", 0.0, 16.0),
    _log("motion.lag", 0.2, 20.0),
    _log("motion.slow_down_s", 0.3, 10.0),
    SearchRange("motion.score_noise", 0.0, 1.8),
    SearchRange("motion.doubt", 0.0, 4.0),
    _log("motion.growth", 0.03, 1.5),
    _log("motion.growth_drift", 0.02, 1.0),
    _log("motion.growth_noise", 0.05, 0.8),
)
_EVIDENCE = (
    _whole("evidence.hits", 1, 5),
    SearchRange("evidence.score", 0.3, 0.95),
    _log("evidence.score_mean_s", 0.1, 5.0),
    _log("evidence.score_memory_s", 0.5, 20.0),
    _log("evidence.travel", 0.1, 2.5),
    _whole("evidence.travels", 1, 6),
    _log("evidence.travel_memory_s", 0.5, 20.0),
)


def choose_ranges(config: TrackerConfig, has_descriptors: bool, only: Sequence[str] = ()) -> tuple[SearchRange, ...]:
    """What is searched around these settings.

    Args:
        config: where the search begins; what it switches off is not searched.
        has_descriptors: whether the detections have any.
        only: names of settings, or of tables such as ``motion``; none = all.

    Raises:
        ConfigError: a name is not one of a setting that can be searched.
    """
    if isinstance(config, DefaultConfig):
        appearance = _APPEARANCE if config.appearance and has_descriptors else ()
        known = (*appearance, *_DETECTIONS, *_MOTION, *_EVIDENCE)
    else:
        known = (_THRESHOLD,)
    names = {one.name for one in known} | {one.name.rpartition(".")[0] for one in known if "." in one.name}
    for name in only:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {near[0]}?" if near else f"expected some of {', '.join(sorted(names))}"
            raise ConfigError(f"--only {name!r}: not a setting that is searched here; {hint}")
    return tuple(one for one in known if not only or one.name in only or one.name.rpartition(".")[0] in only)


def setting_value(config: TrackerConfig, name: str) -> float:
    """A number of the settings by its name."""
    assert name in setting_types(type(config))
    value: Any = config
    for part in name.split("."):
        value = getattr(value, part)
    return float(value)


def lowest_score(config: TrackerConfig) -> float | None:
    """The lowest score of detections that may be tried; None where it is not searched."""
    if not isinstance(config, DefaultConfig):
        return None
    return min(config.low_score, *(one.low for one in _DETECTIONS if one.name == "low_score"))


def values_of(config: TrackerConfig, ranges: Sequence[SearchRange]) -> Mapping[str, float]:
    """The values of the searched settings, inside their ranges."""
    return {one.name: one.tidy(setting_value(config, one.name)) for one in ranges}
