"""The features that a head needs, read once for every labelled box and kept on disk.

The readings come in chunks, each written in one step: an interrupted run keeps what it has and goes on with the next
chunk. Features are kept as float16; their last digits are noise beside what a shifted box changes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import OutputError
from lookonce.make.descriptors.anchors import rows_of_boxes
from lookonce.make.export.reopen import RowReader
from lookonce.make.training.sources import Canvas, Source, Task

__all__ = ["Readings", "read_features"]

CHUNK_TASKS = 64
_FACTS = ("identity", "source", "frame", "height_px")


@dataclass(frozen=True, slots=True)
class Readings:
    """All that training sees: N rows, each one object in one picture.

    Attributes:
        values: by name the head's reading, (N, ...) float16 or int64.
        identity: (N,) int64, numbered over all sources.
        source: (N,) int64, number of the source.
        frame: (N,) int64, frame or view within the source.
        height_px: (N,) float32 of the box on the canvas.
        lifetime: (identities, 2) int64, the first and last frame of each.
        scene: (identities,) int64, numbered over all sources.
        held_out: (identities,) kept for validation.
        names: of the sources.
    """

    values: Mapping[str, NDArray[Any]]
    identity: NDArray[np.int64]
    source: NDArray[np.int64]
    frame: NDArray[np.int64]
    height_px: NDArray[np.float32]
    lifetime: NDArray[np.int64]
    scene: NDArray[np.int64]
    held_out: NDArray[np.bool_]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.identity)


def read_features(
    sources: Sequence[Source],
    open_reader: Callable[[], RowReader],
    folder: Path,
    *,
    workers: int,
    limit_bytes: int,
    report: Callable[[int, int], None],
) -> Readings:
    """Run the detector once over every source's tasks and keep what the head reads at each box.

    Args:
        sources: where the boxes come from.
        open_reader: opens the model file; each worker has its own.
        folder: for the chunks; those that are there already are not made again.
        workers: detector passes side by side.
        limit_bytes: on disk at most; beyond, no more is read and what there is must do.
        report: called with tasks done and in all.

    Raises:
        OutputError: the disk is full or the folder cannot be written.
        LookonceError: a source is wrong.
    """
    first_identity = np.cumsum([0, *(len(source.held_out) for source in sources)])
    total = sum(source.task_count for source in sources)
    _make(folder)
    files: list[Path] = []
    size = done = 0
    tasks = chain.from_iterable(_numbered(number, source) for number, source in enumerate(sources))
    with ThreadPoolExecutor(workers) as pool:
        readers = [open_reader() for _ in range(workers)]
        while chunk := list(islice(tasks, CHUNK_TASKS)):
            path = folder / f"chunk-{len(files):06d}.npz"
            if not path.exists():
                read = pool.map(_read_some, readers, [chunk[n::workers] for n in range(workers)])
                rows = [row for parts in _interleave(list(read)) for row in parts]
                _save(path, _joined(rows, first_identity))
            files.append(path)
            size += path.stat().st_size
            done += len(chunk)
            report(done, total)
            if size > limit_bytes:
                break
    return _load(files, sources)


_Numbered = tuple[int, Task]
_Row = tuple[int, Canvas, dict[str, NDArray[Any]]]


def _numbered(number: int, source: Source) -> Iterator[_Numbered]:
    for task in source.tasks():
        yield number, task


def _read_some(reader: RowReader, tasks: Sequence[_Numbered]) -> list[list[_Row]]:
    """For each task its canvas and what was read there; nothing where it shows no object."""
    results: list[list[_Row]] = []
    for number, task in tasks:
        canvas = task()
        if len(canvas.boxes):
            rows = rows_of_boxes(reader.metadata, canvas.boxes)
            results.append([(number, canvas, reader(canvas.pixels[None], rows))])
        else:
            results.append([])
    return results


def _interleave(parts: list[list[list[_Row]]]) -> Iterator[list[_Row]]:
    """Results in the order of the tasks, which were dealt out like cards."""
    longest = max((len(part) for part in parts), default=0)
    for index in range(longest):
        yield from (part[index] for part in parts if index < len(part))


def _joined(rows: list[_Row], first_identity: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    arrays: dict[str, list[NDArray[Any]]] = {name: [] for name in _FACTS}
    for number, canvas, read in rows:
        arrays["identity"].append(canvas.identities + first_identity[number])
        arrays["source"].append(np.full(len(canvas.boxes), number))
        arrays["frame"].append(canvas.frames)
        arrays["height_px"].append(canvas.heights_px)
        for name, values in read.items():
            small = values.astype(np.float16) if values.dtype.kind == "f" else values
            arrays.setdefault(f"value_{name}", []).append(small)
    return {name: np.concatenate(parts) for name, parts in arrays.items() if parts}


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise OutputError(f"{folder}: cannot be made ({exc.strerror}); choose another place with -o") from exc


def _save(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    unfinished = path.with_suffix(".unfinished")
    try:
        with open(unfinished, "wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        os.replace(unfinished, path)
    except OSError as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(
            f"{path.parent}: cannot keep the features ({exc.strerror}); make room and go on with --resume, "
            "or lower --cache-gb"
        ) from exc


def _load(files: Sequence[Path], sources: Sequence[Source]) -> Readings:
    parts: dict[str, list[NDArray[Any]]] = {}
    for path in files:
        with np.load(path, allow_pickle=False) as file:
            for name in file.files:
                parts.setdefault(name, []).append(file[name])
    arrays = {name: np.concatenate(values) for name, values in parts.items()}
    facts = {name: arrays.get(name, np.zeros(0, np.int64)) for name in _FACTS}
    return Readings(
        values={name.removeprefix("value_"): array for name, array in arrays.items() if name.startswith("value_")},
        lifetime=np.concatenate([source.lifetimes for source in sources]),
        scene=_numbered_scenes(sources),
        held_out=np.concatenate([source.held_out for source in sources]),
        names=tuple(source.name for source in sources),
        **facts,
    )


def _numbered_scenes(sources: Sequence[Source]) -> NDArray[np.int64]:
    scenes, first = [], 0
    for source in sources:
        scenes.append(source.scenes + first)
        first += int(source.scenes.max(initial=-1)) + 1
    return np.concatenate(scenes)
