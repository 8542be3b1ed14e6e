"""`lookonce track`."""

from __future__ import annotations

import platform
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from lookonce import __version__
from lookonce.model import Model
from lookonce.output import AnnotatedVideoSink, JsonLinesSink, MotSink, Sink, prepare_output_folder
from lookonce.pipeline import StageTimes, TrackedFrame, share_processors, track_video, tracker_for
from lookonce.structures import NO_ID
from lookonce.tracking import Tracker
from lookonce.video import VideoSource, open_video, without_password

__all__ = ["track_command"]

_MOT_FILE, _JSON_FILE, _VIDEO_FILE = "tracks.txt", "tracks.jsonl", "annotated.mp4"
_LINE_EVERY_S = 30.0
_USUAL_RATE = 25.0  # frames per second, for sources that do not say theirs

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce track traffic.mp4 -m model.onnx

  lookonce track traffic.mp4 -m model.onnx --classes car,bus,truck --score 0.3 -o out/

  lookonce track MOT17-02/ -m model.onnx --no-video          (an image folder; MOT and UA-DETRAC layouts too)

  lookonce track 0 -m model.onnx                             (a camera; Ctrl-C ends it, results stay)

  lookonce track rtsp://user:password@camera/stream -m model.onnx --max-frames 1000
"""


def track_command(
    source: Annotated[
        str,
        typer.Argument(metavar="SOURCE", help="Video file, image folder, glob, camera (0) or URL.", show_default=False),
    ],
    model: Annotated[str, typer.Option("-m", "--model", help="Model file.", show_default=False)],
    tracker: Annotated[str, typer.Option(help="Tracking preset: paper.")] = "paper",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for the results.", show_default="runs/NAME")
    ] = None,
    classes: Annotated[
        str, typer.Option(help="Track these classes only, names separated by commas.", show_default="all")
    ] = "",
    score: Annotated[float, typer.Option(help="Keep detections above this score.", min=0, max=1)] = 0.25,
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
    video: Annotated[bool, typer.Option("--video/--no-video", help="Write the annotated video.")] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace earlier results in the folder.")] = False,
    provider: Annotated[str, typer.Option(help="Where the model runs: cpu, cuda or openvino.")] = "cpu",
    threads: Annotated[
        int | None, typer.Option(help="Threads for one inference.", show_default="shared out", min=1)
    ] = None,
) -> None:
    """Track the objects of a video: writes tracks.txt (MOT), tracks.jsonl and annotated.mp4."""
    with ExitStack() as stack:
        frames = stack.enter_context(
            open_video(source, start_s=start, end_s=end, every=every, fps=fps, max_frames=max_frames)
        )
        per_inference, workers = share_processors(frames.is_live, threads, provider)
        opened = Model(model, provider=provider, threads=per_inference, score_threshold=score, iou_threshold=overlap)
        labels = opened.labels_of([name for name in classes.split(",") if name.strip()])
        chosen = tracker_for(opened, tracker, match_threshold)
        header = _header(without_password(source), opened, tracker, chosen, classes)
        rate = (frames.rate or _USUAL_RATE) / every if video else None
        sinks = _open_sinks(output or Path("runs") / frames.name, overwrite, opened, header, rate)
        for sink in sinks:
            stack.enter_context(sink)
        run = _Run(frames, StageTimes())
        try:
            run.follow(
                track_video(frames, opened, chosen, labels=labels, workers=workers, sinks=sinks, times=run.times)
            )
        finally:
            stack.close()  # results first, then the table
            run.print_summary([sink.path for sink in sinks])


track_command.__doc__ = f"{track_command.__doc__}\n{_EXAMPLES}"


def _open_sinks(
    folder: Path, overwrite: bool, model: Model, header: dict[str, object], video_rate: float | None
) -> list[Sink]:
    """The files of one run; without a rate no video. Earlier results of any kind are in the way, or replaced."""
    prepare_output_folder(folder, [_MOT_FILE, _JSON_FILE, _VIDEO_FILE], overwrite)
    sinks: list[Sink] = [MotSink(folder / _MOT_FILE), JsonLinesSink(folder / _JSON_FILE, header, model.names)]
    if video_rate is not None:
        sinks.append(AnnotatedVideoSink(folder / _VIDEO_FILE, model.names, video_rate))
    return sinks


class _Run:
    """One run on the screen: progress while it goes, a table when it ends, however it ends."""

    def __init__(self, video: VideoSource, times: StageTimes) -> None:
        self.video = video
        self.times = times
        self.identities = 0
        self.seconds = 0.0

    def follow(self, frames: Iterator[TrackedFrame]) -> None:
        """Consume the frames, showing progress on stderr: a bar on a terminal, a line now and then elsewhere."""
        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]:.1f} fps"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        start, last_line_s = time.perf_counter(), 0.0
        with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
            task = progress.add_task(self.video.name, total=self.video.frame_count, rate=0.0)
            try:
                for frame in frames:
                    self._count(frame)
                    self.seconds = time.perf_counter() - start
                    progress.update(task, advance=1, rate=self.times.frames / self.seconds)
                    if not console.is_terminal and self.seconds - last_line_s >= _LINE_EVERY_S:
                        last_line_s = self.seconds
                        console.print(self._line(), soft_wrap=True)
            finally:
                self.seconds = time.perf_counter() - start

    def _line(self) -> str:
        """Progress in one line, such as ``traffic: 1200 of 9000 frames, 58.1 fps, 134 s left``."""
        done, total, rate = self.times.frames, self.video.frame_count, self.times.frames / self.seconds
        if not total:
            return f"{self.video.name}: {done} frames, {rate:.1f} fps"
        return f"{self.video.name}: {done} of {total} frames, {rate:.1f} fps, {max(0, total - done) / rate:.0f} s left"

    def _count(self, frame: TrackedFrame) -> None:
        self.identities = max(self.identities, int(frame.tracks.ids.max(initial=NO_ID)))

    def print_summary(self, files: list[Path]) -> None:
        """One table: frames, frames a second of each stage, identities, files."""
        table = Table(title=self.video.name, show_header=False, title_justify="left")
        rate = self.times.frames / self.seconds if self.seconds else 0.0
        table.add_row("frames", f"{self.times.frames} in {self.seconds:.1f} s, {rate:.1f} fps")
        for stage, seconds in self.times.seconds.items():
            if seconds > 0:
                each = seconds / max(1, self.times.frames)
                side_by_side = self.times.workers if stage == "detect" else 1
                note = f", {side_by_side} at once" if side_by_side > 1 else ""
                table.add_row(stage, f"{side_by_side / each:.1f} fps ({each * 1000:.2f} ms a frame{note})")
        table.add_row("identities", str(self.identities))
        for path in files:
            table.add_row("written", str(path))
        Console().print(table)


def _header(source: str, model: Model, preset: str, tracker: Tracker, classes: str) -> dict[str, object]:
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
        "settings": {
            "source": source,
            "classes": [name.strip() for name in classes.split(",") if name.strip()],
            "score": model.score_threshold,
            "iou": model.iou_threshold,
            "tracker": preset,
            **asdict(tracker.config),
        },
    }
