"""`lookonce eval`."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer

from lookonce.cli.evaluated_results import (
    ResultFile,
    SequenceResult,
    digest,
    find_results,
    named_paths,
    threshold_folders,
)
from lookonce.cli.evaluated_runs import ClassChoice, EvaluatedRun, choose_classes, evaluate_run
from lookonce.cli.evaluated_truth import BENCHMARKS, TrueSequence, open_truth, thin
from lookonce.cli.evaluation_files import check_output, csv_text, json_text, write_text
from lookonce.cli.evaluation_screen import Limit, print_hints, print_left_out, print_pr, print_runs, shortfalls
from lookonce.cli.figures import Column, choose_columns, figures_of
from lookonce.cli.pr_curve import DetectorCurve, read_detector_curve
from lookonce.cli.stages import StageScreen
from lookonce.cli.sweeping import Sweeper, SweepSettings, parse_sweep
from lookonce.datasets import read_class_names
from lookonce.errors import ConfigError
from lookonce.evaluation import PROTOCOLS, DetracScores, PRScores, pr_scores
from lookonce.pipeline import detector_score
from lookonce.tracking.settings import choose_tracker
from lookonce.video.opening import one_line

__all__ = ["eval_command"]

_EXIT_BELOW = 1

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce eval --truth MOT17-02/ --results runs/MOT17-02

  Many sequences, MOTChallenge's rules; results are NAME.txt or NAME/tracks.txt in one folder:

  lookonce eval --truth MOT17/train --benchmark MOT17 --results runs/

  Two runs side by side, all figures also as files:

  lookonce eval --truth data/ --results old=runs-a/ --results new=runs-b/ --json figures.json --csv figures.csv

  UA-DETRAC's own protocol:

  lookonce eval --truth DETRAC-Test-Annotations-XML/ --results runs/ --protocol detrac

  In CI: exit status 1 where a figure falls below what you expect:

  lookonce eval --truth data/ --results runs/ --min-hota 0.5 --min-idf1 0.6 --max-switches 20

  What fewer frames cost:

  lookonce eval --truth MOT17-02/ --sweep every=1,2,4,8 --model model.onnx
"""

_CI = "In CI (exit status 1 where a run misses one)"
_SWEEP = "Tracking again"

_Truth = Annotated[Path, typer.Option("--truth", help="Labelled sequences: a folder or a truth file.")]
_Results = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[NAME=]PATH", help="MOT text, tracks.jsonl, or a folder of results by sequence; may be repeated."
    ),
]
_Protocol = Annotated[str, typer.Option(help="Whose figures: trackeval or detrac.")]
_Benchmark = Annotated[
    str, typer.Option(help=f"Follow the rules of {', '.join(BENCHMARKS)}.", show_default="every object counts")
]
_Frames = Annotated[
    Path | None,
    typer.Option(help="Pictures of a single sequence: a folder or a video.", show_default="as its layout says"),
]
_Classes = Annotated[
    str, typer.Option(help="Evaluate these classes only, names separated by commas.", show_default="all as one")
]
_PerClass = Annotated[bool, typer.Option("--per-class", help="Also each class by itself.")]
_ClassNames = Annotated[
    Path | None,
    typer.Option(help="Names of the class numbers in MOT results, one a line.", show_default="as the truth says"),
]
_Columns = Annotated[str, typer.Option(help="Figures to show, by heading.", show_default="the protocol's usual ones")]
_Missing = Annotated[
    bool, typer.Option("--missing-as-empty", help="A sequence without result, or a run without box, found nothing.")
]
_Json = Annotated[Path | None, typer.Option("--json", help="Write all figures as JSON.", show_default=False)]
_Csv = Annotated[Path | None, typer.Option("--csv", help="Write all figures as CSV.", show_default=False)]
_Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace these files.")]
_MinHota = Annotated[float | None, typer.Option(help="0 to 1.", min=0, max=1, rich_help_panel=_CI)]
_MinMota = Annotated[float | None, typer.Option(help="Up to 1.", max=1, rich_help_panel=_CI)]
_MinIdf1 = Annotated[float | None, typer.Option(help="0 to 1.", min=0, max=1, rich_help_panel=_CI)]
_MaxSwitches = Annotated[int | None, typer.Option(help="Identity switches.", min=0, rich_help_panel=_CI)]
_DetectorPr = Annotated[
    Path | None,
    typer.Option(
        "--detector-pr",
        help="For PR-MOTA, where --results holds a folder for each threshold: the detector's recall, precision.",
        show_default=False,
    ),
]
_Sweep = Annotated[str, typer.Option(metavar="every=1,2,4", help="Track on every n-th frame.", rich_help_panel=_SWEEP)]
_Model = Annotated[str, typer.Option("-m", "--model", help="Model file or name.", rich_help_panel=_SWEEP)]
_Tracker = Annotated[str, typer.Option(help="Tracking preset, or a TOML file.", rich_help_panel=_SWEEP)]
_Changes = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Change a setting of the tracker.", rich_help_panel=_SWEEP),
]
_Score = Annotated[
    float | None,
    typer.Option(
        help="Keep detections above this score.",
        min=0,
        max=1,
        show_default="0.1; paper: 0.25",
        rich_help_panel=_SWEEP,
    ),
]
_Provider = Annotated[str, typer.Option(help="Where the model runs: cpu, cuda or openvino.", rich_help_panel=_SWEEP)]
_Threads = Annotated[
    int | None,
    typer.Option(help="Threads for one inference.", show_default="shared out", min=1, rich_help_panel=_SWEEP),
]


