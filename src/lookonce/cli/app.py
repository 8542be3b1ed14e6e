"""The command `lookonce`: its subcommands, and what an error looks like to the person at the keyboard."""

from __future__ import annotations

import logging
import os
import sys

import typer
from typer.main import get_command

from lookonce import __version__
from lookonce.cli.compare_crops import fit_crops_command
from lookonce.cli.comparing import compare_command
from lookonce.cli.converting import convert_command
from lookonce.cli.demo import demo_command
from lookonce.cli.detecting import train_detector_command
from lookonce.cli.downloading import models_app
from lookonce.cli.evaluating import eval_command
from lookonce.cli.explaining import explain_command
from lookonce.cli.fitting import fit_command
from lookonce.cli.importing import import_command
from lookonce.cli.probing import probe_command
from lookonce.cli.reporting import report_command
from lookonce.cli.settings import settings_command
from lookonce.cli.synth import synth_command
from lookonce.cli.tracking import track_command
from lookonce.cli.tuning import tune_command
from lookonce.errors import LookonceError

__all__ = ["main"]

EXIT_INPUT_WRONG = 1
EXIT_INTERRUPTED = 130

app = typer.Typer(
    name="lookonce",
    help="Multi-object tracking that looks once: video in, identities out.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("convert", no_args_is_help=True)(convert_command)
app.command("demo")(demo_command)
app.command("track", no_args_is_help=True)(track_command)
app.command("eval", no_args_is_help=True)(eval_command)
app.command("tune", no_args_is_help=True)(tune_command)
app.command("settings")(settings_command)
app.command("compare", no_args_is_help=True)(compare_command)
app.command("report", no_args_is_help=True)(report_command)
app.command("explain", no_args_is_help=True)(explain_command)
app.command("fit", no_args_is_help=True)(fit_command)
app.command("fit-crops", no_args_is_help=True)(fit_crops_command)
app.command("import", no_args_is_help=True)(import_command)
app.add_typer(models_app, name="models")
app.command("train-detector", no_args_is_help=True)(train_detector_command)
app.command("probe", no_args_is_help=True)(probe_command)
app.command("synth", no_args_is_help=True)(synth_command)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"lookonce {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(False, "--version", callback=_print_version, is_eager=True, help="Print the version."),
) -> None:
    pass


def main() -> None:
    """Run the command line; exit codes: 0 done, 1 the input is wrong, 2 wrong usage, 130 interrupted."""
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.WARNING, stream=sys.stderr)
    logging.addLevelName(logging.WARNING, "warning")
    try:
        code = get_command(app).main(standalone_mode=True, prog_name="lookonce")
    except LookonceError as error:
        print(f"lookonce: {error}", file=sys.stderr)
        code = EXIT_INPUT_WRONG
    except KeyboardInterrupt:
        print("lookonce: interrupted", file=sys.stderr)
        code = EXIT_INTERRUPTED
    except BrokenPipeError:  # somebody closed the pipe that we print to, such as `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_INPUT_WRONG
    sys.exit(code)
