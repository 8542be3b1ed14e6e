"""The method as one page of code: frames -> boxes and descriptors -> identities -> results."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lookonce.camera import CameraMotion, luma_of_canvas
from lookonce.errors import ConfigError
from lookonce.interrupts import interrupts_deferred
from lookonce.letterbox import Fit, Letterboxer
from lookonce.model import Model, ModelMetadata, available_cpus
from lookonce.output import Sink
from lookonce.structures import Detections, Tracks
from lookonce.tracking import DefaultConfig, PaperConfig, Tracker, TrackerConfig
from lookonce.video import Frame, VideoSource, open_video, prefetch

__all__ = [
    "CAMERA_SIZE",
    "CanvasDetector",
    "Detector",
    "ModelFile",
    "StageTimes",
    "TrackedFrame",
    "camera_for",
    "detector_score",
    "share_processors",
    "track",
    "track_video",
    "tracker_for",
]

_PAPERS_SCORE = 0.25  # the usual one of detectors
_FRAMES_AHEAD = 4
CAMERA_SIZE = (384, 640)
"""(height, width) of the pictures in which the camera's motion is looked for, where there is no network."""

_MOST_WORKERS = 4  # each inference in flight holds its own activations in memory


class Detector(Protocol):
    """What finds the objects of a frame: a model, or a file in which another program's detections are kept."""

    @property
    def names(self) -> tuple[str, ...]:
        """Class names, by label."""
        ...

    def detect(self, frame: Frame, /) -> Detections:
        """The objects of one frame."""
        ...


@runtime_checkable
class CanvasDetector(Detector, Protocol):
    """A detector that looks at the picture as a network wants it; at several frames at once, as a :class:`Model` is."""

    @property
    def size(self) -> tuple[int, int]:
        """The network's input (height, width) in px."""
        ...

    def look(self, frame: Frame, canvas: NDArray[np.uint8], placed: Fit, /) -> Detections:
        """The objects of one frame, in its letterboxed picture (height, width, 3) uint8 RGB."""
        ...


class ModelFile(Protocol):
    """What a tracker's settings take from a model file."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def metadata(self) -> ModelMetadata:
        """What it says about itself."""
        ...


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
        workers: how many frames are inferred at once.
        seconds: by stage: decode, letterbox, detect, camera, associate, write.
    """

    frames: int = 0
    workers: int = 1
    seconds: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(("decode", "letterbox", "detect", "camera", "associate", "write"), 0.0)
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
    model: str | os.PathLike[str] | Model = "street",
    tracker: str | Tracker = "default",
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
        model: a model file, the name of one that ships with the package, or an opened :class:`Model`.
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
    with open_video(source, start_s=start_s, end_s=end_s, every=every, fps=fps, max_frames=max_frames) as video:
        workers = 1
        if not isinstance(model, Model):
            threads, workers = share_processors(video.is_live)
            preset = tracker.config if isinstance(tracker, Tracker) else tracker
            model = Model(model, threads=threads, score_threshold=detector_score(preset))
        if not isinstance(tracker, Tracker):
            tracker = tracker_for(model, tracker)
        yield from track_video(video, model, tracker, labels=model.labels_of(classes), workers=workers)


