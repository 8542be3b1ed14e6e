"""Settings of the presets ``default`` and ``iou``."""

from __future__ import annotations

from dataclasses import dataclass, field

from lookonce.config import check_numbers
from lookonce.errors import ConfigError
from lookonce.tracking.motion_config import MotionConfig
from lookonce.tracking.objects import EvidenceConfig

__all__ = ["DefaultConfig", "iou_config"]

_LEAST_CROWD_BOX = 1e-3
_SHARES = (
    *("low_score", "birth_score", "high_score", "low_overlap", "safe_overlap"),
    *("same_overlap", "duplicate_overlap", "clean_overlap", "hidden_overlap"),
)
_MOST_VIEWS = 32  # each takes half a kilobyte of every object at 128 values


@dataclass(frozen=True, slots=True)
class DefaultConfig:
    """Settings of the preset ``default``; the preset ``iou`` is the same with ``appearance`` off.

    One set for all scenes, found on PETS09-S2L1, a highway clip and rendered scenes at one to eight frames' distance;
    wide ranges of each give nearly the same (`docs/log.md`). "box" is the longer side of an object's box.

    Attributes:
        appearance: whether descriptors are used.
        match_threshold: distance of two descriptors, above 0 to 2, from which they speak against one object. A model
            file that carries a calibrated value overrides it.
        appearance_weight: how much the logarithm of the likelihood ratio changes by one unit of distance.
        appearance_limit: its largest value, for and against.
        appearance_absent: and its value where there are no two descriptors to compare: with nothing to say who it is, a
            likely guess is better than a new identity.
        low_score: rows below are not looked at, 0 to 1.
        birth_score: rows from here on may be new objects.
        high_score: rows from here on may continue an object wherever it may be; lower ones only where they overlap it.
        low_overlap: by so much (IoU).
        recent_s: and only if it was seen lately: in the frame before, or so long before that, s.
        safe_overlap: a pair of an object seen lately that overlaps more, and has no rival on either side, is taken
            without asking appearance.
        same_overlap: of two boxes of a frame that overlap more, the one of lower score is left out.
        duplicate_overlap: a box that overlaps a known object's more makes no new object.
        crowd_box: the place of a detection speaks for an object as against one elsewhere in a square of so many boxes,
            at least a thousandth; of what was seen in the frame before, in a larger one where fewer others are.
        place_limit: but however wide the filter, at the expected place it speaks against it by so much at most, as a
            logarithm: the object could be anywhere, and so could the others.
        class_penalty: what another class takes from the logarithm of the likelihood ratio.
        memory_s: an object is kept so long after it was last seen, s.
        tentative_s: one that is not confirmed, or not believed any more because its scores have fallen, s; at least for
            one frame.
        leave_s: one that is believed to have gone out of the picture, s; not one that the camera has moved farther.
        views: how many different descriptors of an object are kept, besides the median of the last three.
        view_apart: they differ by so much, distance.
        view_interval_s: and are kept at most so often, s.
        clean_overlap: a descriptor is kept only if no other detection overlaps its box more,
        hidden_overlap: and no object that is hidden,
        hidden_s: since at most so long, s.
        given_back_rows: an object that is confirmed gets at most so many earlier rows back.
        steady: whether boxes are made steadier, as far as the detector's own noise goes; else they are as detected.
        fill_s: a confirmed object that is seen again after at most so long gets boxes for the frames in which it was
            missed, on the straight line between, s; 0: never. At most 256 frames.
        jolts: whether a jump of the whole picture, of which no camera motion tells, is found from the boxes.
        frame_rate: frames a second where no times are given.
        motion: how objects move.
        evidence: when an object is taken as real.
    """

    appearance: bool = True
    match_threshold: float = 0.7
    appearance_weight: float = 7.0
    appearance_limit: float = 4.0
    appearance_absent: float = 1.5
    low_score: float = 0.1
    birth_score: float = 0.2
    high_score: float = 0.4
    low_overlap: float = 0.3
    recent_s: float = 2.0
    safe_overlap: float = 0.5
    same_overlap: float = 0.6
    duplicate_overlap: float = 0.3
    crowd_box: float = 3.5
    place_limit: float = 1.4
    class_penalty: float = 1.0
    memory_s: float = 8.0
    tentative_s: float = 0.5
    leave_s: float = 0.5
    views: int = 4
    view_apart: float = 0.5
    view_interval_s: float = 0.25
    clean_overlap: float = 0.1
    hidden_overlap: float = 0.1
    hidden_s: float = 3.0
    given_back_rows: int = 256
    steady: bool = True
    fill_s: float = 2.0
    jolts: bool = True
    frame_rate: float = 25.0
    motion: MotionConfig = field(default_factory=MotionConfig)
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)

    def __post_init__(self) -> None:
        check_numbers(self, above_zero=("match_threshold", "frame_rate", "crowd_box", "memory_s", "given_back_rows"))
        for name in _SHARES:
            if getattr(self, name) > 1:
                raise ConfigError(f"{name}={getattr(self, name)}: expected 0 to 1")
        if self.crowd_box < _LEAST_CROWD_BOX:
            raise ConfigError(f"crowd_box={self.crowd_box}: expected at least {_LEAST_CROWD_BOX:g}")
        if self.match_threshold > 2:
            raise ConfigError(f"match_threshold={self.match_threshold}: expected above 0, at most 2")
        if self.views > _MOST_VIEWS:
            raise ConfigError(f"views={self.views}: expected at most {_MOST_VIEWS}")

    @property
    def best_look(self) -> float:
        """The most that appearance adds to the logarithm of the likelihood ratio."""
        return max(self.appearance_limit, self.appearance_absent)


def iou_config() -> DefaultConfig:
    """Settings of the preset ``iou``: overlap and motion only."""
    return DefaultConfig(appearance=False)
