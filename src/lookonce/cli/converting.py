"""`lookonce convert`: results in another program's format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from lookonce.cli.evaluated_results import ResultFile, named_paths
from lookonce.errors import ConfigError
from lookonce.output import DETRAC_TABLES, MotSink, prepare_output_folder, write_detrac_tables
from lookonce.structures import GivenBack
from lookonce.video.opening import one_line

__all__ = ["convert_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce convert runs/MVI_39031 runs/MVI_39051 -o results/ --to ua-detrac --speed 60

  lookonce convert traffic=out/tracks.jsonl -o mot/ --to mot           (mot/traffic.txt)
"""
_INSIDE = ("tracks.txt", "tracks.jsonl")  # of a run's folder, the first that is there


def convert_command(
    results: Annotated[
        list[str],
        typer.Argument(
            metavar="RESULTS...", help="Folders of runs, MOT texts or tracks.jsonl; NAME=PATH names a sequence."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the files.", show_default=False)],
    to: Annotated[Literal["mot", "ua-detrac"], typer.Option(help="Format to write.")] = "ua-detrac",
    frames: Annotated[
        int | None, typer.Option(help="Frames of the sequence.", min=1, show_default="up to the last box")
    ] = None,
    speed: Annotated[float | None, typer.Option(help="Frames a second, for NAME_speed.txt.", min=0)] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace earlier files.")] = False,
) -> None:
    """Write results as UA-DETRAC's tables (NAME_LX.txt, _LY, _W, _H) or MOTChallenge text."""
    found = {name: _file(path) for name, path in named_paths(results).items()}
    ends = (".txt",) if to == "mot" else tuple(f"_{table}.txt" for table in DETRAC_TABLES)
    speeds = ("_speed.txt",) if speed is not None and to != "mot" else ()
    prepare_output_folder(output, [f"{name}{end}" for name in found for end in (*ends, *speeds)], overwrite)
    for name, file in found.items():
        boxes = _write(output, name, file, to, frames, speed)
        print(f"{name}: {boxes:,} boxes written to {one_line(output / (name + ends[0]))}")


convert_command.__doc__ = f"{convert_command.__doc__}\n{_EXAMPLES}"


def _file(path: Path) -> ResultFile:
    if path.is_file():
        return ResultFile((path,))
    inside = next((path / name for name in _INSIDE if (path / name).is_file()), None)
    if inside is None:
        raise ConfigError(f"{one_line(path)}: holds neither {' nor '.join(_INSIDE)}; name the file of a run")
    return ResultFile((inside,))


def _write(output: Path, name: str, file: ResultFile, to: str, frames: int | None, speed: float | None) -> int:
    """The number of boxes written."""
    result = file.read().result
    last = int(result.row_frames.max(initial=-1)) + 1
    if frames is not None and last > frames:
        raise ConfigError(f"{file.shown}: has boxes up to frame {last}, beyond --frames {frames}; give a higher number")
    if to == "mot":
        with MotSink(output / f"{name}.txt") as sink:
            scores = np.ones(len(result.ids), np.float32)
            boxes = result.xyxy.astype(np.float32)
            sink.write_rows(GivenBack(result.row_frames, result.labels, result.ids, boxes, scores, result.labels))
    else:
        ltwh = np.concatenate([result.xyxy[:, :2], result.xyxy[:, 2:] - result.xyxy[:, :2]], axis=1)
        write_detrac_tables(output, name, result.row_frames, result.ids, ltwh, frames or last, speed)
    return len(result.ids)
