"""`lookonce fit`."""

from __future__ import annotations

import shutil
import time
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lookonce.cli.stages import StageScreen
from lookonce.config import read_settings
from lookonce.datasets import open_sequences, open_stills
from lookonce.errors import ConfigError, OutputError
from lookonce.model import Model

if TYPE_CHECKING:
    from lookonce.datasets import LabelledSequence
    from lookonce.make.training.config import FitConfig
    from lookonce.make.training.fit import FitData, FitResult

__all__ = ["fit_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  Labelled sequences (MOTChallenge, UA-DETRAC, KITTI, CVAT):

  lookonce fit MOT17/train -m model.onnx -o model+id.onnx

  Stills with YOLO labels, or without: then the detector looks:

  lookonce fit --stills pictures/ -m model.onnx -o model+id.onnx

  Unlabelled video:

  lookonce fit --video street.mp4 --video shop.mp4 -m model.onnx -o m+id.onnx

  Any mixture, settings from a file:

  lookonce fit seq1/ --stills pictures/ -m model.onnx -o m+id.onnx --config fit.toml

[bold]Afterwards[/bold]  lookonce probe model+id.onnx DATA tells how far the descriptors can be trusted.
"""

_FOLDER_SUFFIX = ".fit"
_SETTINGS = "Settings (also in a TOML file, by the same names)"


def _setting(text: str) -> Any:
    return typer.Option(help=text, rich_help_panel=_SETTINGS, show_default=False)


def fit_command(
    data: Annotated[
        list[Path] | None, typer.Argument(metavar="DATA", help="Labelled sequences, or folders of them.")
    ] = None,
    model: Annotated[Path, typer.Option("-m", "--model", help="Model file to start from.", show_default=False)] = ...,  # type: ignore[assignment]
    output: Annotated[Path, typer.Option("-o", "--output", help="Model file to write.", show_default=False)] = ...,  # type: ignore[assignment]
    stills: Annotated[
        list[Path] | None, typer.Option(metavar="FOLDER", help="Pictures with YOLO labels or none; may be repeated.")
    ] = None,
    video: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Unlabelled video; may be repeated.")] = None,
    frames: Annotated[
        Path | None, typer.Option(help="Video or folder with the pictures of DATA, where it is one sequence without.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="TOML file with settings; flags go before it.")] = None,
    device: Annotated[str, typer.Option(help="Where to train: auto, cpu or cuda.")] = "auto",
    threads: Annotated[int | None, typer.Option(help="Processors to use.", show_default="all", min=1)] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted run.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier model file and run.")] = False,
    keep_features: Annotated[
        bool,
        typer.Option("--keep-features", help="Leave the features on disk; a run with --overwrite uses them again."),
    ] = False,
    tensorboard: Annotated[bool, typer.Option("--tensorboard", help="Write TensorBoard logs too.")] = False,
    kind: Annotated[str | None, _setting("compact, or paper (as published).")] = None,
    seed: Annotated[int | None, _setting("Of every random choice [0].")] = None,
    steps: Annotated[int | None, _setting("Optimizer steps at most [1200].")] = None,
    views: Annotated[int | None, _setting("Transformed views of each still [2].")] = None,
    collages: Annotated[int | None, _setting("Collages each object of a still is put into [4].")] = None,
    variants: Annotated[int | None, _setting("Identities made of each object by other colours [1].")] = None,
    crowds: Annotated[
        int | None, _setting("Rendered crowds of 28 people to learn from too, for a detector of people [120].")
    ] = None,
    sequence_frames: Annotated[int | None, _setting("Frames taken of a sequence or video at most [300].")] = None,
    score: Annotated[float | None, _setting("Least confidence of detections that stand in for labels [0.4].")] = None,
    held_out: Annotated[float | None, _setting("Share of identities kept for validation [0.1].")] = None,
    identities: Annotated[int | None, _setting("Identities in a batch [160].")] = None,
    rows: Annotated[int | None, _setting("Pictures of an identity in a batch [4].")] = None,
    embedding: Annotated[int | None, _setting("Of kind compact: numbers made of each point of a box [48].")] = None,
    gate: Annotated[int | None, _setting("Of kind compact: numbers that decide which points count [16].")] = None,
    shared_space: Annotated[float | None, _setting("Of kind compact: weight of one space for all classes [0].")] = None,
    learning_rate: Annotated[float | None, _setting("The highest of the cycle [0.003].")] = None,
    weight_decay: Annotated[float | None, _setting("Of AdamW [0.001].")] = None,
    temperature: Annotated[float | None, _setting("Of the contrastive loss [0.1].")] = None,
    check_every: Annotated[int | None, _setting("Steps between two looks at validation [200].")] = None,
    patience: Annotated[int | None, _setting("Looks without progress before it stops [5].")] = None,
    cache_gb: Annotated[float | None, _setting("Disk and memory for features, 10^9 bytes [1].")] = None,
) -> None:
    """Train descriptors on a frozen detector: boxes stay the same to the byte, identities become tellable."""
    _check_output(output, may_exist=overwrite or resume)
    _run(
        _read_data(data or [], stills or [], video or [], frames),
        _settings(config, locals()),
        model=model,
        output=output,
        device=device,
        threads=threads,
        resume=resume,
        overwrite=overwrite,
        keep_features=keep_features,
        tensorboard=tensorboard,
    )


fit_command.__doc__ = f"{fit_command.__doc__}\n{_EXAMPLES}"


def _settings(config: Path | None, given: dict[str, Any]) -> FitConfig:
    """What the TOML file says, and before it the flags."""
    from lookonce.make.training.config import FitConfig

    from_file = read_settings(config, FitConfig) if config else {}
    known = {field.name for field in fields(FitConfig)}
    flags = {name: value for name, value in given.items() if name in known and value is not None}
    return FitConfig(**from_file | flags)


def _check_output(output: Path, *, may_exist: bool) -> None:
    if output.is_dir() or output.suffix == _FOLDER_SUFFIX:
        raise OutputError(f"{output}: a folder, or named like the run's own; give a file such as model+id.onnx with -o")
    if output.exists() and not may_exist:
        raise OutputError(f"{output} exists; give --overwrite to replace it, or another name with -o")


def _read_data(data: list[Path], stills: list[Path], videos: list[Path], frames: Path | None) -> FitData:
    if not (data or stills or videos):
        raise ConfigError("nothing to learn from; give labelled DATA, --stills or --video")
    if frames is not None and len(data) != 1:
        raise ConfigError(f"--frames belongs to one DATA, but there are {len(data)}")
    missing = [path for path in videos if not path.exists()]
    if missing:
        raise ConfigError(f"{missing[0]}: no such video; check the path")
    try:
        from lookonce.make.training.fit import FitData
    except ModuleNotFoundError as exc:
        raise ConfigError(
            f"fit needs the extra 'train' ({exc.name} is missing); pip install 'lookonce[train]'"
        ) from exc
    sequences = [sequence for path in data for sequence in _open_sequences(path, frames)]
    return FitData(tuple(sequences), tuple(open_stills(path) for path in stills), tuple(videos))


def _open_sequences(path: Path, frames: Path | None) -> tuple[LabelledSequence, ...]:
    try:
        return open_sequences(path, pictures=frames)
    except ConfigError as exc:
        if frames is not None or not path.is_dir():
            raise
        raise ConfigError(f"{exc}; a folder of pictures needs --stills before it") from exc


def _run(
    data: FitData,
    settings: FitConfig,
    *,
    model: Path,
    output: Path,
    device: str,
    threads: int | None,
    resume: bool,
    overwrite: bool,
    keep_features: bool,
    tensorboard: bool,
) -> None:
    from lookonce.make.training.fit import fit
    from lookonce.make.training.record import (
        check_tensorboard,
        fingerprint,
        open_run,
        write_curves_for_tensorboard,
    )

    start = time.perf_counter()
    if tensorboard:
        check_tensorboard()
    detector = Model(model)
    folder = output.with_suffix(_FOLDER_SUFFIX)
    identity: dict[str, object] = {
        "model": {"file": detector.path.name, "sha256": detector.sha256},
        "data": fingerprint(data),
        "features": settings.for_reading(),
        "settings": asdict(settings),
    }
    open_run(folder, identity, resume=resume, overwrite=overwrite)
    with StageScreen() as screen:
        try:
            result = fit(
                detector.path, data, output, settings, folder=folder, device=device, threads=threads, progress=screen
            )
        except KeyboardInterrupt:
            screen.say(f"{folder}: keeps what was made so far; go on with --resume")
            raise
    seconds = time.perf_counter() - start
    _record(folder, identity, result, seconds)
    if tensorboard:
        columns = {name: values for name, values in asdict(result.history).items() if name != "step"}
        write_curves_for_tensorboard(folder / "tensorboard", result.history.step, columns)
    if not keep_features:
        shutil.rmtree(folder / "features", ignore_errors=True)
    seen = result.validation
    print(
        f"{output}: descriptors of kind {settings.kind}, {result.identities} identities learnt in {seconds:.0f} s; "
        f"on {seen.identities} held-out ones equal error rate {seen.error_rate:.3f} at distance {seen.threshold:.2f}"
    )
    print(f"{folder}: record.json, curves.png")


def _record(folder: Path, identity: dict[str, object], result: FitResult, seconds: float) -> None:
    from lookonce.make.training.record import Curve, write_record

    history = result.history
    write_record(
        folder,
        identity,
        {
            "readings": result.rows,
            "identities": result.identities,
            "validation": asdict(result.validation),
            "history": asdict(history),
        },
        seconds,
        x=Curve("step", history.step),
        loss=Curve("training loss", history.loss),
        quality=Curve("equal error rate of held-out identities", history.error_rate),
        best=history.best,
    )
