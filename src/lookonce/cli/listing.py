"""`lookonce models [list]`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lookonce.errors import ModelError
from lookonce.model import ModelMetadata, describe_model
from lookonce.models import find_model, shipped_models

__all__ = ["list_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce models

  lookonce models model.onnx detectors/
"""


def list_command(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[FILE|FOLDER]...", help="Model files, or folders that hold some.", show_default="."),
    ] = None,
) -> None:
    """List model files and what is in them: those of the package, and those given (the current folder by default)."""
    files = [*shipped_models().values(), *_files(paths)]
    skipped = []
    for path in files:
        try:
            _print(path, describe_model(path))
        except ModelError as error:
            if paths and path in paths:  # asked for by name
                raise
            skipped.append(str(error))
    for text in skipped:
        print(f"skipped {text}")
    if not files:
        print("no model files here; 'lookonce models known' says what can be had, 'lookonce import' makes one")


list_command.__doc__ = f"{list_command.__doc__}\n{_EXAMPLES}"


def _files(paths: list[Path] | None) -> list[Path]:
    files: list[Path] = []
    for path in paths or [Path()]:
        files += sorted(path.glob("*.onnx")) if path.is_dir() else [find_model(path)]
    return files


def _print(path: Path, about: ModelMetadata) -> None:
    """One model: its file, then what is in it, a line each."""
    names = ", ".join(about.names[:6]) + (", ..." if len(about.names) > 6 else "")
    height, width = about.size
    strides = _join(grid.stride_px for grid in about.outputs)
    facts = {
        "classes": f"{len(about.names)}: {names}",
        "input": f"{height}x{width} (height x width), strides {strides}",
        "descriptors": "none",
        "features": _join(f"{f.name} ({f.channels} at stride {f.stride_px})" for f in about.features),
        "license": about.license,
        "source": _join(f"{key} {value}" for key, value in about.source.items()),
        "made by": f"lookonce {about.made_by}",
    }
    if about.descriptor:
        threshold = about.descriptor.match_threshold
        calibrated = "match threshold not calibrated" if threshold is None else f"match threshold {threshold:.3f}"
        facts["descriptors"] = f"{about.descriptor.kind}, {about.descriptor.size} values, {calibrated}"
    table = Table.grid(padding=(0, 2))
    for fact, value in facts.items():
        table.add_row(f"  {fact}", Text(value))  # not markup: names come from the file
    print(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    Console().print(table)


def _join(values: Iterable[object]) -> str:
    return ", ".join(map(str, values))
