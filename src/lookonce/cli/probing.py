"""`lookonce probe`."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lookonce.cli.stages import StageScreen
from lookonce.datasets import LabelledSequence, open_sequences
from lookonce.errors import ConfigError
from lookonce.model import describe_model
from lookonce.models import find_model
from lookonce.output import prepare_output_folder
from lookonce.tracking import PaperConfig

if TYPE_CHECKING:
    from lookonce.make.probing import Measures, ProbeResult, Tally

__all__ = ["probe_command"]

_NO_EXTRA = "probe needs the extra 'train' ({} is missing); pip install 'lookonce[train]'"
_ASPECTS = {
    "time_gap": "time apart",
    "size_change": "change of size",
    "height": "lower height",
    "grid_change": "place in the detector",
}
_SOURCES = {
    "model file": "from the model file",
    "setting": "preset paper; the model file is not calibrated",
    "equal error rate": "of the equal error rate",
}

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce probe model.onnx MOT17-02/                        (MOTChallenge, CVAT, UA-DETRAC and KITTI layouts)

  lookonce probe model.onnx highway/ --frames highway.avi --min-gap 8f --max-gap 200f --rank-gap 48f

  lookonce probe model.onnx MOT17/train --boxes detections --score 0.3 -o out/
"""


def probe_command(
    model: Annotated[str, typer.Argument(metavar="MODEL", help="Model file with descriptors.", show_default=False)],
    data: Annotated[
        list[Path],
        typer.Argument(metavar="DATA...", help="Labelled sequences: folders or truth files.", show_default=False),
    ],
    frames: Annotated[
        Path | None,
        typer.Option(help="Pictures of a single sequence: a folder or a video.", show_default="as its layout says"),
    ] = None,
    boxes: Annotated[
        str, typer.Option(help="Describe the truth boxes, or the model's own detections of them: truth, detections.")
    ] = "truth",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for the results.", show_default="runs/probe-MODEL")
    ] = None,
    min_gap: Annotated[str, typer.Option(help="Compare boxes at least so far apart: seconds, or frames (30f).")] = (
        "0.5s"
    ),
    max_gap: Annotated[
        str, typer.Option(help="And less far than so many seconds, or at most so many frames (200f).")
    ] = "30s",
    rank_gap: Annotated[str, typer.Option(help="Rank 1 looks for each object so much later (2s, 48f).")] = "2s",
    classes: Annotated[
        str, typer.Option(help="Objects of these classes of the data only, separated by commas.", show_default="all")
    ] = "",
    every: Annotated[int, typer.Option(help="Take every n-th frame only.", min=1)] = 1,
    score: Annotated[float, typer.Option(help="Keep detections above this score.", min=0, max=1)] = 0.1,
    fps: Annotated[
        float | None, typer.Option(help="Frame rate of picture folders.", show_default="as the data says, else 25")
    ] = None,
    provider: Annotated[str, typer.Option(help="Where the model runs: cpu or cuda.")] = "cpu",
    threads: Annotated[
        int | None, typer.Option(help="Threads for one inference.", show_default="all processors", min=1)
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace earlier results in the folder.")] = False,
) -> None:
    """Measure how far the descriptors of a model file tell labelled objects apart, before any tracking.

    Writes neighbours.png (whom they take for whom), distances.png and probe.json.
    """
    try:
        from lookonce.make import probing
    except ModuleNotFoundError as exc:
        raise ConfigError(_NO_EXTRA.format(exc.name)) from exc
    path = find_model(model)
    settings = probing.ProbeSettings(
        boxes=boxes,
        limits=probing.GapLimits(*map(probing.Gap.parse, (min_gap, max_gap, rank_gap))),
        classes=tuple(name.strip() for name in classes.split(",") if name.strip()),
        every=every,
        score=score,
        fps=fps,
        match_threshold=_threshold_without_calibration(path),
    )
    sequences = probing.choose_classes(_open_data(data, frames), settings.classes)
    reader = probing.open_reader(path, boxes, score=score, provider=provider, threads=threads)
    folder = output or Path("runs") / f"probe-{path.stem}"
    prepare_output_folder(folder, probing.PROBE_FILES, overwrite)
    start = time.perf_counter()
    with StageScreen() as screen:
        result = probing.probe(reader, sequences, settings, on_frame=screen.stage)
        files = probing.write_report(folder, result, sequences, on_frame=screen.stage)
    _print_result(result, files, time.perf_counter() - start)


probe_command.__doc__ = f"{probe_command.__doc__}\n{_EXAMPLES}"


def _threshold_without_calibration(path: Path) -> float | None:
    """What a tracker takes where the model file says nothing; None where it does."""
    info = describe_model(path).descriptor
    return PaperConfig().match_threshold if info is None or info.match_threshold is None else None


def _open_data(data: list[Path], frames: Path | None) -> tuple[LabelledSequence, ...]:
    """All sequences of all DATA, in the order given."""
    if frames is not None and len(data) > 1:
        raise ConfigError(f"--frames fits one sequence only, and {len(data)} are given; name one")
    sequences = [sequence for path in data for sequence in open_sequences(path, pictures=frames)]
    seen: set[tuple[str, Path]] = set()
    for sequence in sequences:
        place = sequence.name, sequence.pictures.resolve()
        if place in seen:
            raise ConfigError(f"sequence {sequence.name} is given twice; name it once")
        seen.add(place)
    return tuple(sequences)


