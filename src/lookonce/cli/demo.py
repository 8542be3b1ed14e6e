"""`lookonce demo`."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from lookonce.cli.stages import StageScreen
from lookonce.model import Model
from lookonce.output import prepare_output_folder
from lookonce.pipeline import share_processors
from lookonce.synthetic import LIGHTS, PLACES, SceneConfig

if TYPE_CHECKING:
    from lookonce.demo import DemoResult

__all__ = ["demo_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce demo

  lookonce demo -o out/ --place junction --light night --seed 7

[bold]Afterwards[/bold]  look at lookonce-demo/annotated.mp4, then: lookonce track your.mp4
"""

_SCENE = SceneConfig(seconds=20, fps=15, seed=22, place="highway", ignored_regions=False)
_FILES = ("scene.mp4", "annotated.mp4", "trails.png", "tracks.txt", "tracks.jsonl")


def demo_command(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")] = Path("lookonce-demo"),
    model: Annotated[str, typer.Option("-m", "--model", help="Model file, or the name of one that ships.")] = "street",
    seconds: Annotated[float, typer.Option(help="Length of the scene.", min=1, max=600)] = _SCENE.seconds,
    place: Annotated[str, typer.Option(help=f"{', '.join(PLACES)}.")] = _SCENE.place,
    light: Annotated[str, typer.Option(help=f"{', '.join(LIGHTS)}.")] = _SCENE.light,
    seed: Annotated[int, typer.Option(help="Of the scene.", min=0)] = _SCENE.seed,
) -> None:
    """Track a scene that is drawn on the spot, and score it: no video, no network, no model file needed."""
    from lookonce.demo import run_demo

    start = time.perf_counter()
    scene = replace(_SCENE, seconds=seconds, place=place, light=light, seed=seed)
    threads, _ = share_processors(is_live=False)
    opened = Model(model, threads=threads)
    prepare_output_folder(output, list(_FILES), overwrite=True)
    with StageScreen() as screen:
        result = run_demo(output, opened, scene, report=lambda done, total: screen.stage("demo", done, total, "frames"))
    _print(result, output, time.perf_counter() - start)


demo_command.__doc__ = f"{demo_command.__doc__}\n{_EXAMPLES}"


def _print(result: DemoResult, output: Path, seconds: float) -> None:
    """The scores in a table, then where to look."""
    scores = result.scores
    table = Table(title=f"{result.frames} frames, {result.objects} objects, {seconds:.0f} s", title_justify="left")
    for name in ("IDF1", "MOTA", "HOTA", "identity switches", "missed", "wrong"):
        table.add_column(name, justify="right")
    percent = [f"{100 * value:.1f}" for value in (scores.identity.idf1, scores.clear.mota, scores.hota.hota)]
    table.add_row(*percent, *map(str, (scores.clear.id_switches, scores.clear.misses, scores.clear.false_positives)))
    Console().print(table)
    print(f"{output / 'annotated.mp4'}: the video with its tracks; {output / 'trails.png'}: one frame of it")
    print(f"next: lookonce track your.mp4, or lookonce track {output / 'scene.mp4'} to see it done step by step")