@dataclass(frozen=True, slots=True)
class _Settings:
    """What is evaluated, and how."""

    truth: Path
    frames: Path | None
    protocol: str
    benchmark: str
    classes: tuple[str, ...]
    per_class: bool
    class_names: Path | None
    missing_as_empty: bool
    columns: tuple[Column, ...]
    limits: tuple[Limit, ...]
    json: Path | None
    csv: Path | None

    @property
    def rules(self) -> str:
        """In words, for titles."""
        parts = [f"protocol {self.protocol}", f"rules of {self.benchmark}" if self.benchmark else ""]
        return ", ".join([*filter(None, parts), *([f"only {', '.join(self.classes)}"] if self.classes else [])])


def eval_command(
    truth: _Truth = ...,  # type: ignore[assignment]
    results: _Results = None,
    protocol: _Protocol = "trackeval",
    benchmark: _Benchmark = "",
    frames: _Frames = None,
    classes: _Classes = "",
    per_class: _PerClass = False,
    class_names: _ClassNames = None,
    columns: _Columns = "",
    missing_as_empty: _Missing = False,
    json: _Json = None,
    csv: _Csv = None,
    overwrite: _Overwrite = False,
    min_hota: _MinHota = None,
    min_mota: _MinMota = None,
    min_idf1: _MinIdf1 = None,
    max_switches: _MaxSwitches = None,
    detector_pr: _DetectorPr = None,
    sweep: _Sweep = "",
    model: _Model = "street",
    tracker: _Tracker = "default",
    changes: _Changes = None,
    score: _Score = None,
    provider: _Provider = "cpu",
    threads: _Threads = None,
) -> None:
    """Score tracks against the truth: HOTA, IDF1, MOTA and all that belongs to them, each box accounted for."""
    _check_choices(protocol, benchmark)
    limits = {"hota": min_hota, "mota": min_mota, "idf1": min_idf1, "id_switches": max_switches}
    settings = _Settings(
        truth=truth,
        frames=frames,
        protocol=protocol,
        benchmark=benchmark,
        classes=tuple(name.strip() for name in classes.split(",") if name.strip()),
        per_class=per_class,
        class_names=class_names,
        missing_as_empty=missing_as_empty,
        columns=choose_columns(columns, protocol),
        limits=Limit.of(limits, protocol),
        json=json,
        csv=csv,
    )
    for path in (json, csv):
        check_output(path, overwrite)
    if sweep:
        if results or detector_pr:
            raise ConfigError("--sweep tracks by itself; leave --results and --detector-pr away")
        chosen = choose_tracker(tracker, changes or ())
        chosen_score = detector_score(chosen.config) if score is None else score
        swept = SweepSettings(parse_sweep(sweep), model, chosen, chosen_score, provider, threads)
        _run_sweep(settings, swept, tracker)
    else:
        _run_results(settings, results or [], detector_pr)


eval_command.__doc__ = f"{eval_command.__doc__}\n{_EXAMPLES}"


def _check_choices(protocol: str, benchmark: str) -> None:
    for name, value, choices in (("protocol", protocol, PROTOCOLS), ("benchmark", benchmark, ("", *BENCHMARKS))):
        if value not in choices:
            raise ConfigError(f"--{name} {value!r}: expected one of {', '.join(filter(None, choices))}")
    if benchmark and protocol == "detrac":
        raise ConfigError("--benchmark goes with the protocol trackeval; UA-DETRAC's has no such rules")


def _run_results(settings: _Settings, given: Sequence[str], detector_pr: Path | None) -> None:
    start = time.perf_counter()
    if not given:
        raise ConfigError("nothing to evaluate; give --results, or --sweep to track")
    paths = named_paths(given)
    thresholds = threshold_folders(next(iter(paths.values()))) if len(paths) == 1 else {}
    curve = _curve(settings, thresholds, detector_pr)
    truth, choice = _open(settings)
    names, is_chosen = [one.name for one in truth], bool(choice.labels)
    files = {
        name: find_results(path, names, may_miss=settings.missing_as_empty, with_classes=is_chosen)
        for name, path in (thresholds or paths).items()
    }
    runs: list[EvaluatedRun] = []
    with StageScreen() as screen:
        total = len(files) * len(truth)
        for name, by_sequence in files.items():

            def read(sequence: TrueSequence, found: dict[str, ResultFile] = by_sequence) -> SequenceResult:
                return found[sequence.name].read() if sequence.name in found else SequenceResult.empty()

            def report(done: int, before: int = len(runs) * len(truth)) -> None:
                if total > 1:
                    screen.stage("evaluate", before + done, total, "sequences" if len(files) == 1 else "results")

            run = evaluate_run(name, truth, read, by_sequence, settings.protocol, choice, report)
            if not thresholds:  # of which the highest may well leave nothing
                _refuse_empty(run, paths[name], settings)
            runs.append(run)
    pr = _pr(runs, curve)
    more: dict[str, object] = {}
    if curve is not None and pr is not None:
        source = {"file": one_line(curve.path), "sha256": digest([curve.path])}
        more["pr"] = {"formula": "trapezoid", "detector_pr": source, "figures": asdict(pr)}
    _finish(settings, truth, runs, more, start, pr=pr, heading="threshold" if thresholds else "run")


