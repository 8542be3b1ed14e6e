"""`lookonce compare`."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from lookonce.cli.compare_detrac import compare_ua_detrac
from lookonce.cli.compare_rows import CompareRow
from lookonce.cli.compare_runs import ORACLE, Comparison, absence
from lookonce.cli.compare_scenes import (
    DetectionsOption,
    DetectionSource,
    ModelOption,
    Scene,
    check_given,
    gather,
    labels_of,
)
from lookonce.cli.compare_tables import (
    About,
    csv_text,
    json_text,
    markdown,
    print_rows,
    published_lines,
    published_markdown,
    show_table,
    where_made,
)
from lookonce.cli.evaluated_truth import BENCHMARKS, TrueSequence, open_truth
from lookonce.cli.evaluation_files import check_output, write_text
from lookonce.cli.figures import Column, choose_columns
from lookonce.cli.stages import StageScreen
from lookonce.cli.track_run import SHIPPED_MODEL
from lookonce.compare.contenders.registry import Contender, contenders
from lookonce.compare.crops import CropDescriber
from lookonce.compare.running import TrackerProcess
from lookonce.errors import ConfigError
from lookonce.evaluation import PROTOCOLS
from lookonce.make.given_boxes import BoxDescriber
from lookonce.model import Model, available_cpus
from lookonce.output.folder import prepare_output_folder
from lookonce.video.opening import one_line

__all__ = ["compare_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  Trackers on the same detections of a model, at four frame rates:

  lookonce compare --truth MOT17-02/ -m model+id.onnx --every 1,2,4,8

  On published detections; trackers that need descriptors are left out, or get those of a model at the boxes:

  lookonce compare --truth MOT17-02/ --detections MOT17-02/det/det.txt

  lookonce compare --truth MOT17-02/ --detections MOT17-02/det/det.txt -m street

  Some trackers only, and a second network on cut-out boxes:

  lookonce compare --truth data/ -m model+id.onnx --crops crops.onnx --trackers bytetrack,crops,lookonce-paper

  The publication's tables 1 and 2 again, with UA-DETRAC's folders:

  lookonce compare --ua-detrac DETRAC/ -m model+id.onnx --classes car,bus,truck

[bold]Comparators[/bold]  pip install 'lookonce\\[compare]'; those that are missing are named in the table.
"""
_EVERY = re.compile(r"[1-9][0-9]{0,5}(,[1-9][0-9]{0,5})*")
_COLUMNS = {"trackeval": "MOTA,MOTP,IDF1,HOTA,IDSW", "detrac": "MOTA,MOTP,Rcll,Prcn,IDSW"}
_LEAST_SCORE = 0.01  # of a model, where a sweep over thresholds begins at 0
_MARK = "results.json"  # tells a folder of ours from others

_Truth = Annotated[Path | None, typer.Option(help="Labelled sequences: a folder or a truth file.", show_default=False)]
_UaDetrac = Annotated[
    Path | None,
    typer.Option("--ua-detrac", help="UA-DETRAC's folders: the whole of its protocol.", show_default=False),
]
_Part = Annotated[str, typer.Option(help="With --ua-detrac: test or train.")]
_Frames = Annotated[Path | None, typer.Option(help="Pictures of a single sequence.", show_default="as its layout says")]
_Crops = Annotated[Path | None, typer.Option(help="Crop network of `lookonce fit-crops`.", show_default=False)]
_Trackers = Annotated[str, typer.Option(help="Names, separated by commas.", show_default="all")]
_Every = Annotated[str, typer.Option(metavar="1,2,4,8", help="Frame rates: every n-th frame.")]
_Classes = Annotated[str, typer.Option(help="Keep detections of these classes.", show_default="all")]
_Score = Annotated[float, typer.Option(help="Keep detections from this score on.", min=0.01, max=1)]
_Fps = Annotated[float | None, typer.Option(help="Of folders of pictures.", show_default="as stated there, or 25")]
_Protocol = Annotated[str, typer.Option(help="Whose figures: trackeval or detrac.")]
_Benchmark = Annotated[str, typer.Option(help=f"Follow the rules of {', '.join(BENCHMARKS)}.", show_default="none")]
_ColumnsOption = Annotated[str, typer.Option(help="Figures to show, by heading.", show_default="the usual ones")]
_Published = Annotated[bool, typer.Option("--published", help="Also tables as published (always with --ua-detrac).")]
_Limit = Annotated[float, typer.Option(help="Seconds a tracker may take for a sequence.", min=1)]
_Output = Annotated[Path, typer.Option("-o", "--output", help="Folder for every tracker's results as MOT text.")]
_Cache = Annotated[Path | None, typer.Option(help="Folder for detections.", show_default="detections in the output")]
_Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace earlier results; detections stay.")]
_Json = Annotated[Path | None, typer.Option("--json", help="Write everything as JSON.", show_default=False)]
_Csv = Annotated[Path | None, typer.Option("--csv", help="Write everything as CSV.", show_default=False)]
_Markdown = Annotated[bool, typer.Option("--markdown", help="Print tables as markdown, with what they were made by.")]
_Provider = Annotated[str, typer.Option(help="Where the model runs: cpu, cuda or openvino.")]
_Threads = Annotated[int | None, typer.Option(help="Threads for one inference.", show_default="all", min=1)]


