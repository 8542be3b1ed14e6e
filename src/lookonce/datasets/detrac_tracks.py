"""Tracks as UA-DETRAC's toolkit keeps them: four tables of frames by tracks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import FARTHEST_PX
from lookonce.datasets.text import check_size, fault, read_table
from lookonce.datasets.track_rows import NO_CLASS, TrackRows

__all__ = ["read_detrac_results"]

_TABLES = ("LX", "LY", "W", "H")  # left, top, width, height
_MAX_BYTES = 40_000_000  # 20 million entries
_MAX_LINE_BYTES = 1_000_000


def read_detrac_results(folder: Path, name: str) -> TrackRows:
    """The tracks of one sequence from ``NAME_LX.txt``, ``NAME_LY.txt``, ``NAME_W.txt`` and ``NAME_H.txt``.

    A line is a frame, a column a track; ids are the columns' numbers from 1. Where all four tables have 0 there is no
    box. Four empty files are a result without boxes.

    Args:
        folder: of one detector threshold.
        name: of the sequence, such as MVI_20011.

    Raises:
        FormatError: a file is missing or breaks its format, or two differ in size.
    """
    paths = [folder / f"{name}_{table}.txt" for table in _TABLES]
    tables = [_read(path) for path in paths]
    for path, table in zip(paths, tables, strict=True):
        if table.shape != tables[0].shape:
            sizes = " and ".join(
                f"{rows} frames x {columns} tracks" for rows, columns in (tables[0].shape, table.shape)
            )
            raise fault(path, 0, f"{paths[0].name} and this file differ: {sizes}; write all four anew")
    ltwh = np.stack(tables, axis=2)
    frames, columns = np.nonzero((ltwh != 0).any(axis=2))
    boxes = ltwh[frames, columns]
    xyxy = np.hstack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]])
    labels = np.full(len(frames), NO_CLASS, np.int64)
    return TrackRows(frames.astype(np.int64), columns.astype(np.int64) + 1, xyxy, labels, np.ones(len(frames)))


def _read(path: Path) -> NDArray[np.float64]:
    try:
        check_size(path, _MAX_BYTES)
    except OSError as exc:
        raise fault(path, 0, f"cannot be read ({exc.strerror}); check its permissions") from exc
    table = read_table(path, "a number for each track", _MAX_LINE_BYTES)
    is_near = np.abs(table.values) <= FARTHEST_PX / 2  # False also for NaN and infinity
    if not is_near.all():
        column = int(np.argwhere(~is_near)[0, 1])
        table.check(is_near[:, column], column, f"column {column + 1}: expected a number up to {FARTHEST_PX / 2:,.0f}")
    return table.values if len(table.values) else np.zeros((0, 0))
