"""One run of `lookonce track`: detector, tracker, results, and going on where an earlier run stopped."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path

from lookonce import __version__
from lookonce.cli.screen import RunScreen
from lookonce.cli.track_detections import open_detections, tracker_without_descriptors, warn_of_other_frames
from lookonce.datasets.detections import DetectionFile
from lookonce.errors import ConfigError
from lookonce.model import Model
from lookonce.output import (
    CHECKPOINT_FILE,
    AnnotatedVideoSink,
    CheckpointSink,
    ExplainSink,
    JsonLinesSink,
    MotSink,
    Sink,
    prepare_output_folder,
    read_checkpoint,
)
from lookonce.pipeline import StageTimes, camera_for, detector_score, share_processors, track_video, tracker_for
from lookonce.tracking import Tracker, TrackerConfig
from lookonce.video import VideoSource, open_video, without_password

__all__ = ["RunOptions", "TrackSettings", "run_tracking"]

SHIPPED_MODEL = "street"
_MOT_FILE, _JSON_FILE, _VIDEO_FILE, _EXPLAIN_FILE = "tracks.txt", "tracks.jsonl", "annotated.mp4", "explain.jsonl"
_USUAL_RATE = 25.0  # frames per second, for sources that do not say theirs
_MOST_HEADER = 1 << 20  # bytes


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """All that the results of a run depend on, besides the files: kept in their header."""

    source: str
    model: str | None
    detections: str | None
    tracker: str
    match_threshold: float | None
    classes: tuple[str, ...]
    score: float | None
    iou: float
    start_s: float
    end_s: float | None
    every: int
    max_frames: int | None
    fps: float | None
    provider: str

    def open_video(self) -> VideoSource:
        """The chosen part of the source."""
        return open_video(
            self.source,
            start_s=self.start_s,
            end_s=self.end_s,
            every=self.every,
            fps=self.fps,
            max_frames=self.max_frames,
        )


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What the results do not depend on.

    Attributes:
        output: folder for the results; None = runs/NAME.
        overwrite: replace earlier results.
        resume: go on with a run that stopped.
        with_video: write the annotated video.
        explain: write why.
        threads: for one inference; None = shared out.
    """

    output: Path | None
    overwrite: bool
    resume: bool
    with_video: bool
    explain: bool
    threads: int | None


@dataclass(frozen=True, slots=True)
class _Start:
    """Where a run begins.

    Attributes:
        after: the last frame that is there already; -1 = none.
        sizes: bytes to keep of each result file; empty for a new run.
        states: files with the states of "tracker" and "camera"; empty for a new run.
    """

    after: int = -1
    sizes: dict[str, int] | None = None
    states: Mapping[str, Path] = field(default_factory=dict)

    def keep(self, name: str) -> int | None:
        """Bytes to keep of a file; None: it is made anew."""
        if self.sizes is None:
            return None
        if name not in self.sizes:
            raise ConfigError(f"{name}: was not written by the run that stopped; go on with the options it had")
        return self.sizes[name]


def run_tracking(settings: TrackSettings, config: TrackerConfig, options: RunOptions) -> None:
    """Track, write the results, and say so.

    Raises:
        LookonceError: an input is wrong.
    """
    with ExitStack() as stack:
        video = stack.enter_context(settings.open_video())
        detector, tracker, workers = _open_detector(settings, config, video, options)
        labels = detector.labels_of(settings.classes)
        header = _header(detector, asdict(settings) | asdict(tracker.config))
        folder = options.output or Path("runs") / video.name
        start = _start(folder, options, header, video)
        if start.states:
            tracker = Tracker.load(start.states["tracker"], explain=options.explain)
        camera = camera_for(tracker, start.states.get("camera"))
        rate = (video.rate or _USUAL_RATE) / settings.every
        sinks = _open_sinks(folder, detector.names, header, rate, options, start)
        for sink in sinks:
            stack.enter_context(sink)
        states = {"tracker": tracker.save} | ({} if camera is None else {"camera": camera.save})
        checkpoint = CheckpointSink(folder, states, lambda: _sizes(sinks))
        if not video.is_live:
            stack.enter_context(checkpoint)
        screen, kept = RunScreen(video, StageTimes()), () if video.is_live else (checkpoint,)
        screen.passed_over = start.after + 1 if start.after >= 0 else 0
        try:
            screen.follow(
                track_video(
                    video,
                    detector,
                    tracker,
                    labels=labels,
                    workers=workers,
                    sinks=[*sinks, *kept],
                    times=screen.times,
                    after=start.after,
                    camera=camera,
                )
            )
            checkpoint.finish()
        finally:
            stack.close()  # results first, then the table
            screen.print_summary([sink.path for sink in sinks])
        if isinstance(detector, DetectionFile):
            warn_of_other_frames(detector, screen.last_index, settings.end_s is None and settings.max_frames is None)