@dataclass(frozen=True, slots=True)
class _Settings:
    """What is asked for."""

    every: tuple[int, ...]
    trackers: tuple[str, ...]
    protocol: str
    columns: tuple[Column, ...]
    score: float
    is_swept: bool
    limit_s: float
    output: Path
    has_published: bool
    is_markdown: bool
    json: Path | None
    csv: Path | None


def compare_command(
    truth: _Truth = None,
    ua_detrac: _UaDetrac = None,
    part: _Part = "test",
    model: ModelOption = None,
    detections: DetectionsOption = None,
    frames: _Frames = None,
    crops: _Crops = None,
    trackers: _Trackers = "",
    every: _Every = "1",
    classes: _Classes = "",
    score: _Score = 0.1,
    fps: _Fps = None,
    protocol: _Protocol = "trackeval",
    benchmark: _Benchmark = "",
    columns: _ColumnsOption = "",
    published: _Published = False,
    time_limit: _Limit = 300.0,
    output: _Output = Path("runs/compare"),
    cache: _Cache = None,
    overwrite: _Overwrite = False,
    json: _Json = None,
    csv: _Csv = None,
    as_markdown: _Markdown = False,
    provider: _Provider = "cpu",
    threads: _Threads = None,
) -> None:
    """Hold trackers against each other: the same detections, the same truth, one machine, each stage timed."""
    start = time.perf_counter()
    if (truth is None) == (ua_detrac is None):
        raise ConfigError("nothing to compare on; give --truth, or --ua-detrac with its folders")
    protocol = "detrac" if ua_detrac is not None else protocol
    _check_choices(protocol, benchmark, part)
    settings = _Settings(
        every=_parse_every(every, may_differ=ua_detrac is None),
        trackers=_parse_trackers(trackers),
        protocol=protocol,
        columns=choose_columns(columns or _COLUMNS[protocol], protocol),
        score=score if ua_detrac is None else _LEAST_SCORE,
        is_swept=ua_detrac is not None,
        limit_s=time_limit,
        output=output,
        has_published=published,
        is_markdown=as_markdown,
        json=json,
        csv=csv,
    )
    for path in (json, csv):
        check_output(path, overwrite)
    where = truth or _annotations(ua_detrac, part)
    sequences = open_truth(where, frames=frames, protocol=protocol, benchmark=benchmark)
    cache = cache or output / "detections"
    source = _source(model, detections, crops, classes, fps, cache, settings, provider, threads)
    prepare_output_folder(output, [_MARK], overwrite)
    _compare(settings, source, sequences, start)


compare_command.__doc__ = f"{compare_command.__doc__}\n{_EXAMPLES}"


def _compare(settings: _Settings, source: DetectionSource, sequences: Sequence[TrueSequence], start: float) -> None:
    about = _about(settings, source, sequences)
    run = _run_ua_detrac if settings.is_swept else _run
    rows = run(settings, source, sequences, about)
    _write(settings, rows, about)
    of = f"{len(rows)} rows on {len(sequences)} sequence{'s' * (len(sequences) > 1)} by protocol {settings.protocol}"
    print(f"{of} in {time.perf_counter() - start:.0f} s; {one_line(settings.output)}")


