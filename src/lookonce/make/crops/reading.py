"""Cut-out boxes of the very pictures and identities that descriptors heads are trained on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.crops import CROP_SIZE, cut_out
from lookonce.make.training.readings import Readings
from lookonce.make.training.sources import Canvas, Source, Task

__all__ = ["read_crops"]

_GOLDEN = (5**0.5 - 1) / 2
_AT_ONCE = 64
_NO_PIXELS = np.zeros((0, 0, 3), np.uint8)

_Row = tuple[int, Canvas, NDArray[np.uint8]]


def read_crops(
    sources: Sequence[Source], *, workers: int, limit_bytes: int, report: Callable[[int, int], None]
) -> Readings:
    """What training sees: each labelled box of the sources' pictures as 64x64 pixels.

    Args:
        sources: pictures with identities.
        workers: pictures made side by side; they do not change the result.
        limit_bytes: in memory; where all would take more, only every so many-th picture is taken, of every source.
        report: called with pictures done and in all.
    """
    first = np.cumsum([0, *(len(source.held_out) for source in sources)])
    total = sum(source.task_count for source in sources)
    share = limit_bytes / max(1, 3 * CROP_SIZE**2 * sum(source.row_count for source in sources))
    numbered = chain.from_iterable(_numbered(number, source) for number, source in enumerate(sources))
    chosen = (one for index, one in enumerate(numbered) if (index * _GOLDEN) % 1 < share)
    rows: list[_Row] = []
    done = 0
    with ThreadPoolExecutor(workers) as pool:
        for some in _in_parts(chosen):
            rows += pool.map(_read, some)
            done += len(some)
            report(done, min(total, max(done, round(total * share))))
    return _joined([row for row in rows if len(row[2])], sources, first)


def _in_parts(tasks: Iterator[tuple[int, Task]]) -> Iterator[list[tuple[int, Task]]]:
    part: list[tuple[int, Task]] = []
    for task in tasks:
        part.append(task)
        if len(part) == _AT_ONCE:
            yield part
            part = []
    if part:
        yield part


def _numbered(number: int, source: Source) -> Iterator[tuple[int, Task]]:
    for task in source.tasks():
        yield number, task


def _read(numbered: tuple[int, Task]) -> _Row:
    number, task = numbered
    canvas = task()
    crops = cut_out(canvas.pixels, canvas.boxes)
    return number, replace(canvas, pixels=_NO_PIXELS), crops  # the pictures together would fill the memory


def _joined(rows: Sequence[_Row], sources: Sequence[Source], first: NDArray[np.int64]) -> Readings:
    none = np.zeros(0, np.int64)
    scenes, start = [none], 0
    for source in sources:
        scenes.append(source.scenes + start)
        start += int(source.scenes.max(initial=-1)) + 1
    crops = [np.zeros((0, CROP_SIZE, CROP_SIZE, 3), np.uint8), *(cut for _, _, cut in rows)]
    return Readings(
        values={"crop": np.concatenate(crops)},
        identity=np.concatenate([none, *(canvas.identities + first[number] for number, canvas, _ in rows)]),
        source=np.concatenate([none, *(np.full(len(cut), number, np.int64) for number, _, cut in rows)]),
        frame=np.concatenate([none, *(canvas.frames for _, canvas, _ in rows)]),
        height_px=np.concatenate([np.zeros(0, np.float32), *(canvas.heights_px for _, canvas, _ in rows)]),
        lifetime=np.concatenate([source.lifetimes for source in sources]),
        scene=np.concatenate(scenes),
        held_out=np.concatenate([source.held_out for source in sources]),
        names=tuple(source.name for source in sources),
        kinds=tuple(source.kind for source in sources),
    )
