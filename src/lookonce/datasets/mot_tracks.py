"""Tracks as MOTChallenge text: results of any tracker, and the benchmarks' truth with every row of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lookonce.boxes import FARTHEST_PX
from lookonce.datasets.text import Table, fault, read_table, whole
from lookonce.datasets.track_rows import MAX_FRAMES, NO_CLASS, TrackRows, first_twins

__all__ = ["read_mot_results", "read_mot_truth"]

_COLUMNS = "frame, id, left, top, width, height"
_FLAG, _CLASS = 6, 7


def read_mot_results(path: Path) -> TrackRows:
    """The boxes of a result file: ``frame, id, left, top, width, height`` and maybe score, class and more.

    Frames count from 1 in the file. Rows may come in any order. An empty file is a result without boxes.

    Raises:
        FormatError: it breaks its format, a number cannot be, or a frame has an id twice.
    """
    rows, table = _read(path)
    size = table.values[:, 4:6]
    for column in (0, 1):
        table.check(size[:, column] >= 0, 4 + column, "width and height: expected 0 or more; mend or remove this box")
    return rows


def read_mot_truth(path: Path) -> TrackRows:
    """All rows of a benchmark's ``gt.txt``, also those that do not count: results have six columns, truth eight.

    Raises:
        FormatError: it breaks its format, a number cannot be, or a frame has an id twice.
    """
    rows, table = _read(path)
    if table.values.shape[1] <= _CLASS and len(rows):
        raise fault(
            path, int(table.lines[0]), "expected at least 8 columns, the seventh whether it counts, then a class"
        )
    size = table.values[:, 4:6]
    for column in (0, 1):
        table.check(size[:, column] > 0, 4 + column, "width and height: expected above 0; mend or remove this box")
    return rows


def _read(path: Path) -> tuple[TrackRows, Table]:
    table = read_table(path, _COLUMNS)
    values = table.values
    is_finite = np.isfinite(values[:, : _FLAG + 1])
    for column in range(is_finite.shape[1]):
        table.check(is_finite[:, column], column, f"expected a finite number in column {column + 1}")
    table.check(whole(values[:, 0]), 0, "frame: expected a whole number")
    table.check(values[:, 0] >= 1, 0, "frame: frames count from 1; add 1 to all of them")
    table.check(values[:, 0] <= MAX_FRAMES, 0, f"frame: expected up to {MAX_FRAMES:,}")
    table.check(whole(values[:, 1]), 1, "id: expected a whole number")
    table.check(values[:, 1] >= 0, 1, "id: expected 0 or more; -1 stands for detections, which are no tracks")
    xyxy = np.hstack([values[:, 2:4], values[:, 2:4] + values[:, 4:6]])
    is_near = np.abs(xyxy).max(axis=1, initial=0.0) <= FARTHEST_PX
    table.check(is_near, 2, f"expected a box within {FARTHEST_PX:,.0f} px; mend or remove this one, whose left is")
    labels = np.full(len(values), NO_CLASS, np.int64)
    if values.shape[1] > _CLASS and whole(values[:, _CLASS]).all():  # else a coordinate in the world
        labels = values[:, _CLASS].astype(np.int64)
    flags = values[:, _FLAG].copy() if values.shape[1] > _FLAG else np.ones(len(values))
    rows = TrackRows(values[:, 0].astype(np.int64) - 1, values[:, 1].astype(np.int64), xyxy, labels, flags)
    if twins := first_twins(rows.frames, rows.ids):
        first, second = twins
        where = f"a second time in frame {rows.frames[first] + 1} (first in line {table.lines[first]})"
        raise fault(path, int(table.lines[second]), f"id {rows.ids[first]} {where}; remove one of the two")
    return rows, table