def _check_choices(protocol: str, benchmark: str, part: str) -> None:
    choices = (
        ("protocol", protocol, PROTOCOLS),
        ("benchmark", benchmark, ("", *BENCHMARKS)),
        ("part", part, ("test", "train")),
    )
    for name, value, known in choices:
        if value not in known:
            raise ConfigError(f"--{name} {value!r}: expected one of {', '.join(filter(None, known))}")
    if benchmark and protocol == "detrac":
        raise ConfigError("--benchmark goes with the protocol trackeval; UA-DETRAC's has no such rules")


def _parse_every(text: str, *, may_differ: bool) -> tuple[int, ...]:
    numbers = tuple(int(one) for one in text.split(",")) if _EVERY.fullmatch(text) else ()
    if not numbers or len(set(numbers)) < len(numbers):
        raise ConfigError(f"--every {text!r}: expected different whole numbers such as 1,2,4,8")
    if numbers != (1,) and not may_differ:
        raise ConfigError("--every does not go with --ua-detrac, whose protocol takes every frame")
    return numbers


def _parse_trackers(text: str) -> tuple[str, ...]:
    """The names asked for, all without; ``paper`` stands for ``lookonce-paper``."""
    known = [*contenders(), ORACLE]
    if not text:
        return tuple(known)
    wanted = [name.strip() for name in text.split(",") if name.strip()]
    wanted = [f"lookonce-{name}" if name not in known and f"lookonce-{name}" in known else name for name in wanted]
    for name in wanted:
        if name not in known:
            raise ConfigError(f"--trackers: no tracker {name!r}; expected some of {', '.join(known)}")
    missing = [one for one in wanted if one != ORACLE and not contenders()[one].is_installed]
    if wanted and missing == wanted:
        raise ConfigError(f"--trackers: not installed: {', '.join(missing)}; pip install 'lookonce[compare]'")
    return tuple(dict.fromkeys(wanted))


def _annotations(root: Path | None, part: str) -> Path:
    """The folder with the XML of one part of UA-DETRAC."""
    assert root is not None
    wanted = f"detrac-{part}-annotations-xml"
    found = [one for one in sorted(root.glob("*")) if one.is_dir() and one.name.casefold().startswith(wanted)]
    if len(found) != 1:
        remedy = f"expected one folder DETRAC-{part.capitalize()}-Annotations-XML; see docs/ua-detrac.md"
        raise ConfigError(f"{one_line(root)}: {len(found)} folders of annotations of the part {part}; {remedy}")
    return found[0]


def _source(
    model: str | None,
    detections: Path | None,
    crops: Path | None,
    classes: str,
    fps: float | None,
    cache: Path,
    settings: _Settings,
    provider: str,
    threads: int | None,
) -> DetectionSource:
    names = [name.strip() for name in classes.split(",") if name.strip()]
    threads = threads or available_cpus()
    every = settings.every if any(one.follows_camera for one in _chosen(settings)) else ()
    if detections is not None:
        if crops is not None or names:
            raise ConfigError("--crops and --classes go with a model's detections; files have neither")
        check_given(detections)
        reader = None if model is None else BoxDescriber(model, provider=provider, threads=threads)
        return DetectionSource(
            None, detections, None, (), fps, cache, describer=reader, every=every, camera_score=settings.score
        )
    detector = Model(model or SHIPPED_MODEL, provider=provider, threads=threads, score_threshold=settings.score)
    describer = CropDescriber(crops, threads) if crops is not None else None
    labels = labels_of(detector, names)
    return DetectionSource(detector, None, describer, labels, fps, cache, every=every, camera_score=settings.score)


def _about(settings: _Settings, source: DetectionSource, sequences: Sequence[TrueSequence]) -> dict[str, object]:
    chosen = [one for name, one in contenders().items() if name in settings.trackers and one.version]
    packages = {one.package: one.version for one in chosen}
    return {
        "protocol": settings.protocol,
        "sequences": [one.name for one in sequences],
        "score": settings.score,
        **_given(source),
        **where_made(packages),
    }