def share_processors(is_live: bool, threads: int | None = None, provider: str = "cpu") -> tuple[int, int]:
    """How many threads one inference gets, and how many frames are inferred at once.

    Two frames side by side use two processors better than two threads on one frame do (`docs/log.md`). A live source
    gets all processors for one frame, because there the delay counts; so does any other provider than the CPU.

    Args:
        is_live: whether the source is.
        threads: for one inference, where the user has chosen.
        provider: where the model runs.
    """
    processors = available_cpus()
    if is_live or provider != "cpu":
        return threads or processors, 1
    workers = min(_MOST_WORKERS, max(1, processors // (threads or 1)))
    return threads or max(1, processors // workers), workers


def detector_score(preset: str | TrackerConfig) -> float:
    """The score from which on a preset wants detections: the stronger ones make use of weak ones.

    Raises:
        ConfigError: there is no such preset.
    """
    config = Tracker(preset).config
    return config.low_score if isinstance(config, DefaultConfig) else _PAPERS_SCORE


def tracker_for(
    model: ModelFile,
    preset: str | TrackerConfig = "default",
    match_threshold: float | None = None,
    *,
    explain: bool = False,
) -> Tracker:
    """A tracker for the descriptors of a model.

    >>> tracker = tracker_for(Model("street"))
    >>> round(tracker.config.match_threshold, 2), Tracker().config.match_threshold
    (0.91, 0.7)

    Args:
        model: a :class:`Model` or :class:`BoxDescriber`.
        preset: ``"default"``, ``"iou"`` or ``"paper"``, or settings such as :class:`DefaultConfig`.
        match_threshold: distance of two descriptors, above 0 to 2, from which they speak against one object; by default
            what the model file says of its own, else the preset's.
        explain: whether :class:`Tracks` carry the story of each frame; it costs time.

    Raises:
        ConfigError: there is no such preset, the threshold is out of range, or the model has no descriptors and the
            preset cannot do without.
    """
    config = Tracker(preset).config
    descriptor = model.metadata.descriptor
    if descriptor is None and isinstance(config, PaperConfig):
        raise ConfigError(f"{model.path}: has no descriptors, which tracker 'paper' needs; import it with them")
    calibrated = None if descriptor is None else descriptor.match_threshold
    threshold = match_threshold if match_threshold is not None else calibrated
    return Tracker(config if threshold is None else replace(config, match_threshold=threshold), explain=explain)


def camera_for(tracker: Tracker, state: Path | None = None) -> CameraMotion | None:
    """What tells a tracker how the camera moves, anew or from a saved state; None for `paper`, which does not use it.

    Raises:
        FormatError: the state is something else, of another version, damaged or cut short.
    """
    if not isinstance(tracker.config, DefaultConfig):
        return None
    return CameraMotion() if state is None else CameraMotion.load(state)


def track_video(
    video: VideoSource,
    model: Detector,
    tracker: Tracker,
    *,
    labels: NDArray[np.int64] | None = None,
    workers: int = 1,
    sinks: Sequence[Sink] = (),
    times: StageTimes | None = None,
    after: int = -1,
    camera: CameraMotion | None = None,
    follows_camera: bool = True,
) -> Iterator[TrackedFrame]:
    """Track the objects of an opened source and write each frame to the sinks as it is done.

    Args:
        video: frames in order.
        model: finds the objects, and describes them if it can; a :class:`Model` or what looks as one does so for
            several frames at once.
        tracker: gives them identities.
        labels: (C,) the classes to keep; none or empty: all.
        workers: how many frames are inferred at once; the results do not depend on it.
        sinks: where results go; the caller closes them.
        times: takes the seconds of each stage.
        after: frames up to this number are passed over, because an earlier run has tracked them.
        camera: goes on with what an earlier run saw; by default it begins.
        follows_camera: whether the tracker is told how the camera moves. A camera that stands still gives the same
            results either way; the preset ``paper`` does not use it.

    Yields:
        A :class:`TrackedFrame` for each frame.
    """
    times = times or StageTimes()
    if not follows_camera:
        camera = None
    elif camera is None:
        camera = camera_for(tracker)
    times.workers = workers
    with _detected(video, model, workers, times, after, needs_luma=camera is not None) as detected:
        for frame, luma, detections in detected:
            with interrupts_deferred():  # tracker and results never differ by a frame
                motion = None
                if camera is not None and luma is not None:
                    with times.stage("camera"):
                        motion = camera.update(luma, detections.xyxy, frame.size, frame.time_s)
                with times.stage("associate"):
                    if labels is not None and len(labels):
                        detections = detections[np.isin(detections.labels, labels)]
                    tracks = tracker.update(detections, frame.time_s, camera=motion, size=frame.size, frame=frame.index)
                    tracks = replace(tracks, names=model.names)
                with times.stage("write"):
                    for sink in sinks:
                        sink.write(frame, tracks)
            times.frames += 1
            yield TrackedFrame(frame, tracks)


@contextmanager
def _detected(
    video: VideoSource, detector: Detector, workers: int, times: StageTimes, after: int, *, needs_luma: bool
) -> Iterator[Iterator[_Detected]]:
    """Frames with their detections, in order; decoding runs ahead."""
    if isinstance(detector, Model | CanvasDetector):
        with prefetch(_letterboxed(video, detector.size, times, after), depth=_FRAMES_AHEAD) as prepared:
            with closing(_detect(prepared, detector, workers, times)) as detected:
                yield detected
    elif needs_luma:
        with prefetch(_letterboxed(video, CAMERA_SIZE, times, after), depth=_FRAMES_AHEAD) as prepared:
            yield ((frame, luma_of_canvas(canvas, fit), detector.detect(frame)) for frame, canvas, fit in prepared)
    else:
        with prefetch(_decoded(video, times, after), depth=_FRAMES_AHEAD) as frames:
            yield ((frame, None, detector.detect(frame)) for frame in frames)


_Detected = tuple[Frame, NDArray[np.uint8] | None, Detections]
_Prepared = tuple[Frame, NDArray[np.uint8], Fit]


def _detect(
    prepared: Iterable[_Prepared], detector: Model | CanvasDetector, workers: int, times: StageTimes
) -> Generator[_Detected]:
    """Frames with their luma and detections, in order; with several workers that many frames are inferred at once."""

    def infer(frame: Frame, canvas: NDArray[np.uint8], placed: Fit) -> tuple[Detections, float]:
        start = time.perf_counter()
        if isinstance(detector, Model):
            found = detector.run(canvas[np.newaxis], [placed])[0]
        else:
            found = detector.look(frame, canvas, placed)
        return found, time.perf_counter() - start

    def finish(waiting: _Prepared, result: tuple[Detections, float]) -> _Detected:
        times.seconds["detect"] += result[1]
        frame, canvas, placed = waiting
        return frame, luma_of_canvas(canvas, placed), result[0]

    if workers == 1:
        for one in prepared:
            yield finish(one, infer(*one))
        return
    pool = ThreadPoolExecutor(workers, thread_name_prefix="lookonce-infer")
    try:
        pending: deque[tuple[_Prepared, Future[tuple[Detections, float]]]] = deque()
        for one in prepared:
            pending.append((one, pool.submit(infer, *one)))
            if len(pending) > workers:  # one more waits, so that no worker does
                first, result = pending.popleft()
                yield finish(first, result.result())
        for last, result in pending:
            yield finish(last, result.result())
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _letterboxed(video: VideoSource, size: tuple[int, int], times: StageTimes, after: int) -> Iterator[_Prepared]:
    """Frames with their pictures as the network wants them; runs in the reading thread."""
    letterbox = Letterboxer(size)
    for frame in _decoded(video, times, after):
        with times.stage("letterbox"):
            canvas, placed = letterbox(frame.picture, frame.rotation)
        yield frame, canvas, placed


def _decoded(video: VideoSource, times: StageTimes, after: int) -> Iterator[Frame]:
    """Frames later than ``after`` as they are; runs in the reading thread."""
    frames = iter(video)
    while True:
        with times.stage("decode"):
            frame = next(frames, None)
        if frame is None:
            return
        if frame.index > after:
            yield frame
