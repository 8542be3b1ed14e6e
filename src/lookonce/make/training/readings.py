"""The features that a head needs, read once for every labelled box and kept on disk.

The readings come in chunks, each written in one step: an interrupted run keeps what it has and goes on with the next
chunk. Features are kept as float16; their last digits are noise beside what a shifted box changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import chain, compress, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import ConfigError, OutputError
from lookonce.make.descriptors.anchors import rows_of_boxes
from lookonce.make.export.reopen import RowReader
from lookonce.make.training.chunks import check_chunk, read_chunks, write_chunk
from lookonce.make.training.sources import Canvas, Source, Task
from lookonce.video.opening import one_line

__all__ = ["Readings", "read_features"]

CHUNK_TASKS = 64
_FACTS = {"identity": np.int64, "source": np.int64, "frame": np.int64, "height_px": np.float32}
_VALUE = "value_"
_GOLDEN = (5**0.5 - 1) / 2
_LARGEST = float(np.finfo(np.float16).max)


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
        kinds: of the sources, see ``Source``.
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
    kinds: tuple[str, ...]

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
        open_reader: opens the model file, when something is to be read.
        folder: for the chunks; those that are there already are not made again.
        workers: detector passes side by side; they do not change the result.
        limit_bytes: on disk about; where all would take more, only every so many-th picture is read, of every source.
        report: called with tasks done and in all.

    Raises:
        OutputError: the disk is full or the folder cannot be written.
        ConfigError: a chunk is damaged or not of this run.
        LookonceError: a source is wrong.
    """
    first_identity = np.cumsum([0, *(len(source.held_out) for source in sources)])
    total = sum(source.task_count for source in sources)
    _make(folder)
    files: list[Path] = []
    done = 0
    tasks: Iterator[_Numbered] = chain.from_iterable(_numbered(n, source) for n, source in enumerate(sources))
    reader: RowReader | None = None
    with ThreadPoolExecutor(workers) as pool:
        while chunk := list(islice(tasks, CHUNK_TASKS)):
            path = folder / f"chunk-{len(files):06d}.npz"
            if path.exists():
                check_chunk(path)
            else:
                reader = reader or open_reader()
                rows = [row for row in pool.map(partial(_read, reader), chunk) if row is not None]
                write_chunk(path, _joined(rows, first_identity))
            files.append(path)
            done += len(chunk)
            if len(files) == 1:
                share = _affordable_share(path, sources, limit_bytes)
                is_taken = _taken(total - done, share)
                tasks, total = compress(tasks, is_taken), done + sum(is_taken)
            report(done, total)
    return _load(files, sources, first_identity)


_Numbered = tuple[int, Task]
_Row = tuple[int, Canvas, dict[str, NDArray[Any]]]


def _affordable_share(first: Path, sources: Sequence[Source], limit_bytes: int) -> float:
    """The share of all rows that fits, judged by the rows of the first chunk."""
    rows = len(read_chunks([first]).get("identity", ()))
    expected = sum(source.row_count for source in sources) * first.stat().st_size / max(rows, 1)
    return min(1.0, limit_bytes / max(expected, 1))


def _taken(count: int, share: float) -> list[bool]:
    """Which of the tasks to take, an even share of them.

    Steps of the golden ratio fall in with no period: of tasks that come in pairs, such as frames as they are and
    transformed, every second one would all be of one kind.
    """
    return [(index * _GOLDEN) % 1 < share for index in range(count)]


def _numbered(number: int, source: Source) -> Iterator[_Numbered]:
    for task in source.tasks():
        yield number, task


def _read(reader: RowReader, numbered: _Numbered) -> _Row | None:
    """The canvas of a task and what was read there; None where it shows no object."""
    number, task = numbered
    canvas = task()
    if not len(canvas.boxes):
        return None
    return number, canvas, reader(canvas.pixels[None], rows_of_boxes(reader.metadata, canvas.boxes))


def _joined(rows: list[_Row], first_identity: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    arrays: dict[str, list[NDArray[Any]]] = {name: [] for name in _FACTS}
    for number, canvas, read in rows:
        arrays["identity"].append(canvas.identities + first_identity[number])
        arrays["source"].append(np.full(len(canvas.boxes), number, np.int64))
        arrays["frame"].append(canvas.frames)
        arrays["height_px"].append(canvas.heights_px)
        for name, values in read.items():
            small = np.clip(values, -_LARGEST, _LARGEST).astype(np.float16) if values.dtype.kind == "f" else values
            arrays.setdefault(f"{_VALUE}{name}", []).append(small)
    return {name: np.concatenate(parts) for name, parts in arrays.items() if parts}


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise OutputError(f"{folder}: cannot be made ({exc.strerror}); choose another place with -o") from exc


def _load(files: Sequence[Path], sources: Sequence[Source], first_identity: NDArray[np.int64]) -> Readings:
    columns = read_chunks(files)
    facts = {name: columns.get(name, np.zeros(0, dtype)) for name, dtype in _FACTS.items()}
    _check_facts(files[0].parent if files else Path(), facts, first_identity)
    return Readings(
        values={name.removeprefix(_VALUE): column for name, column in columns.items() if name.startswith(_VALUE)},
        lifetime=np.concatenate([source.lifetimes for source in sources]),
        scene=_numbered_scenes(sources),
        held_out=np.concatenate([source.held_out for source in sources]),
        names=tuple(source.name for source in sources),
        kinds=tuple(source.kind for source in sources),
        **facts,
    )


def _check_facts(folder: Path, facts: Mapping[str, NDArray[Any]], first_identity: NDArray[np.int64]) -> None:
    """Refuse rows that this run's sources cannot have given."""
    fits = all(facts[name].dtype == dtype and facts[name].ndim == 1 for name, dtype in _FACTS.items())
    if fits and len(facts["source"]):
        source, identity = facts["source"], facts["identity"]
        fits = source.min() >= 0 and source.max() < len(first_identity) - 1
        fits = fits and bool(((first_identity[source] <= identity) & (identity < first_identity[source + 1])).all())
        fits = (
            fits
            and facts["frame"].min() >= 0
            and bool(((facts["height_px"] > 0) & (facts["height_px"] < np.inf)).all())
        )
    if not fits:
        raise ConfigError(f"{one_line(folder)}: not the features of this run; start again with --overwrite")


def _numbered_scenes(sources: Sequence[Source]) -> NDArray[np.int64]:
    scenes, first = [], 0
    for source in sources:
        scenes.append(source.scenes + first)
        first += int(source.scenes.max(initial=-1)) + 1
    return np.concatenate(scenes)
