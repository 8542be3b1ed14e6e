"""Results as UA-DETRAC's toolkit reads them: four tables of frames by tracks, and the speed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import OutputError
from lookonce.output.append_only import AppendOnlyFile

__all__ = ["DETRAC_TABLES", "write_detrac_tables"]

DETRAC_TABLES = ("LX", "LY", "W", "H")
"""Left, top, width, height: a file each, ``NAME_LX.txt`` and so on."""

_MOST_ENTRIES = 20_000_000  # of a table, as many as the reader takes


def write_detrac_tables(
    folder: Path,
    name: str,
    frames: NDArray[np.int64],
    ids: NDArray[np.int64],
    ltwh: NDArray[np.float64],
    frame_count: int,
    speed: float | None = None,
) -> tuple[Path, ...]:
    """Write the tables of one sequence; 0 = absent. Columns are the ids in rising order.

    Args:
        folder: where to.
        name: of the sequence, such as MVI_20011.
        frames: (R,) int64, from 0, below ``frame_count``.
        ids: (R,) int64, each once a frame.
        ltwh: (R, 4) float64, px.
        frame_count: lines of the tables.
        speed: frames a second, for ``NAME_speed.txt``; None: no such file.

    Returns:
        The files.

    Raises:
        OutputError: they would be too large, or cannot be written.
    """
    known, columns = np.unique(ids, return_inverse=True)
    if frame_count * max(len(known), 1) > _MOST_ENTRIES:
        size = f"{frame_count:,} frames x {len(known):,} identities"
        raise OutputError(f"{folder / name}: {size} are too many for UA-DETRAC's tables; convert a part, or take mot")
    paths = []
    for number, table in enumerate(DETRAC_TABLES):
        values = np.zeros((frame_count, len(known)))
        values[frames, columns] = np.round(ltwh[:, number], 2)
        paths.append(folder / f"{name}_{table}.txt")
        lines = [",".join(f"{value:g}" if value == int(value) else f"{value:.2f}" for value in row) for row in values]
        _write(paths[-1], "\n".join(lines) + "\n" if len(known) else "")
    if speed is not None:
        paths.append(folder / f"{name}_speed.txt")
        _write(paths[-1], f"{speed:.2f}\n")
    return tuple(paths)


def _write(path: Path, text: str) -> None:
    file = AppendOnlyFile(path)
    file.append(text.encode("ascii"))
    file.close()
