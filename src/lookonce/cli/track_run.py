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
from lookonce.cli.track_detections import (
    DescribedFile,
    open_detections,
    tracker_without_descriptors,
    warn_of_other_frames,
    warn_of_other_pictures,
)
from lookonce.datasets.detections import DetectionFile
from lookonce.errors import ConfigError
from lookonce.make.given_boxes import BoxDescriber
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
from lookonce.video.opening import one_line

__all__ = ["RunOptions", "TrackSettings", "run_tracking"]

SHIPPED_MODEL = "street"
_MOT_FILE, _JSON_FILE, _VIDEO_FILE, _EXPLAIN_FILE = "tracks.txt", "tracks.jsonl", "annotated.mp4", "explain.jsonl"
_USUAL_RATE = 25.0  # frames per second, for sources that do not say theirs
_MOST_HEADER = 1 << 20  # bytes


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """All that the results of a run depend on, besides the files: kept in their header.

    With ``detections`` the objects are those of that file; a ``model`` beside it describes them.
    """

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
        file = detector.file if isinstance(detector, DescribedFile) else detector
        labels = file.labels_of(settings.classes)
        if isinstance(file, DetectionFile):
            warn_of_other_pictures(file, video.size)
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
        screen = RunScreen(video, StageTimes(), _described(detector), detector.names)
        kept = () if video.is_live else (checkpoint,)
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
            screen.print_summary([sink.path for sink in sinks], (folder / CHECKPOINT_FILE).exists())
        if isinstance(file, DetectionFile):
            warn_of_other_frames(file, screen.last_index, settings.end_s is None and settings.max_frames is None)


_Found = Model | DetectionFile | DescribedFile


def _open_detector(
    settings: TrackSettings, config: TrackerConfig, video: VideoSource, options: RunOptions
) -> tuple[_Found, Tracker, int]:
    """What finds the objects, what gives them identities, and how many frames are looked at at once."""
    path = None if settings.detections is None else Path(settings.detections)
    if path is not None and settings.model is None:
        tracker = tracker_without_descriptors(path, config, settings.match_threshold, explain=options.explain)
        return open_detections(path, settings.score), tracker, 1
    per_inference, workers = share_processors(video.is_live, options.threads, settings.provider)
    if path is not None and settings.model is not None:
        describer = BoxDescriber(settings.model, provider=settings.provider, threads=per_inference)
        tracker = tracker_for(describer, config, settings.match_threshold, explain=options.explain)
        return DescribedFile(open_detections(path, settings.score), describer), tracker, workers
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
    has_results = (folder / _JSON_FILE).exists()
    if options.resume and video.is_live and has_results:
        raise ConfigError(f"{video.name}: a live source cannot be gone on with; choose another folder with -o")
    checkpoint = read_checkpoint(folder) if options.resume else None
    if checkpoint is not None and checkpoint.frame >= 0:
        _refuse_other_settings(folder / _JSON_FILE, header)
        if _EXPLAIN_FILE in checkpoint.sizes and not options.explain:
            raise ConfigError(f"{folder}: the run was begun with --explain; give it again, or --overwrite")
        return _Start(checkpoint.frame, dict(checkpoint.sizes), checkpoint.states)
    overwrite = options.overwrite or checkpoint is not None
    if has_results and not overwrite:
        if options.resume:
            raise ConfigError(f"{folder}: the run there is complete; --overwrite makes it again")
        if (folder / CHECKPOINT_FILE).exists():
            raise ConfigError(f"{folder}: has a run that was stopped; --resume goes on, --overwrite begins again")
    files = [_MOT_FILE, _JSON_FILE, _VIDEO_FILE, _EXPLAIN_FILE, CHECKPOINT_FILE]
    prepare_output_folder(folder, files, overwrite)
    if overwrite:
        CheckpointSink.remove(folder)
    if not video.is_live:
        CheckpointSink.begin(folder)
    return _Start()


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


def _described(detector: _Found) -> str:
    """Where the descriptors come from, if not with the boxes."""
    if not isinstance(detector, DescribedFile):
        return ""
    return f"{one_line(detector.describer.path.name)} at the boxes of {one_line(detector.file.path.name)}"


def _header(detector: _Found, settings: dict[str, object]) -> dict[str, object]:
    """What the first line of the JSON file says: enough to make the run again."""
    packages = ("numpy", "onnxruntime", "av")
    return {
        "versions": {"lookonce": __version__, "python": platform.python_version()}
        | {package: version(package) for package in packages},
        **_about(detector),
        "settings": {**settings, "source": without_password(str(settings["source"]))},
    }


def _about(detector: _Found) -> dict[str, object]:
    """The files behind the results: ``model``, ``detections``, or both."""
    if isinstance(detector, DescribedFile):
        describer = detector.describer
        model = {**_file(describer), "size": list(describer.size), "descriptor": asdict(describer.descriptor)}
        return _about(detector.file) | {"model": {**model, "reads": "descriptors at the boxes of the detections"}}
    about = {**_file(detector), "names": list(detector.names)}
    if isinstance(detector, Model):
        descriptor = detector.metadata.descriptor
        return {
            "model": {**about, "size": list(detector.size), "descriptor": asdict(descriptor) if descriptor else None}
        }
    return {"detections": {**about, "left_out": detector.left_out, "score_range": detector.score_range}}


def _file(of: Model | DetectionFile | BoxDescriber) -> dict[str, object]:
    return {"file": of.path.name, "sha256": of.sha256}
