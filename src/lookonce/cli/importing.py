"""`lookonce import`."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Annotated

import typer

from lookonce.errors import ConfigError, OutputError

__all__ = ["import_command", "parse_size"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce import yolo-fastest-1.1-xl.cfg yolo-fastest-1.1-xl.weights --names coco.names --size 512 -o model.onnx

  lookonce import yolov3.cfg yolov3.weights --names coco.names -o yolov3.onnx

  lookonce import yolov4-tiny.cfg yolov4-tiny.weights --names coco.names --size 288x512 -o wide.onnx
"""


def import_command(
    cfg: Annotated[Path, typer.Argument(metavar="NET.cfg", help="Darknet network description.", show_default=False)],
    weights: Annotated[Path, typer.Argument(metavar="NET.weights", help="Its weights.", show_default=False)],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Model file to write.", show_default="NET.onnx")
    ] = None,
    names: Annotated[
        Path | None, typer.Option(help="Class names, one a line.", show_default="class 0, class 1, ...")
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(help="Input size in px: one number, or HEIGHTxWIDTH.", show_default="the cfg's own"),
    ] = None,
    descriptors: Annotated[
        bool, typer.Option("--descriptors/--no-descriptors", help="Let detections carry descriptors (kind native).")
    ] = True,
    license: Annotated[str, typer.Option(help="Terms of the weights, kept in the file.")] = "unknown",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier model file.")] = False,
) -> None:
    """Turn a Darknet detector (YOLO v2, v3, v4, Yolo-Fastest, MobileNet-YOLO) into one model file."""
    target = output or Path(cfg.name).with_suffix(".onnx")
    if target.exists() and not overwrite:
        raise OutputError(f"{target} exists; give --overwrite to replace it, or another name with -o")
    try:
        from lookonce.make.darknet.importer import import_darknet
    except ModuleNotFoundError as exc:
        raise ConfigError(
            f"import needs the extra 'train' ({exc.name} is missing); pip install 'lookonce[train]'"
        ) from exc
    start = time.perf_counter()
    metadata = import_darknet(
        cfg, weights, target, names=names, size=parse_size(size), descriptors=descriptors, license=license
    )
    info = metadata.descriptor
    described = f"descriptors {info.kind}, {info.size} values" if info else "no descriptors"
    height, width = metadata.size
    print(
        f"{target}: {len(metadata.names)} classes, input {height}x{width}, {described}, "
        f"{target.stat().st_size / 1e6:.1f} MB, {time.perf_counter() - start:.1f} s"
    )


import_command.__doc__ = f"{import_command.__doc__}\n{_EXAMPLES}"


def parse_size(text: str | None) -> tuple[int, int] | None:
    """The input size that ``--size`` asks for, as (height, width) in px; None where it asks for none.

    >>> parse_size("288x512"), parse_size("416")
    ((288, 512), (416, 416))
    """
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,5})(?:x(\d{1,5}))?", text.strip().lower())
    if not match:
        raise ConfigError(f"--size {text}: expected one number or HEIGHTxWIDTH, such as 512 or 288x512")
    return int(match[1]), int(match[2] or match[1])
