"""`lookonce models`, with `get` and `known`."""

from __future__ import annotations

import shlex
import sys
from inspect import cleandoc
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text
from typer.core import TyperGroup

from lookonce.cli.importing import import_command, parse_size
from lookonce.cli.listing import list_command
from lookonce.cli.stages import StageScreen
from lookonce.errors import DownloadError, OutputError
from lookonce.models.download import copy_file, download_file, is_cached, model_folder, part_bytes
from lookonce.models.registry import KnownFile, KnownModel, find_known, known_models

__all__ = ["models_app"]

_SHOW_PROGRESS_FROM_BYTES = 1_000_000

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce models known

  lookonce models get yolov3 --size 416

  lookonce models get yolov4-tiny --no-import

  lookonce models get yolov3 --from yolov3.cfg --from yolov3.weights --from coco.names
"""


class _ListsByDefault(TyperGroup):
    """Takes what is not a command as files and folders to list."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not args or (args[0] not in self.commands and args[0] not in ctx.help_option_names):
            args = ["list", *args]
        return super().parse_args(ctx, args)


models_app = typer.Typer(
    cls=_ListsByDefault,
    rich_markup_mode="rich",
    help="List model files, or get a published detector. Without a command: list; a file called 'get' is './get'.\n"
    "\n[bold]Examples[/bold]\n\n  lookonce models\n\n  lookonce models model.onnx detectors/\n\n"
    "  lookonce models get yolov3",
)
models_app.command("list")(list_command)


def known_command() -> None:
    """Say which published detectors can be had: size, licence, who vouches for the files, and whether they are here."""
    for model in known_models().values():
        _print(model)


def get_command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Which one; see 'models known'.", show_default=False)],
    given: Annotated[
        list[Path] | None,
        typer.Option("--from", metavar="FILE", help="Take this file instead of the network; give it several times."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Model file to write.", show_default="NAME.onnx")
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="Input size in px: one number, or HEIGHTxWIDTH.", show_default="the cfg's own")
    ] = None,
    make_model: Annotated[bool, typer.Option("--import/--no-import", help="Make a model file of it.")] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier model file.")] = False,
) -> None:
    """Get a published detector, check it against its digest, and make a model file of it.

    The files stay in your cache folder, or in the folder that LOOKONCE_CACHE names. An interrupted download goes on
    with the same command. The model file needs the extra 'train'; without it you are told what to run.
    """
    model = find_known(name)
    target = output or Path(f"{name}.onnx")
    parse_size(size)  # a wrong one is better found before the download
    if make_model and target.exists() and not overwrite:
        raise OutputError(f"{target} exists; give --overwrite to replace it, or another name with -o")
    if given:
        _copy(model, given)
    else:
        _download(model)
    folder = model_folder(model)
    print(f"{folder}: {', '.join(file.name for file in model.files)}, checked against their digests")
    if make_model and _can_import():
        cfg, weights, names = (folder / file.name for file in (model.cfg, model.weights, model.names))
        import_command(cfg, weights, output=target, names=names, size=size, license=model.license, overwrite=overwrite)
    elif make_model:
        print("a model file needs the extra 'train': pip install 'lookonce[train]', then\n")
        print(f"  {_import_line(model, target, size)}")


get_command.__doc__ = f"{cleandoc(get_command.__doc__ or '')}\n{_EXAMPLES}"
models_app.command("known")(known_command)
models_app.command("get", no_args_is_help=True)(get_command)


def _download(model: KnownModel) -> None:
    """Fetch what is missing, with progress on stderr."""
    try:
        with StageScreen() as screen:

            def show(file: KnownFile, here: int) -> None:
                if file.size_bytes >= _SHOW_PROGRESS_FROM_BYTES:
                    screen.stage(f"{file.name}, MB", here // 1_000_000, file.size_bytes // 1_000_000)

            for file in model.files:
                download_file(file, model_folder(model), show)
    except KeyboardInterrupt:
        kept = f"{part_bytes(model) / 1e6:.1f} MB of {model.name} are kept"
        print(f"{kept}; 'lookonce models get {model.name}' goes on with them", file=sys.stderr)
        raise


def _copy(model: KnownModel, given: list[Path]) -> None:
    """Take the given files into the cache; all of the model must be there then."""
    folder = model_folder(model)
    for path in given:
        copy_file(path, model.files, folder)
    if not is_cached(model):
        missing = [file for file in model.files if not (folder / file.name).exists()]
        what = ", ".join(f"{file.name} ({file.urls[0]})" for file in missing)
        raise DownloadError(f"{model.name}: also needs {what}; give it with --from too, or leave --from out")


def _can_import() -> bool:
    """Whether the extra 'train' is installed."""
    try:
        import lookonce.make.darknet.importer  # noqa: F401
    except ModuleNotFoundError:
        return False
    return True


def _import_line(model: KnownModel, target: Path, size: str | None) -> str:
    """The command that makes the model file."""
    cfg, weights, names = (str(model_folder(model) / file.name) for file in (model.cfg, model.weights, model.names))
    command = ["lookonce", "import", cfg, weights, "--names", names, "--license", model.license]
    return shlex.join([*command, *(["--size", size] if size else []), "-o", str(target)])


def _print(model: KnownModel) -> None:
    """One model: its name, then what there is to know, a line each."""
    own, *others = model.sizes_px
    also = f" (also {', '.join(map(str, others))})" if others else ""
    digest = model.weights.digest
    facts = {
        "classes": model.classes,
        "input": f"{own}x{own}{also}",
        "license": model.license,
        "": model.license_url,
        "weights": model.weights.urls[0],
        digest.algorithm: digest.value,
        "published by": digest.source,
    }
    table = Table.grid(padding=(0, 2))
    for fact, value in facts.items():
        table.add_row(f"  {fact}", Text(value, overflow="fold"))
    here = f"in {model_folder(model)}" if is_cached(model) else "not here yet"
    print(f"{model.name} ({model.size_bytes / 1e6:.1f} MB, {here})")
    Console().print(table)
