"""Rows of objects that are not confirmed yet; they get their identity when the object has one."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import GivenBack

__all__ = ["Waiting", "WaitingRow"]


@dataclass(frozen=True, slots=True)
class WaitingRow:
    """A row: its frame, its place there, box (4,) float32, score, label."""

    frame: int
    row: int
    xyxy: NDArray[np.float32]
    score: float
    label: int


class Waiting:
    """The rows that wait, by the serial number of their object.

    Args:
        most: of an object so many are kept, the latest.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self._rows: dict[int, deque[WaitingRow]] = {}

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[tuple[int, WaitingRow]]:
        """Each row with the serial number of its object."""
        return ((serial, row) for serial, rows in self._rows.items() for row in rows)

    def add(self, serial: int, row: WaitingRow) -> None:
        """One more row of an object."""
        self._rows.setdefault(serial, deque(maxlen=self.most)).append(row)

    def drop(self, serials: NDArray[np.int64]) -> None:
        """Objects (M,) that ended before they were confirmed."""
        for serial in serials.tolist():
            self._rows.pop(serial, None)

    def give_back(self, serials: NDArray[np.int64], ids: NDArray[np.int64], labels: NDArray[np.int64]) -> GivenBack:
        """The rows of those of the objects (M,) for which some wait, with their ids and labels."""
        numbers = serials.tolist()
        if self._rows.keys().isdisjoint(numbers):
            return GivenBack.nothing()
        found = [(place, serial) for place, serial in enumerate(numbers) if serial in self._rows]
        back = [(int(ids[place]), int(labels[place]), row) for place, serial in found for row in self._rows.pop(serial)]
        return GivenBack(
            np.array([row.frame for _, _, row in back]),
            np.array([row.row for _, _, row in back]),
            np.array([identity for identity, _, _ in back]),
            np.array([row.xyxy for _, _, row in back], np.float32),
            np.array([row.score for _, _, row in back], np.float32),
            np.array([label for _, label, _ in back]),
        )
