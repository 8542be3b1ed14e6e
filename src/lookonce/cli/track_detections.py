"""Detections from a file, for `lookonce track --detections`; with a model, its descriptors are read at their boxes."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets.detections import DetectionFile, read_detections
from lookonce.errors import ConfigError
from lookonce.letterbox import Fit
from lookonce.make.given_boxes import BoxDescriber
from lookonce.structures import Detections
from lookonce.tracking import PaperConfig, Tracker, TrackerConfig
from lookonce.video import Frame
from lookonce.video.opening import one_line

__all__ = [
    "DescribedFile",
    "open_detections",
    "tracker_without_descriptors",
    "warn_of_other_frames",
    "warn_of_other_pictures",
]

log = logging.getLogger(__name__)

_BEYOND = 0.1  # of the picture's width or height: objects reach so far out of it now and then,
_MANY = 0.2  # but not so many of them


@dataclass(frozen=True, slots=True)
class DescribedFile:
    """The detections of a file, with the descriptors of a model at their boxes.

    Attributes:
        file: the detections; classes are its own.
        describer: reads the descriptors.
    """

    file: DetectionFile
    describer: BoxDescriber

    @property
    def names(self) -> tuple[str, ...]:
        """Class names, by label."""
        return self.file.names

    @property
    def size(self) -> tuple[int, int]:
        """The network's input (height, width) in px."""
        return self.describer.size

    def detect(self, frame: Frame) -> Detections:
        """The detections of a frame of the video that the file belongs to."""
        found = self.file.detect(frame)
        return replace(found, descriptors=self.describer(frame, found.xyxy))

    def look(self, frame: Frame, canvas: NDArray[np.uint8], placed: Fit) -> Detections:
        """The same, in the frame's letterboxed picture."""
        found = self.file.detect(frame)
        return replace(found, descriptors=self.describer.read(canvas, placed, found.xyxy))


def open_detections(path: Path, score: float | None) -> DetectionFile:
    """A file of detections above a score (None: all); what was left out or changed is said.

    Raises:
        FormatError: it breaks its format.
    """
    found = read_detections(path)
    if found.left_out:
        counts = ", ".join(f"{count:,} {why}" for why, count in sorted(found.left_out.items()))
        log.warning("%s: rows left out: %s", one_line(path), counts)
    if found.score_range is not None:
        least, greatest = found.score_range
        log.warning("%s: scores from %g to %g are taken as 0 to 1", one_line(path), least, greatest)
    return found if score is None else found.above(score)


def tracker_without_descriptors(
    path: Path, config: TrackerConfig, match_threshold: float | None, *, explain: bool = False
) -> Tracker:
    """A tracker with these settings.

    Raises:
        ConfigError: it cannot do without descriptors.
    """
    if isinstance(config, PaperConfig):
        message = "has no descriptors, which tracker 'paper' needs; name a model that reads them with -m"
        raise ConfigError(f"{one_line(path)}: {message}, or take the preset default")
    if match_threshold is not None:
        message = "has no descriptors for --match-threshold to be held against; name a model that reads them with -m"
        raise ConfigError(f"{one_line(path)}: {message}, or leave it out")
    return Tracker(config, explain=explain)


def warn_of_other_pictures(detections: DetectionFile, size: tuple[int, int] | None) -> None:
    """Says that many boxes lie beyond the picture of ``size`` (height, width): of another layout, or another video."""
    if size is None or not len(detections):
        return
    (height, width), xyxy = size, detections.rows.xyxy
    beyond = np.maximum(xyxy[:, 2] - width, -xyxy[:, 0]) > _BEYOND * width
    beyond |= np.maximum(xyxy[:, 3] - height, -xyxy[:, 1]) > _BEYOND * height
    share = float(beyond.mean())
    if share > _MANY:
        said = "%s: %.0f %% of the boxes reach far beyond the picture of %d x %d px; expected left, top, width, height"
        log.warning(said, one_line(detections.path), 100 * share, width, height)


def warn_of_other_frames(detections: DetectionFile, last_index: int | None, is_whole: bool) -> None:
    """Says that the file and the video end with different frames.

    Args:
        detections: the file.
        last_index: of the last frame that was tracked, from 0; None without any.
        is_whole: whether the video was read to its end.
    """
    last = detections.last_frame
    if last_index is None:
        return
    shown = one_line(detections.path)
    if last is None:
        log.warning("%s: holds no detections", shown)
    elif last < last_index:
        log.warning("%s: ends with frame %d; none are found in the frames up to %d", shown, last + 1, last_index + 1)
    elif last > last_index and is_whole:
        log.warning("%s: goes on to frame %d, but the video ends with frame %d", shown, last + 1, last_index + 1)
