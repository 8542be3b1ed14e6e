"""`lookonce settings`: the settings of a tracker as a file to change."""

from __future__ import annotations

from inspect import cleandoc
from pathlib import Path
from typing import Annotated

import typer

from lookonce.cli.evaluation_files import check_output, write_text
from lookonce.tracking.settings import choose_tracker, tracker_settings_toml
from lookonce.video.opening import one_line

__all__ = ["settings_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce settings                                          (of the preset default, on the screen)

  lookonce settings iou -o mine.toml

  lookonce settings mine.toml --set memory_s=4 --set motion.place_noise=0.1 -o other.toml

  lookonce track traffic.mp4 --tracker mine.toml
"""


def settings_command(
    tracker: Annotated[
        str, typer.Argument(metavar="TRACKER", help="Preset (default, iou, paper) or TOML file.")
    ] = "default",
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Change a setting; may be repeated.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="TOML file to write.", show_default="the screen")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier file.")] = False,
) -> None:
    """Write all settings of a tracker, each with its meaning, as the file that 'track --tracker FILE.toml' takes.

    The match threshold stays a comment unless you name it: a model file has one of its own.
    """
    chosen = choose_tracker(tracker, changes or ())
    text = tracker_settings_toml(chosen.config, leaves_threshold=not chosen.has_threshold)
    if output is None:
        print(text, end="")
        return
    check_output(output, overwrite)
    write_text(output, text)
    print(f"written {one_line(output)}")


settings_command.__doc__ = f"{cleandoc(settings_command.__doc__ or '')}\n{_EXAMPLES}"
