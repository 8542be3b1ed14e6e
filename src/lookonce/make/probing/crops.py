"""The pictures of chosen objects, cut out of their frames in a second reading."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence, Set

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets import LabelledSequence
from lookonce.distances import distances, quantize
from lookonce.evaluation import DescribedObjects
from lookonce.make.probing.describing import OnFrame, Reading
from lookonce.make.probing.gaps import Window
from lookonce.make.probing.neighbours import Neighbourhood, ShownObject
from lookonce.make.probing.queries import choose_queries, nearest
from lookonce.video import open_video
from lookonce.video.images import frame_indices, pictures_in

__all__ = ["neighbourhoods", "read_crops"]

_QUERIES, _NEIGHBOURS = 8, 7  # a sheet that fits a screen


def neighbourhoods(
    reading: Reading,
    window: Window,
    sequences: Sequence[LabelledSequence],
    *,
    seed: int = 0,
    on_frame: OnFrame | None = None,
) -> list[Neighbourhood]:
    """The rows of a sheet: queries worth looking at, and whom the descriptors put nearest to each.

    Args:
        reading: what was described.
        window: which of it is compared; the same rows on the limits' clock.
        sequences: those that were read.
        seed: of the choice of queries.
        on_frame: told of the progress.
    """
    gaps = window.least, window.most
    queries = choose_queries(window.objects, *gaps, _QUERIES, seed).tolist()
    neighbours = {query: nearest(window.objects, query, *gaps, _NEIGHBOURS) for query in queries}
    rows = np.unique(np.concatenate([np.array(queries, np.int64), *neighbours.values()]))
    crops = read_crops(reading, rows, sequences, on_frame=on_frame)
    shown = []
    for query in queries:
        found = neighbours[query]
        apart = distances(quantize(reading.objects.descriptors[[query]]), quantize(reading.objects.descriptors[found]))[
            0
        ]
        shown.append(
            Neighbourhood(
                _shown(reading.objects, crops, query, query, 0.0),
                tuple(
                    _shown(reading.objects, crops, query, row, distance)
                    for row, distance in zip(found.tolist(), apart.tolist(), strict=True)
                ),
            )
        )
    return shown


def _shown(
    objects: DescribedObjects, crops: dict[int, NDArray[np.uint8]], query: int, row: int, distance: float
) -> ShownObject:
    identity = int(objects.identities[row])
    is_same = identity == int(objects.identities[query])
    return ShownObject(crops[row], identity, float(objects.times_s[row]), distance, is_same)


def read_crops(
    reading: Reading,
    rows: NDArray[np.int64],
    sequences: Sequence[LabelledSequence],
    *,
    on_frame: OnFrame | None = None,
) -> dict[int, NDArray[np.uint8]]:
    """By row its picture (H, W, 3) uint8 RGB; only the crops are held, and one frame.

    Args:
        reading: what was described.
        rows: (R,) int64, the rows that are wanted.
        sequences: those that were read.
        on_frame: told of the progress.
    """
    wanted: dict[int, dict[int, list[int]]] = defaultdict(lambda: defaultdict(list))  # sequence -> frame -> rows
    for row in rows.tolist():
        wanted[int(reading.objects.sequences[row])][int(reading.objects.frames[row])].append(row)
    crops: dict[int, NDArray[np.uint8]] = {}
    for number, frames in wanted.items():
        name = f"{sequences[number].name}, pictures for the sheet"
        for done, (index, image) in enumerate(_images(sequences[number], frames.keys()), 1):
            crops |= {row: _cut(image, reading.xyxy[row]) for row in frames[index]}
            if on_frame is not None:
                on_frame(name, done, len(frames))
    return crops


def _images(sequence: LabelledSequence, wanted: Set[int]) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """The wanted frames, by index; of a folder only their files are opened, of a video none beyond the last."""
    if sequence.pictures.is_dir():
        paths = pictures_in(sequence.pictures)
        for index, path in zip(frame_indices(paths), paths, strict=True):
            if index in wanted:
                with open_video(path) as picture:
                    yield from ((index, frame.image) for frame in picture)
        return
    with open_video(sequence.pictures) as video:
        for frame in video:
            if frame.index in wanted:
                yield frame.index, frame.image
            if frame.index >= max(wanted):
                return


def _cut(image: NDArray[np.uint8], xyxy: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The whole pixels that a box touches, one at least; a copy."""
    height, width = image.shape[:2]
    left, top, right, bottom = xyxy.tolist()
    first_column, first_row = min(max(math.floor(left), 0), width - 1), min(max(math.floor(top), 0), height - 1)
    end_column, end_row = max(math.ceil(right), first_column + 1), max(math.ceil(bottom), first_row + 1)
    return image[first_row:end_row, first_column:end_column].copy()
