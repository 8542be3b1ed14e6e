"""A detector's precision and recall at rising thresholds, for UA-DETRAC's PR figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets.text import fault, read_table

__all__ = ["DetectorCurve", "read_detector_curve"]


@dataclass(frozen=True, slots=True)
class DetectorCurve:
    """Of the whole set, at the thresholds of the tracker's results.

    Attributes:
        path: the file that says so.
        recalls: (T,) float64, 0 to 1.
        precisions: (T,) float64, 0 to 1.
    """

    path: Path
    recalls: NDArray[np.float64]
    precisions: NDArray[np.float64]


def read_detector_curve(path: Path, thresholds: int) -> DetectorCurve:
    """Reads recall and precision, a line a threshold, as UA-DETRAC's toolkit writes ``*_detection_PR.txt``.

    Raises:
        FormatError: it breaks its format, or has another number of lines than there are thresholds.
    """
    table = read_table(path, "recall, precision")
    if len(table.values) != thresholds:
        message = f"{len(table.values)} lines for {thresholds} folders of results; expected a line for each threshold"
        raise fault(path, 0, message)
    for column in (0, 1):
        values = table.values[:, column]
        table.check((values >= 0) & (values <= 1), column, f"column {column + 1}: expected a share from 0 to 1")
    return DetectorCurve(path, table.values[:, 0].copy(), table.values[:, 1].copy())
