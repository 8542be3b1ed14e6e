"""Which true boxes and which boxes of a result overlap, frame by frame, in pieces of bounded size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import FARTHEST_PX, iou_of_pairs

__all__ = ["Boxes", "Pairs", "Scene", "by_id", "overlapping_pairs"]

_PIECE_ENTRIES = 1 << 21  # of the tables truth x result of all frames of a piece
_FRAME_SPACING = 8.0 * FARTHEST_PX  # more than any two boxes of a frame lie apart
_DENSE_IDS = 8  # times as many numbers as rows: then a table of numbers is faster than sorting
_EPS = np.finfo(np.float64).eps


@dataclass(frozen=True, slots=True)
class Boxes:
    """One side of a sequence, by frame; within a frame in the given order. N rows, F frames.

    Attributes:
        starts: (F + 1,) int64, where each frame's rows start, and N.
        frames: (N,) int64, the frame of each row, rising.
        ids: (N,) int64, from 0 without gaps.
        columns: (4, N) float64, left, top, right and bottom in px.
        count: how many ids there are.
    """

    starts: NDArray[np.int64]
    frames: NDArray[np.int64]
    ids: NDArray[np.int64]
    columns: NDArray[np.float64]
    count: int

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def of(
        cls,
        frames: NDArray[np.int64],
        ids: NDArray[np.int64],
        xyxy: NDArray[np.float64],
        rows: NDArray[np.int64],
        total: int,
    ) -> Boxes:
        """The chosen ``rows`` of the others sorted by frame (0 to ``total`` - 1), ids numbered anew in their order."""
        order = rows[np.argsort(frames[rows], kind="stable")]
        frames = frames[order]
        starts = np.searchsorted(frames, np.arange(total + 1)).astype(np.int64)
        numbers, count = _numbered(ids[order])
        return cls(starts, frames, numbers, np.ascontiguousarray(xyxy[order].T), count)


def _numbered(ids: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """The ids numbered anew from 0 without gaps, in their order, and how many there are."""
    lowest = int(ids.min(initial=0))
    if int(ids.max(initial=0)) - lowest > _DENSE_IDS * len(ids):
        known, numbers = np.unique(ids, return_inverse=True)
        return numbers.astype(np.int64), len(known)
    is_used = np.bincount(ids - lowest) > 0
    return (np.cumsum(is_used) - 1)[ids - lowest], int(is_used.sum())


def by_id(ids: NDArray[np.int64]) -> NDArray[np.int64]:
    """The order of rows by id, rows of one id in their order; ``ids`` (N,) as in ``Boxes``."""
    is_few = int(ids.max(initial=0)) <= np.iinfo(np.uint16).max  # which NumPy sorts in time that is linear
    return np.argsort(ids.astype(np.uint16) if is_few else ids, kind="stable")


@dataclass(frozen=True, slots=True)
class Scene:
    """Truth and result of one sequence side by side, over the same F frames."""

    truth: Boxes
    result: Boxes

    def __len__(self) -> int:
        return len(self.truth.starts) - 1


@dataclass(frozen=True, slots=True)
class Pairs:
    """A true box and a box of the result in the same frame that overlap; P pairs by frame, truth row, result row.

    Attributes:
        frames: (P,) int64.
        truths: (P,) int64, rows of the scene's truth.
        results: (P,) int64, rows of its result.
        overlaps: (P,) float64, intersection over union, above 0.
        shares: (P,) float64, the overlap over all overlaps that either box has in the frame.
    """

    frames: NDArray[np.int64]
    truths: NDArray[np.int64]
    results: NDArray[np.int64]
    overlaps: NDArray[np.float64]
    shares: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Pairs:
        return Pairs(self.frames[rows], self.truths[rows], self.results[rows], self.overlaps[rows], self.shares[rows])


def overlapping_pairs(scene: Scene) -> Iterator[Pairs]:
    """All pairs that overlap, in pieces of whole frames, in order; a piece is never a part of a frame."""
    ends = np.cumsum(np.diff(scene.truth.starts) * np.diff(scene.result.starts))
    first = 0
    while first < len(scene):
        before = ends[first - 1] if first else 0
        last = max(first + 1, int(np.searchsorted(ends, before + _PIECE_ENTRIES, side="right")))
        yield _piece(scene, first, last)
        first = last


def _piece(scene: Scene, first: int, last: int) -> Pairs:
    """The pairs of frames ``first`` to ``last`` - 1."""
    truths, results = _meeting(scene, first, last)
    overlaps = iou_of_pairs(scene.truth.columns[:, truths].T, scene.result.columns[:, results].T)
    kept = overlaps > 0
    if not kept.all():  # a box of negative size overlaps nothing
        truths, results, overlaps = truths[kept], results[kept], overlaps[kept]
    frames = scene.truth.frames[truths]
    return Pairs(frames, truths, results, overlaps, _shares(scene, frames, truths, results, overlaps))


def _meeting(scene: Scene, first: int, last: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Truth rows and result rows of all pairs that meet in these frames, by truth row, then result row.

    Results are sorted by their left edge; a true box can meet those whose left edge lies before its right one, and not
    farther before its left one than the widest result is wide.
    """
    truth, result = (slice(int(side.starts[first]), int(side.starts[last])) for side in (scene.truth, scene.result))
    left, top, right, bottom = scene.truth.columns[:, truth]
    if not len(left) or result.start == result.stop:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    offsets = _FRAME_SPACING * (scene.truth.frames[truth] - first)
    places = scene.result.columns[0, result] + _FRAME_SPACING * (scene.result.frames[result] - first)
    order = np.argsort(places, kind="stable")
    places = places[order]
    result_left, result_top, result_right, result_bottom = scene.result.columns[:, result][:, order]
    widest = max(0.0, float((result_right - result_left).max()))
    starts = np.searchsorted(places, offsets + (left - widest - 1))  # a pixel more, for places are rounded
    lengths = np.searchsorted(places, offsets + (right + 1)) - starts
    candidates = np.arange(int(lengths.sum())) + np.repeat(starts - (np.cumsum(lengths) - lengths), lengths)
    meets = np.repeat(top, lengths) < result_bottom[candidates]
    meets &= result_top[candidates] < np.repeat(bottom, lengths)
    kept = np.flatnonzero(meets)
    truths, candidates = np.repeat(np.arange(len(left)), lengths)[kept], candidates[kept]
    meets = (left[truths] < result_right[candidates]) & (result_left[candidates] < right[truths])
    span = len(scene.result)
    return np.divmod(np.sort((truths[meets] + truth.start) * span + order[candidates[meets]] + result.start), span)


