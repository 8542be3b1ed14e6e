"""`lookonce fit-crops`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lookonce.cli.stages import StageScreen
from lookonce.datasets import open_sequences, open_stills
from lookonce.errors import ConfigError, OutputError
from lookonce.model import Model, available_cpus
from lookonce.video.opening import one_line

if TYPE_CHECKING:
    from lookonce.make.training.fit import FitData

__all__ = ["fit_crops_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce fit-crops MOT17/train -m model.onnx -o crops.onnx

  lookonce compare --truth MOT17-02/ -m model+id.onnx --crops crops.onnx
"""


def fit_crops_command(
    data: Annotated[
        list[Path] | None, typer.Argument(metavar="DATA", help="Labelled sequences, or folders of them.")
    ] = None,
    model: Annotated[Path, typer.Option("-m", "--model", help="Model file, for its input size and videos.")] = ...,  # type: ignore[assignment]
    output: Annotated[Path, typer.Option("-o", "--output", help="ONNX file to write.", show_default=False)] = ...,  # type: ignore[assignment]
    stills: Annotated[
        list[Path] | None, typer.Option(metavar="FOLDER", help="Pictures with YOLO labels; may be repeated.")
    ] = None,
    video: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Unlabelled video; may be repeated.")] = None,
    seed: Annotated[int, typer.Option(help="Of every random choice.")] = 0,
    steps: Annotated[int, typer.Option(help="Optimizer steps at most.")] = 600,
    sequence_frames: Annotated[int, typer.Option(help="Frames taken of a sequence or video at most.")] = 300,
    views: Annotated[int, typer.Option(help="Transformed views of each still.")] = 2,
    collages: Annotated[int, typer.Option(help="Collages each object of a still is put into.")] = 4,
    identities: Annotated[int, typer.Option(help="Identities in a batch.")] = 160,
    cache_gb: Annotated[float, typer.Option(help="Memory for cut-out boxes, 10^9 bytes.")] = 1.0,
    threads: Annotated[int | None, typer.Option(help="Processors to use.", show_default="all", min=1)] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier file.")] = False,
) -> None:
    """Train a second network on cut-out boxes, on the identities of `fit`: what `compare` sets against one look."""
    if output.is_dir() or not output.absolute().parent.is_dir():
        raise OutputError(f"{one_line(output)}: a folder, or in a folder that is not there; name a file with -o")
    if output.exists() and not overwrite:
        raise OutputError(f"{one_line(output)} exists; give --overwrite to replace it, or another name with -o")
    start = time.perf_counter()
    learnt = _read_data(data or [], stills or [], video or [])
    from lookonce.make.crops.fit import fit_crops
    from lookonce.make.training.config import FitConfig

    config = FitConfig(
        seed=seed,
        steps=steps,
        sequence_frames=sequence_frames,
        views=views,
        collages=collages,
        identities=identities,
        cache_gb=cache_gb,
    )
    threads = threads or available_cpus()
    with StageScreen() as screen:
        detector = Model(model, threads=threads)
        seen = fit_crops(detector, learnt, output, config, threads=threads, progress=screen)
    seconds = time.perf_counter() - start
    print(
        f"{one_line(output)}: crop network learnt in {seconds:.0f} s; on {seen.identities} held-out identities equal "
        f"error rate {seen.error_rate:.3f} at distance {seen.threshold:.2f}"
    )


fit_crops_command.__doc__ = f"{fit_crops_command.__doc__}\n{_EXAMPLES}"


def _read_data(data: list[Path], stills: list[Path], videos: list[Path]) -> FitData:
    if not (data or stills or videos):
        raise ConfigError("nothing to learn from; give labelled DATA, --stills or --video")
    if missing := [path for path in videos if not path.exists()]:
        raise ConfigError(f"{one_line(missing[0])}: no such video; check the path")
    try:
        from lookonce.make.training.fit import FitData
    except ModuleNotFoundError as exc:
        raise ConfigError(
            f"fit-crops needs the extra 'train' ({exc.name} is missing); pip install 'lookonce[train]'"
        ) from exc
    sequences = [sequence for path in data for sequence in open_sequences(path)]
    return FitData(tuple(sequences), tuple(open_stills(path) for path in stills), tuple(videos))
