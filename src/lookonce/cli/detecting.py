"""`lookonce train-detector`."""

from __future__ import annotations

import time
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lookonce.cli.importing import parse_size
from lookonce.cli.stages import StageScreen
from lookonce.config import read_settings
from lookonce.datasets import (
    LabelledSequence,
    LabelledStills,
    open_sequences,
    open_stills,
    read_class_names,
    usual_name,
)
from lookonce.errors import ConfigError, OutputError
from lookonce.model import Model

if TYPE_CHECKING:
    from lookonce.make.detector.gather import DetectorData
    from lookonce.make.detector.settings import DetectorConfig
    from lookonce.make.detector.train import DetectorResult, NetworkSource

__all__ = ["train_detector_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  Pictures with YOLO labels, a network from random weights:

  lookonce train-detector pictures/ --net yolov3-tiny.cfg --change-classes -o detector.onnx

  UA-DETRAC or MOTChallenge sequences beside them, starting from published weights:

  lookonce train-detector pictures/ DETRAC/ --net yolov4-tiny.cfg --weights yolov4-tiny.weights
  --weights-names coco.names --change-classes -o detector.onnx

  Unlabelled video, labelled by another model:

  lookonce train-detector pictures/ --video street.mp4 --teacher big.onnx --net small.cfg -o small.onnx

  A set that labels cars and buses only (persons in it are no negatives then):

  lookonce train-detector cars/ people/ --labelled cars=car,bus --net small.cfg -o small.onnx

[bold]Afterwards[/bold]  lookonce fit trains descriptors on it, lookonce track uses it. The folder detector.train holds
the network and its weights in Darknet's format, for 'lookonce import' at another size.
"""

_FOLDER_SUFFIX = ".train"
_TEACHERS_LEAST_SCORE = 0.05
_SETTINGS = "Settings (all of them, and more, also in a TOML file by the same names)"


def _setting(text: str) -> Any:
    return typer.Option(help=text, rich_help_panel=_SETTINGS, show_default=False)


_Data = Annotated[
    list[Path] | None,
    typer.Argument(metavar="DATA", help="Folders of pictures with YOLO labels, or labelled sequences."),
]
_Net = Annotated[Path, typer.Option("--net", help="Darknet cfg of the network.", show_default=False)]
_Output = Annotated[Path, typer.Option("-o", "--output", help="Model file to write.", show_default=False)]
_Weights = Annotated[Path | None, typer.Option(help="Darknet weights to start from.", show_default="random")]
_Names = Annotated[Path | None, typer.Option(help="Classes to learn, one a line.", show_default="all classes of DATA")]
_ChangeClasses = Annotated[
    bool, typer.Option("--change-classes", help="Give the network as many classes as there are to learn.")
]
_Size = Annotated[str | None, typer.Option(metavar="N|HxW", help="Input size in px.", show_default="the cfg's")]
_Video = Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Unlabelled video; may be repeated.")]
_Labelled = Annotated[
    list[str] | None,
    typer.Option(
        metavar="SET=CLASS,...",
        help="Classes that a set labels wholly; may be repeated.",
        show_default="those that occur in it",
    ),
]
_LeaveOut = Annotated[
    Path | None, typer.Option(help="File with pictures not to use, one a line, such as atl/images/a.jpg.")
]
_FitAnchors = Annotated[
    bool | None, typer.Option(help=r"Fit anchors to the data \[yes].", rich_help_panel=_SETTINGS, show_default=False)
]


def train_detector_command(
    data: _Data = None,
    net: _Net = ...,  # type: ignore[assignment]
    output: _Output = ...,  # type: ignore[assignment]
    weights: _Weights = None,
    weights_names: Annotated[Path | None, typer.Option(help="Class names of --weights, one a line.")] = None,
    names: _Names = None,
    change_classes: _ChangeClasses = False,
    size: _Size = None,
    video: _Video = None,
    teacher: Annotated[Path | None, typer.Option(help="Model file that labels what is not labelled.")] = None,
    labelled: _Labelled = None,
    leave_out: _LeaveOut = None,
    license: Annotated[str, typer.Option(help="Terms of the result, kept in the file.")] = "unknown",
    config: Annotated[Path | None, typer.Option(help="TOML file with settings; flags go before it.")] = None,
    device: Annotated[str, typer.Option(help="Where to train: auto, cpu or cuda.")] = "auto",
    devices: Annotated[int, typer.Option(help="How many of them train together.", min=1)] = 1,
    threads: Annotated[int | None, typer.Option(help="Processors to use.", show_default="all", min=1)] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted run.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier model file and run.")] = False,
    tensorboard: Annotated[bool, typer.Option("--tensorboard", help="Write TensorBoard logs too.")] = False,
    seed: Annotated[int | None, _setting("Of every random choice [0].")] = None,
    epochs: Annotated[int | None, _setting("Passes over the pictures [100].")] = None,
    batch: Annotated[int | None, _setting("Pictures in a step [16].")] = None,
    learning_rate: Annotated[float | None, _setting("The highest of the cycle [0.002].")] = None,
    positives: Annotated[str | None, _setting("several anchors for an object, or the best (as published).")] = None,
    box_loss: Annotated[str | None, _setting("ciou, giou, or squared (as published).")] = None,
    objectness: Annotated[str | None, _setting("Learns the overlap reached, or one (as published).")] = None,
    mosaic: Annotated[float | None, _setting("Share of views made of four pictures [0.7].")] = None,
    fit_anchors: _FitAnchors = None,
    video_frames: Annotated[int | None, _setting("Frames taken of a sequence or video at most [100].")] = None,
    teacher_score: Annotated[float | None, _setting("From here on its detections are labels [0.5].")] = None,
    held_out: Annotated[float | None, _setting("Share of pictures kept for validation [0.08].")] = None,
    check_every: Annotated[int | None, _setting("Epochs between two looks at validation [5].")] = None,
    patience: Annotated[int | None, _setting("Looks without progress before it stops [10].")] = None,
    precision: Annotated[str | None, _setting("auto, 32-true, bf16-mixed or 16-mixed.")] = None,
    cache_gb: Annotated[float | None, _setting("Memory for decoded pictures, 10^9 bytes [3].")] = None,
) -> None:
    """Train a detector for your own classes: any YOLO network, from random weights or from published ones."""
    given = {name: value for name, value in locals().items() if value is not None}
    settings = _settings(config, given)
    _check_output(output, may_exist=overwrite or resume)
    _run(
        _network(net, weights, weights_names, size, change_classes),
        _read_data(data or [], video or [], labelled or [], leave_out),
        settings,
        classes=read_class_names(names) if names else (),
        output=output,
        teacher=teacher,
        license=license,
        device=device,
        devices=devices,
        threads=threads,
        resume=resume,
        overwrite=overwrite,
        tensorboard=tensorboard,
    )


train_detector_command.__doc__ = f"{train_detector_command.__doc__}\n{_EXAMPLES}"


def _settings(config: Path | None, given: dict[str, Any]) -> DetectorConfig:
    """What the TOML file says, and before it the flags."""
    from lookonce.make.detector.settings import DetectorConfig

    from_file = read_settings(config, DetectorConfig) if config else {}
    known = {field.name for field in fields(DetectorConfig)}
    return DetectorConfig(**from_file | {name: value for name, value in given.items() if name in known})


def _check_output(output: Path, *, may_exist: bool) -> None:
    if output.is_dir() or output.suffix == _FOLDER_SUFFIX:
        raise OutputError(f"{output}: a folder, or named like the run's own; give a file such as detector.onnx with -o")
    if output.exists() and not may_exist:
        raise OutputError(f"{output} exists; give --overwrite to replace it, or another name with -o")


def _network(
    net: Path, weights: Path | None, weights_names: Path | None, size: str | None, change_classes: bool
) -> NetworkSource:
    try:
        from lookonce.make.detector.train import NetworkSource
    except ModuleNotFoundError as exc:
        raise ConfigError(
            f"train-detector needs the extra 'train' ({exc.name} is missing); pip install 'lookonce[train]'"
        ) from exc
    names = read_class_names(weights_names) if weights_names else ()
    if names and weights is None:
        raise ConfigError("--weights-names belongs to --weights, which is not given")
    return NetworkSource(net, weights, names, parse_size(size) if size else None, change_classes)


def _read_data(data: list[Path], videos: list[Path], labelled: list[str], leave_out: Path | None) -> DetectorData:
    from lookonce.make.detector.gather import DetectorData

    if not data and not videos:
        raise ConfigError("nothing to learn from; give labelled DATA, or --video and --teacher")
    missing = [path for path in videos if not path.exists()]
    if missing:
        raise ConfigError(f"{missing[0]}: no such video; check the path")
    stills: list[LabelledStills] = []
    sequences: list[LabelledSequence] = []
    for path in data:
        found = _sequences(path)
        if found:
            sequences += found
        else:
            stills.append(open_stills(path))
    told = dict(_labelled_classes(text) for text in labelled)
    return DetectorData(tuple(stills), tuple(sequences), tuple(videos), told, _read_list(leave_out))


def _sequences(path: Path) -> tuple[LabelledSequence, ...]:
    """The labelled sequences at ``path``; none where it holds something else, such as stills."""
    try:
        return open_sequences(path)
    except ConfigError:
        if not path.is_dir():
            raise
        return ()


def _labelled_classes(text: str) -> tuple[str, tuple[str, ...]]:
    name, separator, classes = text.partition("=")
    if not separator:
        raise ConfigError(f"--labelled {text}: expected SET=CLASS,CLASS such as cars=car,bus")
    return name, tuple(part.strip() for part in classes.split(",") if part.strip())


def _read_list(path: Path | None) -> frozenset[str]:
    if path is None:
        return frozenset()
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigError(f"{path}: cannot be read as a list of pictures ({exc}); check the path") from exc
    return frozenset(line.strip() for line in lines if line.strip() and not line.startswith("#"))


def _classes_of(data: DetectorData) -> tuple[str, ...]:
    """All classes of all sets, in the order in which they come, each spelt as it comes first."""
    parts = [*(stills.classes for stills in data.stills), *(sequence.classes for sequence in data.sequences)]
    if not parts:
        raise ConfigError("which classes are to be learnt? give --names, a file with one a line")
    spelt: dict[str, str] = {}
    for part in parts:
        for name in part:
            spelt.setdefault(usual_name(name), name)
    return tuple(spelt.values())


def _run(
    source: NetworkSource,
    data: DetectorData,
    settings: DetectorConfig,
    *,
    classes: tuple[str, ...],
    output: Path,
    teacher: Path | None,
    license: str,
    device: str,
    devices: int,
    threads: int | None,
    resume: bool,
    overwrite: bool,
    tensorboard: bool,
) -> None:
    from lookonce.make.detector.train import train_detector
    from lookonce.make.training.record import check_tensorboard, open_run, write_curves_for_tensorboard

    start = time.perf_counter()
    if tensorboard:
        check_tensorboard()
    guide = Model(teacher, threads=threads, score_threshold=_TEACHERS_LEAST_SCORE) if teacher else None
    classes = classes or _classes_of(data)
    folder = output.with_suffix(_FOLDER_SUFFIX)
    identity = _identity(source, data, classes, guide, settings)
    open_run(folder, identity, resume=resume, overwrite=overwrite)
    with StageScreen() as screen:
        try:
            result = train_detector(
                source,
                data,
                classes,
                output,
                settings,
                folder=folder,
                teacher=guide,
                license=license,
                device=device,
                devices=devices,
                threads=threads,
                progress=screen,
            )
        except KeyboardInterrupt:
            screen.say(f"{folder}: keeps what was made so far; go on with --resume")
            raise
    _record(folder, identity, result, time.perf_counter() - start)
    if tensorboard:
        columns = {name: values for name, values in asdict(result.history).items() if name != "epoch"}
        write_curves_for_tensorboard(folder / "tensorboard", result.history.epoch, columns)
    _print_end(output, folder, result, time.perf_counter() - start)


def _print_end(output: Path, folder: Path, result: DetectorResult, seconds: float) -> None:
    mean = result.scores.mean
    each = ", ".join(f"{one.name} {one.ap50:.3f}" for one in result.scores.classes if one.boxes)
    print(
        f"{output}: learnt from {result.pictures} pictures in {seconds:.0f} s; "
        f"on {mean.boxes} held-out objects AP50 {mean.ap50:.3f}, AP50-95 {mean.ap:.3f} (AP50: {each})"
    )
    print(f"{folder}: record.json, curves.png, network.cfg, network.weights, network.names")


def _identity(
    source: NetworkSource, data: DetectorData, classes: tuple[str, ...], teacher: Model | None, settings: DetectorConfig
) -> dict[str, object]:
    """All that the result depends on."""
    from lookonce.make.training.record import fingerprint

    return {
        "network": {
            "cfg": _digest(source.cfg),
            "weights": _digest(source.weights) if source.weights else "random",
            "weights_names": list(source.names),
            "size": source.size,
        },
        "classes": list(classes),
        "data": fingerprint(data),
        "labelled": {name: list(told) for name, told in sorted(data.labelled.items())},
        "left_out": sorted(data.left_out),
        "teacher": teacher.sha256 if teacher else "none",
        "settings": asdict(settings),
    }


def _record(folder: Path, identity: dict[str, object], result: DetectorResult, seconds: float) -> None:
    from lookonce.make.training.record import Curve, write_record

    history, scores = result.history, result.scores
    figures = {
        one.name: {"boxes": one.boxes, "ap": _number(one.ap), "ap50": _number(one.ap50)}
        for one in (*scores.classes, scores.mean)
    }
    write_record(
        folder,
        identity,
        {"pictures": result.pictures, "validation": figures, "history": asdict(history)},
        seconds,
        x=Curve("epoch", history.epoch),
        loss=Curve("training loss", history.loss),
        quality=Curve("AP50-95 on held-out pictures", history.ap),
        best=history.best,
    )


def _number(value: float) -> float | None:
    return None if value != value else round(value, 4)


def _digest(path: Path) -> str:
    import hashlib

    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be read ({exc.strerror}); check the path") from exc
