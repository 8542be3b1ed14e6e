"""Which trackers there are, what each needs, and what it is given."""

from __future__ import annotations

import importlib.metadata
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.associated import Associated
from lookonce.compare.contenders.boxes_only import (
    associate_botsort,
    associate_bytetrack,
    associate_cbiou,
    associate_ocsort,
    associate_sort,
)
from lookonce.compare.contenders.flow import associate_gog
from lookonce.compare.contenders.iou import associate_iou, associate_kiou
from lookonce.compare.contenders.presets import associate_preset, needs_descriptors
from lookonce.compare.contenders.stone_soup import associate_jpda, associate_mht
from lookonce.compare.contenders.visual_sort import associate_visual_sort
from lookonce.compare.detections import DetectedSequence
from lookonce.tracking import PRESETS, DefaultConfig

__all__ = ["CROPS", "PLAIN_SCORE", "Contender", "contenders"]

PLAIN_SCORE = 0.25
"""Trackers without a score threshold of their own get detections from this on, as ``lookonce track`` gives them."""

CROPS = "crops"
"""The name of the tracker whose descriptors come from a second network, run on every cut-out box."""


_APPEARANCE = "appearance"  # the setting of a preset that can do without descriptors, but uses them
_FLOW = ("ortools", "ortools")
_SOUP = ("stonesoup", "stonesoup")
_TRACKERS = ("trackers", "trackers")
_SIMILARI = ("similari-trackers-rs", "similari")


@dataclass(frozen=True, slots=True)
class Contender:
    """A tracker of the comparison.

    Attributes:
        name: to choose it by.
        title: in tables.
        associate: all detections of a sequence -> id of each row, below 0 = none; or more than ids.
        needs_descriptors: whether it can do nothing without.
        uses_descriptors: whether it looks at them where there are any.
        has_own_threshold: whether it looks at scores itself; if not, it gets detections from ``PLAIN_SCORE`` on.
        is_online: whether it answers frame by frame.
        follows_camera: whether it takes into account how the camera moved.
        needs: the package that has to be installed, and its module; "" = our own.
    """

    name: str
    title: str
    associate: Callable[[DetectedSequence], NDArray[np.int64] | Associated]
    needs_descriptors: bool = False
    uses_descriptors: bool = False
    has_own_threshold: bool = True
    is_online: bool = True
    follows_camera: bool = False
    needs: tuple[str, str] = ("", "")

    def answer(self, sequence: DetectedSequence) -> Associated:
        """What it makes of all detections of a sequence."""
        return Associated.of(sequence, self.associate(sequence))

    @property
    def package(self) -> str:
        """On PyPI; "" = our own."""
        return self.needs[0]

    @property
    def is_installed(self) -> bool:
        """Whether it can run here."""
        return not self.package or importlib.util.find_spec(self.needs[1]) is not None

    @property
    def version(self) -> str:
        """Of its package; "" for our own, and where it is not installed."""
        return importlib.metadata.version(self.package) if self.package and self.is_installed else ""


def contenders() -> dict[str, Contender]:
    """All trackers by name, in the order of the tables; of our own presets whatever there are."""
    paper = partial(associate_preset, "paper")
    found = [
        Contender("gog", "GOG (min-cost flow)", associate_gog, is_online=False, needs=_FLOW),
        Contender("iou", "IOU", associate_iou),
        Contender("kiou", "KIOU", associate_kiou),
        Contender("jpda", "JPDA", associate_jpda, has_own_threshold=False, needs=_SOUP),
        Contender("mht", "MHT (multi-frame assignment)", associate_mht, has_own_threshold=False, needs=_SOUP),
        Contender("sort", "SORT", associate_sort, needs=_TRACKERS),
        Contender("bytetrack", "ByteTrack", associate_bytetrack, needs=_TRACKERS),
        Contender("ocsort", "OC-SORT", associate_ocsort, needs=_TRACKERS),
        Contender("botsort", "BoT-SORT", associate_botsort, needs=_TRACKERS),
        Contender("cbiou", "C-BIoU", associate_cbiou, needs=_TRACKERS),
        Contender(
            "visualsort", "VisualSort", associate_visual_sort, True, True, has_own_threshold=False, needs=_SIMILARI
        ),
        Contender(CROPS, "crop network + rule paper", paper, True, True, has_own_threshold=False),
    ]
    found += [_preset(name) for name in PRESETS]
    found.append(_as_detected())
    return {one.name: one for one in found}


def _preset(name: str) -> Contender:
    config = PRESETS[name]()
    is_needy = needs_descriptors(name)
    return Contender(
        f"lookonce-{name}",
        f"lookonce {name}",
        partial(associate_preset, name),
        is_needy,
        is_needy or bool(getattr(config, _APPEARANCE, False)),
        has_own_threshold=any("score" in field.name for field in fields(config)),
        follows_camera=isinstance(config, DefaultConfig),
    )


def _as_detected() -> Contender:
    """The preset ``default`` as far as it says who is who: no boxes but the detections', as for the other trackers."""
    name, title = "lookonce-detected", "lookonce default, boxes as detected"
    associate = partial(associate_preset, "default", makes_boxes=False)
    return replace(_preset("default"), name=name, title=title, associate=associate)
