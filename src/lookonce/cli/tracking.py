"""`lookonce track`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lookonce.cli.track_run import SHIPPED_MODEL, RunOptions, TrackSettings, run_tracking
from lookonce.pipeline import detector_score
from lookonce.tracking.settings import choose_tracker

__all__ = ["track_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce track traffic.mp4                                 (with the model that ships: street)

  lookonce track traffic.mp4 -m model.onnx --classes car,bus,truck --score 0.3 -o out/

  lookonce track MOT17-02/ -m model.onnx --no-video          (an image folder; MOT and UA-DETRAC layouts too)

  lookonce track traffic.mp4 --resume                        (goes on where Ctrl-C or a kill stopped it)

  lookonce track traffic.mp4 --explain -o out/               (then: lookonce explain out/ --id 7)

  lookonce track traffic.mp4 --tracker mine.toml --set memory_s=4        (a file of settings: lookonce settings)

  lookonce track MOT17-02/img1 --detections MOT17-02/det/det.txt         (another detector's boxes, no model)

  lookonce track MOT17-02/img1 --detections MOT17-02/det/det.txt -m street     (with street's descriptors at them)

  lookonce track 0 -m model.onnx                             (a camera; Ctrl-C ends it, results stay)

  lookonce track rtsp://user:password@camera/stream -m model.onnx --max-frames 1000
"""

_Source = Annotated[
    str | None,
    typer.Argument(metavar="SOURCE", help="Video file, image folder, glob, camera (0) or URL.", show_default=False),
]
_Named = Annotated[str | None, typer.Option("--source", help="The same as SOURCE.", show_default=False)]
_Model = Annotated[
    str | None,
    typer.Option(
        "-m",
        "--model",
        help="Model file, or the name of one that ships with the package. With --detections it describes their boxes.",
        show_default=f"{SHIPPED_MODEL}; --detections: none",
    ),
]
_Detections = Annotated[
    Path | None,
    typer.Option(
        "--detections",
        metavar="FILE",
        help="Take boxes from this file instead of a model: MOT or UA-DETRAC text, or a tracks.jsonl. "
        "With -m, each is tracked with that model's descriptor.",
    ),
]
_Tracker = Annotated[
    str, typer.Option(help="Preset: default, iou (overlap and motion only) or paper; or a TOML file of settings.")
]
_Changes = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Change a setting of the tracker; may be repeated."),
]
_Output = Annotated[
    Path | None, typer.Option("-o", "--output", help="Folder for the results.", show_default="runs/NAME")
]
_Classes = Annotated[str, typer.Option(help="Track these classes only, names separated by commas.", show_default="all")]
_Score = Annotated[
    float | None,
    typer.Option(
        help="Keep detections above this score.", min=0, max=1, show_default="0.1; paper: 0.25; --detections: all"
    ),
]
_Overlap = Annotated[
    float, typer.Option("--iou", help="Of two boxes of a class that overlap more, drop the weaker.", min=0, max=1)
]
_Threshold = Annotated[
    float | None,
    typer.Option(help="Largest descriptor distance for one object, up to 2.", show_default="from the model"),
]
_End = Annotated[float | None, typer.Option(help="Stop at this time, seconds.", show_default="at the end")]
_Fps = Annotated[
    float | None, typer.Option(help="Frame rate of an image folder.", show_default="seqinfo.ini's, else 25")
]
_Explain = Annotated[
    bool, typer.Option("--explain", help="Write explain.jsonl: why each detection got its id (lookonce explain).")
]
_Threads = Annotated[int | None, typer.Option(help="Threads for one inference.", show_default="shared out", min=1)]


def track_command(
    source: _Source = None,
    named_source: _Named = None,
    model: _Model = None,
    detections: _Detections = None,
    tracker: _Tracker = "default",
    changes: _Changes = None,
    output: _Output = None,
    classes: _Classes = "",
    score: _Score = None,
    overlap: _Overlap = 0.45,
    match_threshold: _Threshold = None,
    start: Annotated[float, typer.Option(help="Begin at this time, seconds.", min=0)] = 0.0,
    end: _End = None,
    every: Annotated[int, typer.Option(help="Take every n-th frame only.", min=1)] = 1,
    max_frames: Annotated[int | None, typer.Option(help="Stop after so many frames.", min=1)] = None,
    fps: _Fps = None,
    explain: _Explain = False,
    video: Annotated[bool, typer.Option("--video/--no-video", help="Write the annotated video.")] = True,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a run that was stopped.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace earlier results in the folder.")] = False,
    provider: Annotated[str, typer.Option(help="Where the model runs: cpu, cuda or openvino.")] = "cpu",
    threads: _Threads = None,
) -> None:
    """Track the objects of a video: writes tracks.txt (MOT), tracks.jsonl and annotated.mp4."""
    if resume and overwrite:
        raise typer.BadParameter("give --resume or --overwrite, not both", param_hint="--resume")
    if (source is None) == (named_source is None):
        raise typer.BadParameter("give one: a video file, image folder, glob, camera or URL", param_hint="SOURCE")
    chosen = choose_tracker(tracker, changes or ())
    has_descriptors = detections is None or model is not None  # else a file of settings names its threshold in vain
    if score is None and detections is None:
        score = detector_score(chosen.config)
    settings = TrackSettings(
        source=source or named_source or "",
        model=model if detections is not None else model or SHIPPED_MODEL,
        detections=None if detections is None else str(detections),
        tracker=tracker,
        match_threshold=chosen.threshold(match_threshold) if has_descriptors else match_threshold,
        classes=tuple(name.strip() for name in classes.split(",") if name.strip()),
        score=score,
        iou=overlap,
        start_s=start,
        end_s=end,
        every=every,
        max_frames=max_frames,
        fps=fps,
        provider=provider,
    )
    run_tracking(settings, chosen.config, RunOptions(output, overwrite, resume, video, explain, threads))


track_command.__doc__ = f"{track_command.__doc__}\n{_EXAMPLES}"
