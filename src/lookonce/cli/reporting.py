"""`lookonce report`."""

from __future__ import annotations

import time
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer

from lookonce import __version__
from lookonce.cli.evaluated_truth import BENCHMARKS
from lookonce.cli.evaluation_files import check_output, write_text
from lookonce.cli.report_judging import Judged, ReportSettings, judge
from lookonce.cli.stages import StageScreen
from lookonce.errors import ConfigError, LookonceError
from lookonce.evaluation import PROTOCOLS
from lookonce.model import Model
from lookonce.report import Report, SequenceView, page_text
from lookonce.report.described import DescribedSequence, Descriptors, describe
from lookonce.report.illustrating import choose_moments, illustrate
from lookonce.video.opening import one_line

__all__ = ["report_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce report runs/MOT17-02 --truth MOT17-02/

  Many sequences, two runs side by side; results as `lookonce eval --results` takes them:

  lookonce report old=runs-a/ new=runs-b/ --truth data/ -o compare.html

  Without truth: identities over time, how long they are, and where the tracker itself was in doubt:

  lookonce report runs/traffic

  With histograms of the model's descriptors:

  lookonce report runs/MOT17-02 --truth MOT17-02/ --model street
"""

_Runs = Annotated[
    list[str],
    typer.Argument(
        metavar="[NAME=]RUN...",
        help="Folders of lookonce track, MOT text, tracks.jsonl, or folders of results by sequence.",
        show_default=False,
    ),
]
_Truth = Annotated[
    Path | None,
    typer.Option("--truth", help="Labelled sequences: a folder or a truth file.", show_default="none, so no scores"),
]
_Output = Annotated[Path, typer.Option("-o", "--output", help="The page.")]
_Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an earlier page.")]
_Protocol = Annotated[str, typer.Option(help="Whose figures: trackeval or detrac.")]
_Benchmark = Annotated[
    str, typer.Option(help=f"Follow the rules of {', '.join(BENCHMARKS)}.", show_default="every object counts")
]
_Classes = Annotated[
    str, typer.Option(help="Judge these classes only, names separated by commas.", show_default="all as one")
]
_ClassNames = Annotated[
    Path | None,
    typer.Option(help="Names of the class numbers in MOT results, one a line.", show_default="as the truth says"),
]
_Frames = Annotated[
    Path | None,
    typer.Option(help="Pictures of a single sequence: a folder or a video.", show_default="as truth or run say"),
]
_Missing = Annotated[bool, typer.Option("--missing-as-empty", help="A sequence without result found nothing.")]
_MaxSwitches = Annotated[
    int, typer.Option(help="Pictures of at most so many switches, spread over sequences and runs.", min=0)
]
_Pictures = Annotated[bool, typer.Option("--pictures/--no-pictures", help="Show parts of the video.")]
_ModelOption = Annotated[
    str, typer.Option("-m", "--model", help="Measure this model's descriptors on the truth.", show_default="none")
]
_Provider = Annotated[str, typer.Option(help="Where the model runs: cpu, cuda or openvino.")]
_Threads = Annotated[int | None, typer.Option(help="Threads for one inference.", show_default="all processors", min=1)]


def report_command(
    runs: _Runs,
    truth: _Truth = None,
    output: _Output = Path("report.html"),
    overwrite: _Overwrite = False,
    protocol: _Protocol = "trackeval",
    benchmark: _Benchmark = "",
    classes: _Classes = "",
    class_names: _ClassNames = None,
    frames: _Frames = None,
    missing_as_empty: _Missing = False,
    max_switches: _MaxSwitches = 200,
    pictures: _Pictures = True,
    model: _ModelOption = "",
    provider: _Provider = "cpu",
    threads: _Threads = None,
) -> None:
    """Write one HTML page with which to judge tracks: scores, identities over time, every switch in pictures."""
    start = time.perf_counter()
    settings = ReportSettings(
        tuple(runs),
        truth,
        frames,
        protocol,
        benchmark,
        tuple(name.strip() for name in classes.split(",") if name.strip()),
        class_names,
        missing_as_empty,
        max_switches,
        pictures,
    )
    _check(settings, bool(model))
    check_output(output, overwrite)
    describer = Model(model, provider=provider, threads=threads, score_threshold=0.1) if model else None
    with StageScreen() as screen:
        judged = judge(settings, screen)
        views, notes = _illustrated(settings, judged, screen)
        described = None if describer is None else _described(describer, judged, screen)
        report = Report(
            title=_title(settings, judged),
            version=__version__,
            truth="" if truth is None else one_line(truth),
            runs=judged.facts,
            sources=judged.sources,
            scores=judged.scores,
            views=tuple(views),
            curves=judged.curves,
            descriptors=described,
            notes=(*judged.notes, *notes),
        )
        write_text(output, page_text(report))
    _print_end(output, report, time.perf_counter() - start)


report_command.__doc__ = f"{report_command.__doc__}\n{_EXAMPLES}"


def _check(settings: ReportSettings, has_model: bool) -> None:
    for name, value, choices in (
        ("protocol", settings.protocol, PROTOCOLS),
        ("benchmark", settings.benchmark, ("", *BENCHMARKS)),
    ):
        if value not in choices:
            raise ConfigError(f"--{name} {value!r}: expected one of {', '.join(filter(None, choices))}")
    if settings.benchmark and settings.protocol == "detrac":
        raise ConfigError("--benchmark goes with the protocol trackeval; UA-DETRAC's has no such rules")
    needing = {"--benchmark": settings.benchmark, "--classes": settings.classes, "--model": has_model}
    needing |= {"--class-names": settings.class_names, "--missing-as-empty": settings.missing_as_empty}
    if settings.truth is None and (given := [name for name, value in needing.items() if value]):
        raise ConfigError(f"{', '.join(given)}: only with truth; name it with --truth")


def _title(settings: ReportSettings, judged: Judged) -> str:
    if settings.truth is not None:
        return one_line(settings.truth.resolve().name or settings.truth)
    return ", ".join(one_line(run) for run in judged.facts)


def _illustrated(settings: ReportSettings, judged: Judged, screen: StageScreen) -> tuple[list[SequenceView], list[str]]:
    """The views with pictures, as far as there are any, and what is to be said about those that are not."""
    if not settings.has_pictures:
        return list(judged.views), ["Without pictures, as asked for (--no-pictures)."]
    total = sum(len(view.moments) for view in judged.views)
    wanted = choose_moments(judged.views, settings.max_switches)
    views, notes, absent = [], [], []
    for name, group in groupby(wanted, key=lambda one: one.view.sequence):
        mine = list(group)
        source = judged.pictures.get(name)
        if source is None:
            absent.append(name)
            views += [one.view for one in mine]
            continue

        def report(done: int, needed: int, name: str = name) -> None:
            screen.stage(f"pictures of {one_line(name)}", done, needed)

        try:
            made, said = illustrate(mine, source, report)
        except LookonceError as error:
            made, said = [one.view for one in mine], [str(error)]
        views += made
        notes += [f"Pictures of {name}: {one}." for one in said]
    if absent:
        remedy = "name them with --frames, or put them where they were"
        notes.insert(0, f"No pictures were found for {', '.join(absent)}; {remedy}.")
    shown = sum(bool(one.tiles) for view in views for one in view.moments)
    if shown and shown < total:
        what = "switches" if judged.scores is not None else "doubts"
        notes.append(f"{shown:,} of {total:,} {what} are shown in pictures (--max-switches {settings.max_switches}).")
    return views, notes


def _described(model: Model, judged: Judged, screen: StageScreen) -> Descriptors:
    """Descriptors on the sequences whose pictures can be found."""
    sequences, seen = [], set()
    for view in judged.views:
        if view.sequence not in seen and view.sequence in judged.pictures and view.truth is not None:
            pictures = judged.pictures[view.sequence]
            sequences.append(DescribedSequence(view.sequence, view.truth, pictures, view.clock))
        seen.add(view.sequence)
    if not sequences:
        raise ConfigError("--model needs the pictures of a sequence; name them with --frames, or leave --model away")
    return describe(model, sequences, lambda name, done, of: screen.stage(f"describe {one_line(name)}", done, of))


def _print_end(output: Path, report: Report, seconds: float) -> None:
    moments = [one for view in report.views for one in view.moments]
    total = len(moments) + sum(view.unlisted for view in report.views)
    shown = sum(bool(one.tiles) for one in moments)
    what = (
        _counted(len({view.sequence for view in report.views}), "sequence"),
        _counted(len(report.runs), "run"),
        _counted(total, "doubt") if report.scores is None else _counted(total, "identity switch", "es"),
    )
    size = output.stat().st_size / 1e6
    print(f"written {one_line(output)}: {size:.1f} MB, {', '.join(what)}, {shown:,} in pictures, in {seconds:.1f} s")


def _counted(count: int, name: str, more: str = "s") -> str:
    return f"{count:,} {name}{more if count != 1 else ''}"
