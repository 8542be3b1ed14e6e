"""`lookonce synth`."""

from __future__ import annotations

import re
import time
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from lookonce.cli.stages import StageScreen
from lookonce.errors import ConfigError
from lookonce.synthetic import (
    LIGHTS,
    WRITE_LAYOUTS,
    SceneConfig,
    SyntheticScene,
    WriteOptions,
    WrittenScene,
    write_scene,
)

__all__ = ["synth_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce synth street/                                     (one minute, MOTChallenge layout)

  lookonce synth street/ --minutes 2 --place highway --light night --video

  lookonce synth detrac/ --layout ua-detrac --sequences 10 --light any

  lookonce synth stills/ --layout yolo --sequences 20 --every 15 --light any

[bold]Afterwards[/bold]  lookonce track street/synth-0000 -m model.onnx; lookonce fit street/ -m model.onnx -o m+id.onnx
"""

_FPS, _DETRAC_FPS = 15.0, 25.0
_TRAIN_SHARE = 0.6  # of the sequences, as UA-DETRAC divides its own
_ANY_LIGHT = ("day", "day", "change", "night")  # by seed


def synth_command(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to write to.", show_default=False)],
    layout: Annotated[str, typer.Option(help="mot, ua-detrac or yolo.")] = "mot",
    minutes: Annotated[float, typer.Option(help="Length of each sequence.", min=0.001)] = 1.0,
    sequences: Annotated[
        int, typer.Option(help="How many, each with its own seed; of ua-detrac 40 % are for testing.", min=1)
    ] = 1,
    density: Annotated[float, typer.Option(help="Of the traffic; 1 = busy, with queues.", min=0, max=5)] = 1.0,
    fps: Annotated[
        float | None, typer.Option(help="Frames per second.", show_default="15; 25 for ua-detrac", min=1, max=120)
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the first sequence; the others count on.", min=0)] = 0,
    place: Annotated[str, typer.Option(help="junction, tee or highway.", show_default="by seed")] = "",
    light: Annotated[str, typer.Option(help="day, night, change (dusk falls), or any: by seed.")] = "day",
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Of the pictures, px.")] = "960x540",
    look_alikes: Annotated[float, typer.Option(help="Share of cars of one model and colour.", min=0, max=1)] = 0.3,
    shake: Annotated[float, typer.Option(help="Of the camera, px at a width of 960.", min=0, max=10)] = 0.5,
    noise: Annotated[float, typer.Option(help="Of the sensor, grey levels.", min=0, max=6)] = 2.0,
    quality: Annotated[int, typer.Option(help="Of the JPEG pictures.", min=1, max=95)] = 90,
    every: Annotated[int, typer.Option(help="Write only every so many-th frame (yolo).", min=1)] = 1,
    min_visibility: Annotated[
        float, typer.Option(help="Label only objects of which this share can be seen (yolo).", min=0, max=1)
    ] = 0.15,
    video: Annotated[bool, typer.Option("--video", help="Write NAME.mp4 too (mot, ua-detrac).")] = False,
    ignored: Annotated[bool, typer.Option(help="Far roads are ignored regions, without truth.")] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace earlier sequences of these names.")] = False,
) -> None:
    """Render traffic scenes with exact truth: boxes, identities, classes and visibility of every object."""
    if light not in (*LIGHTS, "any"):
        raise ConfigError(f"light = {light!r}: expected one of {', '.join((*LIGHTS, 'any'))}")
    _check_choices(layout, light)
    height, width = _parse_size(size)
    configs = [
        SceneConfig(
            seconds=minutes * 60,
            fps=fps or (_DETRAC_FPS if layout == "ua-detrac" else _FPS),
            height=height,
            width=width,
            seed=number,
            place=place,
            light=_ANY_LIGHT[number % len(_ANY_LIGHT)] if light == "any" else light,
            density=density,
            look_alikes=look_alikes,
            shake_px=shake,
            noise=noise,
            ignored_regions=ignored,
        )
        for number in range(seed, seed + sequences)
    ]
    options = [
        WriteOptions(
            part="train" if number < max(1, round(_TRAIN_SHARE * sequences)) else "test",
            quality=quality,
            every=every,
            min_visibility=min_visibility,
            has_video=video,
            overwrite=overwrite,
        )
        for number in range(sequences)
    ]
    _run(configs, options, out, layout)


synth_command.__doc__ = f"{synth_command.__doc__}\n{_EXAMPLES}"


def _check_choices(layout: str, light: str) -> None:
    for name, value, choices in (("layout", layout, WRITE_LAYOUTS), ("light", light, (*LIGHTS, "any"))):
        if value not in choices:
            raise ConfigError(f"{name} = {value!r}: expected one of {', '.join(choices)}")


def _parse_size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([0-9]{1,5})x([0-9]{1,5})", text.strip())
    if found is None:
        raise ConfigError(f"size = {text!r}: expected WIDTHxHEIGHT such as 960x540")
    return int(found[2]), int(found[1])


def _run(configs: list[SceneConfig], options: list[WriteOptions], out: Path, layout: str) -> None:
    start = time.perf_counter()
    written: list[WrittenScene] = []
    with StageScreen() as screen:
        for number, (config, option) in enumerate(zip(configs, options, strict=True), 1):
            stage = f"sequence {number} of {len(configs)}, seed {config.seed}"
            scene = SyntheticScene(config)

            def show(done: int, total: int, stage: str = stage) -> None:
                screen.stage(stage, done, total)

            written.append(write_scene(scene, out, layout, show, option))
    seconds = time.perf_counter() - start
    pictures, rows = sum(one.pictures for one in written), sum(one.rows for one in written)
    left_out = sum((Counter(one.left_out) for one in written), Counter[str]())
    print(
        f"{out}: {len(written)} sequence{'s' * (len(written) > 1)}, {pictures:,} pictures, {rows:,} boxes of "
        f"{sum(one.identities for one in written):,} objects in {seconds:.0f} s"
    )
    if left_out:
        print(f"left out: {', '.join(f'{count:,} boxes {why}' for why, count in sorted(left_out.items()))}")