def _shares(
    scene: Scene,
    frames: NDArray[np.int64],
    truths: NDArray[np.int64],
    results: NDArray[np.int64],
    overlaps: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The share of each pair, (P,) float64: its overlap over the sum of all overlaps that either box has.

    The sums are over the frame's whole table, as TrackEval has them: another order of adding would round otherwise.
    Frames of equally large tables are done at once.
    """
    starts = np.flatnonzero(np.diff(frames, prepend=-1))  # of each frame that has pairs
    lengths, with_pairs = np.diff(starts, append=len(frames)), frames[starts]
    heights, widths = np.diff(scene.truth.starts)[with_pairs], np.diff(scene.result.starts)[with_pairs]
    by_shape = np.lexsort((widths, heights))
    heights, widths, lengths = heights[by_shape], widths[by_shape], lengths[by_shape]
    ends = np.cumsum(lengths)
    order = np.arange(len(frames)) + np.repeat(starts[by_shape] - (ends - lengths), lengths)
    numbers = np.repeat(np.arange(len(starts)), lengths)  # of the table of each pair
    of_row = numbers * heights[numbers] + truths[order] - scene.truth.starts[with_pairs[by_shape]][numbers]
    column = results[order] - scene.result.starts[with_pairs[by_shape]][numbers]
    of_column, of_pair = numbers * widths[numbers] + column, of_row * widths[numbers] + column
    sorted_overlaps, both = overlaps[order], np.zeros(len(frames))
    changes = np.flatnonzero((np.diff(heights) != 0) | (np.diff(widths) != 0)) + 1
    for first, last in pairwise([0, *changes.tolist(), len(starts)] if len(starts) else []):
        part = slice(int(ends[first] - lengths[first]), int(ends[last - 1]))
        height, width = int(heights[first]), int(widths[first])
        table = np.zeros((last - first, height, width))
        table.reshape(-1)[of_pair[part] - first * height * width] = sorted_overlaps[part]
        both[part] = table.sum(axis=1).reshape(-1)[of_column[part] - first * width]
        both[part] += table.sum(axis=2).reshape(-1)[of_row[part] - first * height]
    both -= sorted_overlaps
    shares = np.zeros(len(frames))
    shares[order] = np.divide(sorted_overlaps, both, out=np.zeros(len(frames)), where=both > _EPS)
    return shares