def _open_detector(
    settings: TrackSettings, config: TrackerConfig, video: VideoSource, options: RunOptions
) -> tuple[Model | DetectionFile, Tracker, int]:
    """What finds the objects, what gives them identities, and how many frames are looked at at once."""
    if settings.detections is not None:
        path = Path(settings.detections)
        tracker = tracker_without_descriptors(path, config, settings.match_threshold, explain=options.explain)
        return open_detections(path, settings.score), tracker, 1
    per_inference, workers = share_processors(video.is_live, options.threads, settings.provider)
    model = Model(
        settings.model or SHIPPED_MODEL,
        provider=settings.provider,
        threads=per_inference,
        score_threshold=detector_score(config) if settings.score is None else settings.score,
        iou_threshold=settings.iou,
    )
    return model, tracker_for(model, config, settings.match_threshold, explain=options.explain), workers


def _start(folder: Path, options: RunOptions, header: dict[str, object], video: VideoSource) -> _Start:
    """A new run in a folder that is prepared for it, or the rest of one that stopped."""
    checkpoint = read_checkpoint(folder) if options.resume and not options.overwrite else None
    if checkpoint is None:
        files = [_MOT_FILE, _JSON_FILE, _VIDEO_FILE, _EXPLAIN_FILE, CHECKPOINT_FILE]
        if options.resume and not options.overwrite and (folder / _JSON_FILE).exists():
            raise ConfigError(f"{folder}: the run there is complete; --overwrite makes it again")
        prepare_output_folder(folder, files, options.overwrite)
        if options.overwrite:
            CheckpointSink.remove(folder)
        return _Start()
    if video.is_live:
        raise ConfigError(f"{video.name}: a live source cannot be gone on with; choose another folder with -o")
    _refuse_other_settings(folder / _JSON_FILE, header)
    return _Start(checkpoint.frame, dict(checkpoint.sizes), checkpoint.states)


def _refuse_other_settings(path: Path, header: dict[str, object]) -> None:
    """A run goes on with the settings, the model and the versions that it was begun with."""
    try:
        with path.open("rb") as file:
            before = json.loads(file.readline(_MOST_HEADER))
    except (OSError, ValueError, RecursionError) as exc:
        raise ConfigError(f"{path}: its first line cannot be read; start again with --overwrite") from exc
    now = json.loads(json.dumps(header))
    for part in now:
        then = before.get(part) if isinstance(before, dict) else None
        if then == now[part]:
            continue
        names = [name for name in now[part] if not isinstance(then, dict) or then.get(name) != now[part][name]]
        shown = ", ".join(names) or part
        raise ConfigError(f"{path}: the run was begun with other {part} ({shown}); give the same, or --overwrite")


def _sizes(sinks: list[Sink]) -> dict[str, int]:
    return {sink.path.name: sink.size for sink in sinks if isinstance(sink, MotSink | JsonLinesSink | ExplainSink)}


def _open_sinks(
    folder: Path,
    names: tuple[str, ...],
    header: dict[str, object],
    video_rate: float,
    options: RunOptions,
    start: _Start,
) -> list[Sink]:
    """The files of one run."""
    sinks: list[Sink] = [
        MotSink(folder / _MOT_FILE, start.keep(_MOT_FILE)),
        JsonLinesSink(folder / _JSON_FILE, header, names, start.keep(_JSON_FILE)),
    ]
    if options.explain:
        sinks.append(ExplainSink(folder / _EXPLAIN_FILE, header, start.keep(_EXPLAIN_FILE)))
    if options.with_video:
        path = folder / _VIDEO_FILE
        if start.states:  # a video cannot be appended to
            path = path.with_stem(f"{path.stem}-from-{start.after + 1}")
        sinks.append(AnnotatedVideoSink(path, names, video_rate))
    return sinks


def _header(detector: Model | DetectionFile, settings: dict[str, object]) -> dict[str, object]:
    """What the first line of the JSON file says: enough to make the run again."""
    packages = ("numpy", "onnxruntime", "av")
    about: dict[str, object] = {
        "file": detector.path.name,
        "sha256": detector.sha256,
        "names": list(detector.names),
    }
    if isinstance(detector, Model):
        descriptor = detector.metadata.descriptor
        about["size"] = list(detector.size)
        about["descriptor"] = asdict(descriptor) if descriptor else None
    else:
        about |= {"left_out": detector.left_out, "score_range": detector.score_range}
    return {
        "versions": {"lookonce": __version__, "python": platform.python_version()}
        | {package: version(package) for package in packages},
        "model" if isinstance(detector, Model) else "detections": about,
        "settings": {**settings, "source": without_password(str(settings["source"]))},
    }
