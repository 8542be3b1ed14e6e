"""The method as one page of code: frames -> boxes and descriptors -> identities -> results."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lookonce.letterbox import Fit, Letterboxer
from lookonce.model import Model
from lookonce.output import Sink
from lookonce.structures import Tracks
from lookonce.tracking import PRESETS, Tracker
from lookonce.video import Frame, VideoSource, open_video, prefetch

__all__ = ["StageTimes", "TrackedFrame", "track", "track_video", "tracker_for"]

_FRAMES_AHEAD = 4


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """One frame of a source with its tracks: one row for each detection, ids from 1, -1 = no identity (yet)."""

    frame: Frame
    tracks: Tracks

    @property
    def index(self) -> int:
        """The frame's number in the source, from 0."""
        return self.frame.index

    @property
    def time_s(self) -> float:
        """Seconds on the source's clock."""
        return self.frame.time_s

    @property
    def image(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB, converted when it is asked for."""
        return self.frame.image


@dataclass(slots=True)
class StageTimes:
    """Seconds spent in each stage of a run; decoding and letterboxing run beside the others.

    Attributes:
        frames: how many frames went through.
        seconds: by stage: decode, letterbox, detect, associate, write.
    """

    frames: int = 0
    seconds: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(("decode", "letterbox", "detect", "associate", "write"), 0.0)
    )

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - start


def track(
    source: str | int | os.PathLike[str],
    model: str | os.PathLike[str] | Model,
    tracker: str | Tracker = "paper",
    *,
    classes: Sequence[str | int] = (),
    start_s: float = 0.0,
    end_s: float | None = None,
    every: int = 1,
    fps: float | None = None,
    max_frames: int | None = None,
) -> Iterator[TrackedFrame]:
    """Track the objects of a video: the one-liner.

    Args:
        source: a video file, image folder, glob, camera number or URL.
        model: a model file, its name, or an opened :class:`Model`.
        tracker: a preset's name or a :class:`Tracker`.
        classes: names or numbers of the classes to track; all by default.
        start_s: leave out what comes before, seconds.
        end_s: stop at this time, seconds.
        every: take every n-th frame only.
        fps: frames per second of an image folder.
        max_frames: stop after so many frames.

    Yields:
        A :class:`TrackedFrame` for each frame, as soon as it is done.

    Raises:
        LookonceError: an input is wrong; the message is one line with the remedy.
    """
    if not isinstance(model, Model):
        model = Model(model)
    if not isinstance(tracker, Tracker):
        tracker = tracker_for(model, tracker)
    labels = model.labels_of(classes)
    with open_video(source, start_s=start_s, end_s=end_s, every=every, fps=fps, max_frames=max_frames) as video:
        yield from track_video(video, model, tracker, labels=labels)


def tracker_for(model: Model, preset: str = "paper", match_threshold: float | None = None) -> Tracker:
    """A tracker with a preset's settings; the threshold as given, else as calibrated for the model, else the preset's.

    Raises:
        ConfigError: there is no such preset, or the threshold is out of range.
    """
    tracker = Tracker(preset)
    calibrated = model.metadata.descriptor.match_threshold if model.metadata.descriptor else None
    threshold = match_threshold if match_threshold is not None else calibrated
    return tracker if threshold is None else Tracker(replace(PRESETS[preset](), match_threshold=threshold))


def track_video(
    video: VideoSource,
    model: Model,
    tracker: Tracker,
    *,
    labels: NDArray[np.int64] | None = None,
    sinks: Sequence[Sink] = (),
    times: StageTimes | None = None,
) -> Iterator[TrackedFrame]:
    """Track the objects of an opened source and write each frame to the sinks as it is done.

    Args:
        video: frames in order.
        model: finds and describes the objects.
        tracker: gives them identities.
        labels: (C,) the classes to keep; none or empty: all.
        sinks: where results go; the caller closes them.
        times: takes the seconds of each stage.

    Yields:
        A :class:`TrackedFrame` for each frame.
    """
    times = times or StageTimes()
    with prefetch(_letterboxed(video, model.size, times), depth=_FRAMES_AHEAD) as prepared:
        for frame, canvas, placed in prepared:
            with times.stage("detect"):
                detections = model.run(canvas[np.newaxis], [placed])[0]
            with times.stage("associate"):
                if labels is not None and len(labels):
                    detections = detections[np.isin(detections.labels, labels)]
                tracks = replace(tracker.update(detections, frame.time_s), names=model.names)
            with times.stage("write"):
                for sink in sinks:
                    sink.write(frame, tracks)
            times.frames += 1
            yield TrackedFrame(frame, tracks)


def _letterboxed(
    video: VideoSource, size: tuple[int, int], times: StageTimes
) -> Iterator[tuple[Frame, NDArray[np.uint8], Fit]]:
    """Frames with their pictures as the network wants them; runs in the reading thread."""
    letterbox = Letterboxer(size)
    frames = iter(video)
    while True:
        with times.stage("decode"):
            frame = next(frames, None)
        if frame is None:
            return
        with times.stage("letterbox"):
            canvas, placed = letterbox(frame.picture, frame.rotation)
        yield frame, canvas, placed
