"""`lookonce track`."""

from __future__ import annotations

import platform
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from lookonce import __version__
from lookonce.cli.screen import RunScreen
from lookonce.model import Model
from lookonce.output import AnnotatedVideoSink, ExplainSink, JsonLinesSink, MotSink, Sink, prepare_output_folder
from lookonce.pipeline import StageTimes, detector_score, share_processors, track_video, tracker_for
from lookonce.video import VideoSource, open_video, without_password

__all__ = ["track_command"]

_MOT_FILE, _JSON_FILE, _VIDEO_FILE, _EXPLAIN_FILE = "tracks.txt", "tracks.jsonl", "annotated.mp4", "explain.jsonl"
_USUAL_RATE = 25.0  # frames per second, for sources that do not say theirs

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce track traffic.mp4                                 (with the model that ships: street)

  lookonce track traffic.mp4 -m model.onnx --classes car,bus,truck --score 0.3 -o out/

  lookonce track MOT17-02/ -m model.onnx --no-video          (an image folder; MOT and UA-DETRAC layouts too)

  lookonce track 0 -m model.onnx                             (a camera; Ctrl-C ends it, results stay)

  lookonce track rtsp://user:password@camera/stream -m model.onnx --max-frames 1000
"""


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """All that the results of a run depend on, besides the files: kept in their header."""

    source: str
    model: str
    tracker: str
    match_threshold: float | None
    classes: tuple[str, ...]
    score: float
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


def track_command(
    source: Annotated[
        str,
        typer.Argument(metavar="SOURCE", help="Video file, image folder, glob, camera (0) or URL.", show_default=False),
    ],
    model: Annotated[
        str, typer.Option("-m", "--model", help="Model file, or the name of one that ships with the package.")
    ] = "street",
    tracker: Annotated[
        str, typer.Option(help="Tracking preset: default, iou (overlap and motion only) or paper.")
    ] = "default",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for the results.", show_default="runs/NAME")
    ] = None,
    classes: Annotated[
        str, typer.Option(help="Track these classes only, names separated by commas.", show_default="all")
    ] = "",
    score: Annotated[
        float | None,
        typer.Option(help="Keep detections above this score.", min=0, max=1, show_default="0.1; paper: 0.25"),
    ] = None,
    overlap: Annotated[
        float, typer.Option("--iou", help="Of two boxes of a class that overlap more, drop the weaker.", min=0, max=1)
    ] = 0.45,
    match_threshold: Annotated[
        float | None,
        typer.Option(help="Largest descriptor distance for one object, up to 2.", show_default="from the model"),
    ] = None,
    start: Annotated[float, typer.Option(help="Begin at this time, seconds.", min=0)] = 0.0,
    end: Annotated[float | None, typer.Option(help="Stop at this time, seconds.", show_default="at the end")] = None,
    every: Annotated[int, typer.Option(help="Take every n-th frame only.", min=1)] = 1,
    max_frames: Annotated[int | None, typer.Option(help="Stop after so many frames.", min=1)] = None,
    fps: Annotated[
        float | None, typer.Option(help="Frame rate of an image folder.", show_default="seqinfo.ini's, else 25")
    ] = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Write explain.jsonl: why each detection got its id (lookonce explain).")
    ] = False,
    video: Annotated[bool, typer.Option("--video/--no-video", help="Write the annotated video.")] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace earlier results in the folder.")] = False,
    provider: Annotated[str, typer.Option(help="Where the model runs: cpu, cuda or openvino.")] = "cpu",
    threads: Annotated[
        int | None, typer.Option(help="Threads for one inference.", show_default="shared out", min=1)
    ] = None,
) -> None:
    """Track the objects of a video: writes tracks.txt (MOT), tracks.jsonl and annotated.mp4."""
    settings = TrackSettings(
        source=source,
        model=model,
        tracker=tracker,
        match_threshold=match_threshold,
        classes=tuple(name.strip() for name in classes.split(",") if name.strip()),
        score=detector_score(tracker) if score is None else score,
        iou=overlap,
        start_s=start,
        end_s=end,
        every=every,
        max_frames=max_frames,
        fps=fps,
        provider=provider,
    )
    _run(settings, output, overwrite=overwrite, with_video=video, explain=explain, threads=threads)


track_command.__doc__ = f"{track_command.__doc__}\n{_EXAMPLES}"


def _run(
    settings: TrackSettings,
    output: Path | None,
    *,
    overwrite: bool,
    with_video: bool,
    explain: bool,
    threads: int | None,
) -> None:
    with ExitStack() as stack:
        video = stack.enter_context(settings.open_video())
        per_inference, workers = share_processors(video.is_live, threads, settings.provider)
        model = Model(
            settings.model,
            provider=settings.provider,
            threads=per_inference,
            score_threshold=settings.score,
            iou_threshold=settings.iou,
        )
        labels = model.labels_of(settings.classes)
        tracker = tracker_for(model, settings.tracker, settings.match_threshold, explain=explain)
        header = _header(model, asdict(settings) | asdict(tracker.config))
        rate = (video.rate or _USUAL_RATE) / settings.every if with_video else None
        sinks = _open_sinks(output or Path("runs") / video.name, overwrite, model, header, rate, explain)
        for sink in sinks:
            stack.enter_context(sink)
        screen = RunScreen(video, StageTimes())
        try:
            screen.follow(
                track_video(video, model, tracker, labels=labels, workers=workers, sinks=sinks, times=screen.times)
            )
        finally:
            stack.close()  # results first, then the table
            screen.print_summary([sink.path for sink in sinks])


def _open_sinks(
    folder: Path,
    overwrite: bool,
    model: Model,
    header: dict[str, object],
    video_rate: float | None,
    explain: bool,
) -> list[Sink]:
    """The files of one run; without a rate no video. Earlier results of any kind are in the way, or replaced."""
    prepare_output_folder(folder, [_MOT_FILE, _JSON_FILE, _VIDEO_FILE, _EXPLAIN_FILE], overwrite)
    sinks: list[Sink] = [MotSink(folder / _MOT_FILE), JsonLinesSink(folder / _JSON_FILE, header, model.names)]
    if explain:
        sinks.append(ExplainSink(folder / _EXPLAIN_FILE, header))
    if video_rate is not None:
        sinks.append(AnnotatedVideoSink(folder / _VIDEO_FILE, model.names, video_rate))
    return sinks


def _header(model: Model, settings: dict[str, object]) -> dict[str, object]:
    """What the first line of the JSON file says: enough to make the run again."""
    packages = ("numpy", "onnxruntime", "av")
    return {
        "versions": {"lookonce": __version__, "python": platform.python_version()}
        | {package: version(package) for package in packages},
        "model": {
            "file": model.path.name,
            "sha256": model.sha256,
            "names": list(model.names),
            "size": list(model.size),
            "descriptor": asdict(model.metadata.descriptor) if model.metadata.descriptor else None,
        },
        "settings": {**settings, "source": without_password(str(settings["source"]))},
    }