def _curve(settings: _Settings, thresholds: dict[str, Path], path: Path | None) -> DetectorCurve | None:
    """The detector's curve, checked against what it is for."""
    if path is not None and not (thresholds and settings.protocol == "detrac"):
        raise ConfigError(
            "--detector-pr needs --protocol detrac and one --results folder that holds 0.0, 0.1 ... 1.0, a folder each"
        )
    if thresholds and settings.limits:
        raise ConfigError("--min-... and --max-... need one result; name the folder of one threshold")
    return None if path is None else read_detector_curve(path, len(thresholds))


def _pr(runs: Sequence[EvaluatedRun], curve: DetectorCurve | None) -> PRScores | None:
    scores = [run.combined for run in runs if isinstance(run.combined, DetracScores)]
    return None if curve is None else pr_scores(scores, curve.precisions, curve.recalls)


def _open(settings: _Settings) -> tuple[tuple[TrueSequence, ...], ClassChoice]:
    truth = open_truth(settings.truth, frames=settings.frames, protocol=settings.protocol, benchmark=settings.benchmark)
    numbered = read_class_names(settings.class_names) if settings.class_names else ()
    return truth, choose_classes(truth, settings.classes, is_apart=settings.per_class, numbered=numbered)


def _refuse_empty(run: EvaluatedRun, path: Path, settings: _Settings) -> None:
    if not settings.missing_as_empty and not any(one.boxes for one in run.sequences):
        remedy = "check that tracking found anything, or give --missing-as-empty"
        raise ConfigError(f"{one_line(path)}: the results hold no box; {remedy}")


def _run_sweep(settings: _Settings, sweep: SweepSettings, tracker: str) -> None:
    start = time.perf_counter()
    truth, choice = _open(settings)
    for sequence in truth:
        if not os.path.exists(sequence.pictures):
            raise ConfigError(f"{one_line(sequence.pictures)}: no pictures to track; put them there, or name --frames")
    runs = []
    with StageScreen() as screen:
        sweeper = Sweeper(sweep, settings.classes, screen)
        for every in sweep.every:
            thinned = [thin(sequence, every) for sequence in truth]

            def track(sequence: TrueSequence, every: int = every) -> SequenceResult:
                return sweeper.track(sequence, every)

            runs.append(evaluate_run(f"every {every}", thinned, track, {}, settings.protocol, choice))
    model = {"file": sweeper.model.path.name, "sha256": sweeper.model.sha256}
    more: dict[str, object] = {
        "sweep": {
            "every": list(sweep.every),
            "model": model,
            "tracker": one_line(tracker),
            "settings": asdict(sweeper.config),
            "score": sweep.score,
        }
    }
    _finish(settings, truth, runs, more, start, heading="frames")


def _finish(
    settings: _Settings,
    truth: Sequence[TrueSequence],
    runs: Sequence[EvaluatedRun],
    more: dict[str, object],
    start: float,
    *,
    heading: str,
    pr: PRScores | None = None,
) -> None:
    """Tables, files, the closing line, and what falls short."""
    print_runs(runs, settings.columns, settings.rules, heading)
    if pr is not None:
        print_pr(pr)
    print_left_out(runs)
    print_hints(truth, settings.benchmark, settings.protocol)
    misses = shortfalls(settings.limits, runs)
    about: dict[str, object] = {
        "protocol": settings.protocol,
        "benchmark": settings.benchmark or None,
        "classes": list(settings.classes),
    }
    if settings.json:
        limits = [asdict(one) for one in settings.limits]
        more = {**more, "limits": limits, "falls_short": misses}
        write_text(settings.json, json_text(about, truth, runs, more))
    if settings.csv:
        write_text(settings.csv, csv_text(about, truth, runs))
    for path in filter(None, (settings.json, settings.csv)):
        print(f"written {one_line(path)}")
    frames = sum(int(figures_of(one.scores)["frames"]) for run in runs for one in run.sequences)
    several = f" x {len(runs)} runs" if len(runs) > 1 else ""
    plural = "s" if len(truth) > 1 else ""
    seconds = time.perf_counter() - start
    print(f"{len(truth)} sequence{plural}{several}, {frames:,} frames evaluated by {settings.rules} in {seconds:.1f} s")
    if misses:
        sys.stdout.flush()
        print(f"lookonce: {'; '.join(misses)}", file=sys.stderr)
        raise typer.Exit(_EXIT_BELOW)
