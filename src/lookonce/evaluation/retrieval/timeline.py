"""Which rows are compared with which, in blocks of bounded size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lookonce.distances import Quantized, distances, quantize
from lookonce.evaluation.retrieval.objects import DescribedObjects

__all__ = ["Pairs", "Timeline", "Windows", "check_gaps", "spread_evenly"]

_BLOCK_ENTRIES = 1 << 20  # distances held at once: 8 MB, and as much again for each column of the pairs
_BLOCK_QUERIES = 256  # more make the matrix product no faster
_GOLDEN_RATIO = 0.6180339887498949


class Windows(NamedTuple):
    """For each query (Q,) int64 the places of its gallery: from ``starts`` up to and without ``ends``."""

    starts: NDArray[np.int64]
    ends: NDArray[np.int64]


class Pairs(NamedTuple):
    """Pairs of rows and how far apart they are: (P,) int64, (P,) int64, (P,) float64."""

    queries: NDArray[np.int64]
    others: NDArray[np.int64]
    distances: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Timeline:
    """All rows in order of sequence, frame, identity and row, on one clock; a *place* is an index into that order.

    Attributes:
        rows: (N,) int64, the row of the objects at each place.
        clock: (N,) int64, never falling; frames of one sequence lie as far apart as in the sequence, those of two
            sequences farther than any two of one.
        descriptors: N rows in this order.
        longest_gap: the largest distance in frames within a sequence.
    """

    rows: NDArray[np.int64]
    clock: NDArray[np.int64]
    descriptors: Quantized
    longest_gap: int

    @classmethod
    def of(cls, objects: DescribedObjects) -> Timeline:
        """The timeline of these objects; no objects give an empty one."""
        rows = np.lexsort((objects.identities, objects.frames, objects.sequences)).astype(np.int64)
        frames = objects.frames[rows]
        span = int(frames.max() - frames.min()) if len(frames) else 0
        _, sequence = np.unique(objects.sequences[rows], return_inverse=True)
        clock = sequence.astype(np.int64) * (2 * span + 1) + frames
        return cls(rows, clock, quantize(objects.descriptors[rows]), span)

    def __len__(self) -> int:
        return len(self.rows)

    def later(self, places: NDArray[np.int64], min_gap_frames: int, max_gap_frames: int) -> Windows:
        """The places whose frame is that many frames later; in the same frame (gap 0), those after the place itself."""
        least, most = self._gaps(min_gap_frames, max_gap_frames)
        now = self.clock[places]
        starts = np.maximum(np.searchsorted(self.clock, now + least, "left"), places + 1)
        return Windows(starts, np.searchsorted(self.clock, now + most, "right"))

    def around(self, places: NDArray[np.int64], max_gap_frames: int) -> Windows:
        """The places, itself included, whose frame is at most that many frames earlier or later."""
        _, most = self._gaps(0, max_gap_frames)
        now = self.clock[places]
        return Windows(
            np.searchsorted(self.clock, now - most, "left"), np.searchsorted(self.clock, now + most, "right")
        )

    def _gaps(self, min_gap_frames: int, max_gap_frames: int) -> tuple[int, int]:
        check_gaps(min_gap_frames, max_gap_frames)
        # Beyond the longest gap there is nothing, and a wider window would reach into the next sequence.
        return min(min_gap_frames, self.longest_gap + 1), min(max_gap_frames, self.longest_gap)

    def pairs(self, places: NDArray[np.int64], windows: Windows) -> Iterator[Pairs]:
        """Each place with every place of its window, in blocks; the pairs of one place are together in one block.

        Args:
            places: (Q,) int64, rising.
            windows: (Q,), starts and ends never falling.
        """
        for block in _blocks(windows):
            starts, ends = windows.starts[block], windows.ends[block]
            first, last = int(starts[0]), int(ends.max())
            lengths = ends - starts
            if not lengths.any():
                continue
            queries = np.repeat(np.arange(len(lengths)), lengths)
            offsets = starts - first - (np.cumsum(lengths) - lengths)
            others = np.arange(len(queries)) + np.repeat(offsets, lengths)
            found = distances(self.descriptors.part(places[block]), self.descriptors.part(slice(first, last)))
            yield Pairs(self.rows[places[block]][queries], self.rows[first:last][others], found[queries, others])


def _blocks(windows: Windows) -> Iterator[slice]:
    """Runs of queries whose galleries, taken together, make a block of bounded size; one query is always a block."""
    begin = first = end = 0
    for query, (start, stop) in enumerate(zip(windows.starts.tolist(), windows.ends.tolist(), strict=True)):
        count = query - begin + 1
        end = max(end, stop)
        if count > 1 and (count > _BLOCK_QUERIES or count * (end - first) > _BLOCK_ENTRIES):
            yield slice(begin, query)
            begin, count = query, 1
        if count == 1:
            first, end = start, stop
    if len(windows.starts):
        yield slice(begin, len(windows.starts))


def check_gaps(min_gap_frames: int, max_gap_frames: int) -> None:
    """Raise ``ValueError`` unless these are the limits of a range of gaps."""
    if not 0 <= min_gap_frames <= max_gap_frames:
        raise ValueError(f"expected 0 <= min_gap_frames <= max_gap_frames, got {min_gap_frames} and {max_gap_frames}")


def spread_evenly(count: int, most: int) -> NDArray[np.int64]:
    """At most ``most`` of ``count`` places, rising, evenly spread and in step with no period.

    Every sixth place could be the same object in every frame; steps of the golden ratio never fall into such a step.

    >>> spread_evenly(10, 4).tolist(), spread_evenly(3, 4).tolist()
    ([0, 2, 5, 7], [0, 1, 2])
    """
    if count <= most:
        return np.arange(count)
    phase = np.arange(count) * _GOLDEN_RATIO % 1.0
    return np.sort(np.argsort(phase, kind="stable")[:most])
