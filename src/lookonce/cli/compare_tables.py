"""What `lookonce compare` shows and writes: tables on the screen and in markdown, JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
import platform
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from lookonce import __version__
from lookonce.cli.compare_rows import CompareRow, cells, headings, notes
from lookonce.cli.figures import Column, figures_of
from lookonce.compare.published import PUBLISHED, PUBLISHED_PR, PUBLISHED_SPEED
from lookonce.model import available_cpus

__all__ = [
    "About",
    "csv_text",
    "json_text",
    "markdown",
    "markdown_table",
    "print_rows",
    "published_lines",
    "published_markdown",
    "show_table",
    "where_made",
]

_FORMAT = {"format": "lookonce-comparison", "format_version": 1}

About = Mapping[str, object]
"""What the figures depend on: protocol, model, detections, versions."""

_Lines = tuple[list[str], list[list[str]]]


def print_rows(
    title: str, rows: Sequence[CompareRow], columns: Sequence[Column], noted: Sequence[CompareRow] = ()
) -> None:
    """A table on the screen, and the notes of its rows, or of ``noted``."""
    show_table(title, *_lines(rows, columns))
    for note in notes(noted or rows):
        Console().print(note, markup=False, highlight=False, soft_wrap=True)


def markdown(
    title: str, rows: Sequence[CompareRow], columns: Sequence[Column], noted: Sequence[CompareRow] = ()
) -> str:
    """The same table as text for a page."""
    listed = "".join(f"- {note}\n" for note in notes(noted or rows))
    return markdown_table(title, *_lines(rows, columns)) + (f"\n{listed}" if listed else "")


def _lines(rows: Sequence[CompareRow], columns: Sequence[Column]) -> _Lines:
    has_every = len({row.every for row in rows}) > 1
    has_pr = any(row.pr is not None for row in rows)
    options = {"has_pr": has_pr, "has_every": has_every}
    found = [cells(row, columns, **options) for row in rows]
    return headings(columns, **options), found


def show_table(title: str, names: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on stdout; where lines are not folded by a terminal, as wide as need be."""
    table = Table(title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for number, name in enumerate(names):
        table.add_column(name, justify="right" if number else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console = Console()
    if not console.is_terminal:
        needed = Measurement.get(console, console.options.update_width(10_000), table).maximum
        console = Console(width=max(console.width, needed))
    console.print(table)


def markdown_table(title: str, names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Any table as text for a page."""
    return f"**{title}**\n\n{_markdown(names, rows)}"


def _markdown(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    rule = ["---", *(["---:"] * (len(names) - 1))]
    lines = [names, rule, *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def published_lines() -> list[tuple[str, list[str], list[list[str]]]]:
    """Tables of published figures: title, headings, rows."""
    quality = [
        [one.detector, one.tracker, f"{100 * one.mota:.1f}", f"{100 * (one.motp or 0):.1f}"] for one in PUBLISHED
    ]
    ranked = [[one.detector, one.tracker, f"{100 * one.mota:.1f}"] for one in PUBLISHED_PR]
    speed = [[one.method, f"{one.fps:g}"] for one in PUBLISHED_SPEED]
    return [
        ("as published, not made here: the publication's table 1", ["detector", "tracker", "MOTA", "MOTP"], quality),
        ("as published, not made here: UA-DETRAC's test server", ["detector", "tracker", "PR-MOTA"], ranked),
        ("as published, not made here: the publication's table 2", ["method", "fps"], speed),
    ]


def published_markdown() -> str:
    """The published tables for a page."""
    return "\n".join(markdown_table(*table) for table in published_lines())


def where_made(packages: Mapping[str, str]) -> dict[str, str]:
    """Command, machine, versions and commit behind the figures; ``packages`` of the comparators, by name."""
    made = {
        "command": shlex.join(["lookonce", *sys.argv[1:]]),
        "machine": f"{_processor()}, {available_cpus()} processors, {platform.system()}",
        "versions": ", ".join(
            f"{name} {number}"
            for name, number in {
                "Python": platform.python_version(),
                "lookonce": __version__,
                "numpy": version("numpy"),
                "onnxruntime": version("onnxruntime"),
                **packages,
            }.items()
        ),
    }
    commit = _commit()
    return {**made, "commit": commit} if commit else made


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return named or platform.processor() or platform.machine()


def _commit() -> str:
    """Of the checkout that the package runs from; "" where it is none."""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return found.stdout.strip() if not found.returncode else ""


def json_text(about: About, rows: Sequence[CompareRow]) -> str:
    """Everything as JSON; shares as 0 to 1, times as seconds a frame."""
    content = {**_FORMAT, "version": __version__, **about, "rows": [_record(row) for row in rows]}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _record(row: CompareRow) -> dict[str, object]:
    run = row.run
    return {
        "tracker": row.name,
        "title": row.title,
        "every": row.every,
        "threshold": row.threshold,
        "min_score": row.min_score,
        "note": row.note or None,
        "figures": None if run is None else figures_of(run.combined),
        "left_out": {} if run is None else dict(sorted(run.combined.left_out.items())),
        "sequences": {} if run is None else {one.name: figures_of(one.scores) for one in run.sequences},
        "pr": None if row.pr is None else asdict(row.pr),
        "seconds_a_frame": None if row.speed is None else asdict(row.speed),
    }


def csv_text(about: About, rows: Sequence[CompareRow]) -> str:
    """A line for each row; shares as 0 to 1, times as seconds a frame."""
    known = next((figures_of(row.run.combined) for row in rows if row.run is not None), {})
    speed = ("detect_s", "describe_s", "associate_s", "associate_cpu_s", "peak_mb")
    fixed = ("version", "protocol", "tracker", "every", "threshold", "min_score", "note", "pr_mota")
    text = io.StringIO()
    writer = csv.DictWriter(text, [*fixed, *known, *speed], lineterminator="\n", restval="")
    writer.writeheader()
    for row in rows:
        line: dict[str, object] = {
            "version": __version__,
            "protocol": about["protocol"],
            "tracker": row.name,
            "every": row.every,
            "threshold": "" if row.threshold is None else row.threshold,
            "min_score": row.min_score,
            "note": row.note,
            "pr_mota": "" if row.pr is None else row.pr.mota,
        }
        if row.run is not None:
            line |= figures_of(row.run.combined)
        if row.speed is not None:
            line |= {name: getattr(row.speed, name) for name in speed}
        writer.writerow(line)
    return text.getvalue()