def _given(source: DetectionSource) -> dict[str, object]:
    """Where detections and descriptors come from."""
    given: dict[str, object] = {"detections": one_line(source.files)} if source.files else {}
    looking = source.model or source.describer
    if looking is not None:
        given |= {"model": one_line(looking.path.name), "model_sha256": looking.sha256}
    if source.model is not None:
        given["classes"] = [source.model.names[label] for label in source.labels]
    return given


def _run(
    settings: _Settings, source: DetectionSource, sequences: Sequence[TrueSequence], about: About
) -> list[CompareRow]:
    rows: list[CompareRow] = []
    with StageScreen() as screen:
        scenes = gather(sequences, source, screen)
        comparison = Comparison(scenes, settings.protocol, source.labels, settings.score, settings.limit_s, screen)
        for contender in _chosen(settings):
            rows += _all_rates(comparison, contender, settings, scenes)
        if ORACLE in settings.trackers:
            rows += [comparison.oracle(every, _folder(settings, ORACLE, every)) for every in settings.every]
    rows.sort(key=lambda row: settings.every.index(row.every))
    title = f"{', '.join(about_names(sequences))}: protocol {settings.protocol}, {_detections_in_words(about)}"
    if settings.is_markdown:
        print(_made_by(about))
        print(markdown(title, rows, settings.columns))
        if settings.has_published:
            print(published_markdown())
    else:
        print_rows(title, rows, settings.columns)
        for name, heads, lines in published_lines() if settings.has_published else ():
            show_table(name, heads, lines)
    return rows


def about_names(sequences: Sequence[TrueSequence]) -> list[str]:
    """Names for a title: few of them."""
    names = [one_line(one.name) for one in sequences]
    return names if len(names) <= 3 else [f"{len(names)} sequences"]


def _detections_in_words(about: About) -> str:
    if "detections" in about:
        read = f", descriptors of {about['model']} at their boxes" if "model" in about else ""
        return f"detections of {about['detections']}{read}"
    classes = about["classes"]
    only = f", classes {', '.join(classes)}" if isinstance(classes, list) and classes else ""
    return f"detections of {about['model']} from score {about['score']}{only}"


def _made_by(about: About) -> str:
    """The lines above a table in markdown."""
    return "".join(
        f"- {name}: `{about[name]}`\n" for name in ("command", "machine", "versions", "commit") if name in about
    )


def _chosen(settings: _Settings) -> list[Contender]:
    known = contenders()
    return [known[name] for name in settings.trackers if name in known]


def _folder(settings: _Settings, name: str, every: int) -> Path:
    return settings.output / f"every-{every}" / name


def _all_rates(
    comparison: Comparison, contender: Contender, settings: _Settings, scenes: Sequence[Scene]
) -> list[CompareRow]:
    """A tracker at all frame rates, in one process."""
    note = absence(contender, scenes)
    with TrackerProcess(contender, settings.limit_s) as process:
        return [
            comparison.run(process, every, _folder(settings, contender.name, every), note=note)
            for every in settings.every
        ]


def _run_ua_detrac(
    settings: _Settings, source: DetectionSource, sequences: Sequence[TrueSequence], about: About
) -> list[CompareRow]:
    with StageScreen() as screen:
        scenes = gather(sequences, source, screen)
        comparison = Comparison(scenes, "detrac", source.labels, 0.0, settings.limit_s, screen)
        result = compare_ua_detrac(comparison, _chosen(settings), ORACLE in settings.trackers, settings.output)
    title = f"{', '.join(about_names(sequences))}: protocol detrac, {_detections_in_words(about)}"
    result.show(title, settings.columns, _made_by(about) if settings.is_markdown else "")
    return list(result.every_row)


def _write(settings: _Settings, rows: Sequence[CompareRow], about: About) -> None:
    text = json_text(about, rows)
    write_text(settings.output / _MARK, text)
    if settings.json:
        write_text(settings.json, text)
    if settings.csv:
        write_text(settings.csv, csv_text(about, rows))
    sys.stdout.flush()
    for path in filter(None, (settings.json, settings.csv)):
        print(f"written {one_line(path)}")
