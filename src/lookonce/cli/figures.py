"""The figures of an evaluation by stable names, and the tables that show them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from lookonce.errors import ConfigError
from lookonce.evaluation import DetracScores, TrackingScores
from lookonce.video.opening import one_line

__all__ = ["Column", "Scores", "choose_columns", "figures_of", "print_table"]

Scores = TrackingScores | DetracScores

_HOTA = (
    "hota", "det_a", "ass_a", "det_re", "det_pr", "ass_re", "ass_pr", "loc_a", "owta",
    "hota_0", "loc_a_0", "hota_loc_a_0",
)  # fmt: skip
_IDENTITY = ("idf1", "idp", "idr", "idtp", "idfn", "idfp")
_BOTH = (
    "mota", "motp", "motal", "recall", "precision", "false_positives_per_frame",
    "true_positives", "misses", "false_positives", "id_switches", "fragmentations",
    "mostly_tracked", "partly_tracked", "mostly_lost",
    "mostly_tracked_share", "partly_tracked_share", "mostly_lost_share",
)  # fmt: skip
_CLEAR = (*_BOTH, "moda", "smota", "f1")
_COUNTS = ("truth_boxes", "result_boxes", "objects", "tracks", "frames")


@dataclass(frozen=True, slots=True)
class Column:
    """A figure in a table: its heading, its stable name, and whether it is a share, shown in percent."""

    heading: str
    name: str
    is_share: bool = True

    def show(self, figures: Mapping[str, float]) -> str:
        """The figure as text."""
        value = figures[self.name]
        if self.is_share:
            return f"{100 * value:.1f}"
        return f"{value:,}" if isinstance(value, int) else f"{value:.3f}"


_COLUMNS = (
    Column("HOTA", "hota"),
    Column("DetA", "det_a"),
    Column("AssA", "ass_a"),
    Column("DetRe", "det_re"),
    Column("DetPr", "det_pr"),
    Column("AssRe", "ass_re"),
    Column("AssPr", "ass_pr"),
    Column("LocA", "loc_a"),
    Column("OWTA", "owta"),
    Column("HOTA0", "hota_0"),
    Column("LocA0", "loc_a_0"),
    Column("IDF1", "idf1"),
    Column("IDP", "idp"),
    Column("IDR", "idr"),
    Column("MOTA", "mota"),
    Column("MOTP", "motp"),
    Column("MOTAL", "motal"),
    Column("MODA", "moda"),
    Column("sMOTA", "smota"),
    Column("Rcll", "recall"),
    Column("Prcn", "precision"),
    Column("F1", "f1"),
    Column("IDSW", "id_switches", False),
    Column("Frag", "fragmentations", False),
    Column("TP", "true_positives", False),
    Column("FP", "false_positives", False),
    Column("FN", "misses", False),
    Column("FAR", "false_positives_per_frame", False),
    Column("MT", "mostly_tracked", False),
    Column("PT", "partly_tracked", False),
    Column("ML", "mostly_lost", False),
    Column("MT%", "mostly_tracked_share"),
    Column("PT%", "partly_tracked_share"),
    Column("ML%", "mostly_lost_share"),
    Column("boxes", "truth_boxes", False),
    Column("found", "result_boxes", False),
    Column("objects", "objects", False),
    Column("tracks", "tracks", False),
    Column("frames", "frames", False),
)
_USUAL = {
    "trackeval": "HOTA,DetA,AssA,IDF1,MOTA,MOTP,IDSW,Frag,FP,FN,MT,ML,boxes",
    "detrac": "MOTA,MOTP,Rcll,Prcn,IDSW,Frag,FP,FN,MT,PT,ML,boxes",
}


def figures_of(scores: Scores) -> dict[str, float]:
    """All figures by stable names: shares as 0 to 1 (MOTA may be negative), counts as whole numbers.

    The protocol ``detrac`` has no HOTA and no identity figures, and does not count tracks.
    """
    if isinstance(scores, DetracScores):
        tp, fn, fp = scores.true_positives, scores.misses, scores.false_positives
        objects = scores.mostly_tracked + scores.partly_tracked + scores.mostly_lost
        counts = {"truth_boxes": tp + fn, "result_boxes": tp + fp, "objects": objects, "frames": scores.frames}
        return {name: getattr(scores, name) for name in _BOTH} | counts
    found: dict[str, float] = {name: getattr(scores.hota, name) for name in _HOTA}
    found |= {name: getattr(scores.identity, name) for name in _IDENTITY}
    found |= {name: getattr(scores.clear, name) for name in _CLEAR}
    return found | {name: getattr(scores.counts, name) for name in _COUNTS}


def choose_columns(text: str, protocol: str) -> tuple[Column, ...]:
    """The columns of a list of headings or stable names; without one the protocol's usual ones.

    Raises:
        ConfigError: a name is unknown, or the protocol has no such figure.

    >>> [column.name for column in choose_columns("hota, IDSW", "trackeval")]
    ['hota', 'id_switches']
    """
    known = {word.casefold(): column for column in _COLUMNS for word in (column.name, column.heading)}
    has = {*_BOTH, *_COUNTS} - {"tracks"} if protocol == "detrac" else {*_HOTA, *_IDENTITY, *_CLEAR, *_COUNTS}
    chosen = []
    for word in (part.strip() for part in (text or _USUAL[protocol]).split(",")):
        column = known.get(word.casefold())
        if column is None:
            near = difflib.get_close_matches(word.casefold(), known, n=1)
            every = ", ".join(column.heading for column in _COLUMNS if column.name in has)
            hint = f"did you mean {known[near[0]].heading}?" if near else f"expected some of {every}"
            raise ConfigError(f"--columns: unknown column {word!r}; {hint}")
        if column.name not in has:
            raise ConfigError(f"--columns: the protocol {protocol} has no {column.heading}; leave it away")
        chosen.append(column)
    return tuple(chosen)


def print_table(
    heading: str,
    title: str,
    rows: Sequence[tuple[str, Mapping[str, float]]],
    columns: Sequence[Column],
    total: Mapping[str, float] | None = None,
    total_name: str = "combined",
) -> None:
    """A row for each name and its figures on stdout; where lines are not folded by a terminal, as wide as need be."""
    table = Table(
        title=Text(one_line(title)), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True
    )
    table.add_column(heading, overflow="fold")
    for column in columns:
        table.add_column(column.heading, justify="right", overflow="fold")
    for name, figures in rows:
        table.add_row(Text(one_line(name)), *(column.show(figures) for column in columns))
    if total is not None:
        table.add_section()
        table.add_row(Text(total_name, style="bold"), *(column.show(total) for column in columns))
    console = Console()
    if not console.is_terminal:
        needed = Measurement.get(console, console.options.update_width(10_000), table).maximum
        console = Console(width=max(console.width, needed))
    console.print(table)