def _print_result(result: ProbeResult, files: tuple[Path, ...], seconds: float) -> None:
    """The closing tables, the advice and the files."""
    console = Console()
    console.print(_summary(result, seconds))
    if len(result.tallies) > 1:
        console.print(_sequences(result))
    console.print(_parts(result))
    console.print(result.advice, markup=False, highlight=False)
    for path in files:
        console.print(f"written {path}", markup=False, highlight=False, soft_wrap=True)


def _summary(result: ProbeResult, seconds: float) -> Table:
    """All sequences together."""
    overall, limits = result.overall, result.settings.limits
    names = ", ".join(tally.name for tally in result.tallies)
    table = Table(title=Text(f"{result.path.name} on {names}"), show_header=False, title_justify="left")
    for fact, value in _what_was_read(result, seconds).items():
        table.add_row(fact, Text(value))
    pairs = overall.pairs
    thinned = "" if pairs.share == 1 else f"; {pairs.share:.1%} of all"
    table.add_row(
        "pairs", f"{pairs.genuine_count:,} of one object, {pairs.impostor_count:,} of two, {limits} apart{thinned}"
    )
    rank = overall.rank_one
    after = f"after {limits.rank}"
    table.add_row(
        "rank 1",
        f"{_rate(rank.rate)} {after} (chance {_rate(rank.chance)}; {rank.queries:,} queries)"
        if rank.queries
        else f"- (no object is seen again {after})",
    )
    table.add_row("mAP", _rate(overall.retrieval.mean_average_precision))
    table.add_row("ROC AUC", _rate(overall.roc_auc))
    table.add_row(
        "equal error rate", f"{_rate(overall.equal_error_rate)} at distance {overall.equal_error_threshold:.3f}"
    )
    table.add_row("match threshold", f"{result.match_threshold:.3f} ({_SOURCES[result.threshold_source]})")
    table.add_row("  false accepts", f"{_rate(overall.false_accept_rate)} of the pairs of two objects are nearer")
    table.add_row("  false rejects", f"{_rate(overall.false_reject_rate)} of the pairs of one object are not")
    return table


def _what_was_read(result: ProbeResult, seconds: float) -> dict[str, str]:
    overall, tallies = result.overall, result.tallies
    frames, lost = sum(tally.frames for tally in tallies), sum(tally.lost_frames for tally in tallies)
    boxes, found = sum(tally.truth_boxes for tally in tallies), sum(tally.found_boxes for tally in tallies)
    unread = f", {lost} cannot be read" if lost else ""
    facts = {
        "objects": f"{overall.objects:,} boxes of {overall.identities:,} identities",
        "frames": f"{frames:,} in {seconds:.1f} s{unread}",
    }
    if result.settings.boxes == "detections":
        facts["found"] = f"{found / boxes:.1%} of {boxes:,} truth boxes, at score {result.settings.score:g}"
    if overall.objects < found:
        facts["without"] = f"{found - overall.objects:,} boxes have no descriptor and are left out"
    return facts


def _sequences(result: ProbeResult) -> Table:
    """A line for each sequence; found = share of the truth boxes."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("sequence", overflow="fold")
    headings = ["boxes", "ids", "rank 1", "chance", "mAP", "AUC", "EER"]
    if result.settings.boxes == "detections":
        headings.insert(2, "found")
    for heading in headings:
        table.add_column(heading, justify="right")
    for tally, measures in zip(result.tallies, result.by_sequence, strict=True):
        table.add_row(Text(tally.name), *_sequence_values(tally, measures, "found" in headings))
    return table


def _sequence_values(tally: Tally, measures: Measures, with_found: bool) -> list[str]:
    values = [f"{measures.objects:,}", f"{measures.identities:,}"]
    if with_found:
        values.append(_rate(tally.found_boxes / tally.truth_boxes if tally.truth_boxes else math.nan))
    rates = (
        measures.rank_one.rate,
        measures.rank_one.chance,
        measures.retrieval.mean_average_precision,
        measures.roc_auc,
        measures.equal_error_rate,
    )
    return values + [_rate(rate) for rate in rates]


def _parts(result: ProbeResult) -> Table:
    """The parts of the pairs that there are."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("pairs by", no_wrap=True)
    for heading in ("of one\nobject", "of two\nobjects", "EER", "AUC", "false\naccepts", "false\nrejects"):
        table.add_column(heading, justify="right")
    for by, parts in result.parts.items():
        table.add_row(_ASPECTS[by], style="bold")
        for part in parts:
            if part.genuine or part.impostor:
                table.add_row(
                    f"  {part.name}",
                    f"{part.genuine:,}",
                    f"{part.impostor:,}",
                    _rate(part.equal_error_rate),
                    _rate(part.roc_auc),
                    _rate(part.impostor_within),
                    _rate(1 - part.genuine_within),
                )
    return table


def _rate(value: float) -> str:
    """Three decimals, or a dash for what does not occur."""
    return "-" if math.isnan(value) else f"{value:.3f}"
