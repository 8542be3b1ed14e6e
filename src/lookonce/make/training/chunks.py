"""Columns of numbers on disk, in chunks: each is written in one step, and none is believed before it is checked."""

from __future__ import annotations

import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import ConfigError, OutputError
from lookonce.video.opening import one_line

__all__ = ["check_chunk", "is_whole_chunk", "read_chunks", "write_chunk"]

_Layout = dict[str, tuple[tuple[int, ...], np.dtype[Any]]]
_KINDS = "fiu"  # of numbers
# What zipfile and NumPy raise for files that are damaged, foreign or made to harm.
_DAMAGED = (
    *(OSError, ValueError, KeyError, EOFError, RuntimeError, NotImplementedError, TypeError, OverflowError),
    *(zipfile.BadZipFile, zlib.error, struct.error, SyntaxError, tokenize.TokenError, RecursionError, MemoryError),
)


def write_chunk(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns of numbers, by name (N, ...); an interrupted run leaves no half file.

    Raises:
        OutputError: the disk is full or the folder cannot be written.
    """
    unfinished = path.with_suffix(".unfinished")
    try:
        with open(unfinished, "wb") as file:
            np.savez(file, allow_pickle=False, **columns)
        os.replace(unfinished, path)
    except OSError as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(
            f"{one_line(path.parent)}: cannot keep the features ({exc.strerror}); make room and go on with --resume, "
            "or lower --cache-gb"
        ) from exc


def check_chunk(path: Path) -> None:
    """Look at the headers of a chunk.

    Raises:
        ConfigError: it is damaged or foreign.
    """
    _layout(path)


def is_whole_chunk(path: Path) -> bool:
    """Whether every byte of a chunk is as it was written."""
    try:
        _layout(path)
        with zipfile.ZipFile(path) as file:
            return file.testzip() is None
    except (ConfigError, *_DAMAGED):
        return False


def read_chunks(paths: Sequence[Path]) -> dict[str, NDArray[Any]]:
    """The columns of all chunks, joined in order; each row is in memory once.

    Raises:
        ConfigError: a chunk is damaged, or does not have the columns of the others.
    """
    layouts = [_layout(path) for path in paths]
    rows = [max((shape[0] for shape, _ in layout.values()), default=0) for layout in layouts]
    first = next((layout for layout in layouts if layout), {})
    columns = {name: np.empty((sum(rows), *shape[1:]), dtype) for name, (shape, dtype) in first.items()}
    start = 0
    for path, layout, count in zip(paths, layouts, rows, strict=True):
        if layout and _as_for_one_row(layout) != _as_for_one_row(first):
            raise _refusal(path)
        for name in layout:
            columns[name][start : start + count] = _read_column(path, name)
        start += count
    return columns


def _refusal(path: Path) -> ConfigError:
    return ConfigError(
        f"{one_line(path)}: not features of this run, or damaged; remove it and go on with --resume, or start again "
        "with --overwrite"
    )


def _as_for_one_row(layout: _Layout) -> _Layout:
    return {name: (shape[1:], dtype) for name, (shape, dtype) in layout.items()}


def _layout(path: Path) -> _Layout:
    """Shape and dtype of each column, from the headers; what they promise is in the file, so they may be allocated."""
    try:
        size = path.stat().st_size
        with zipfile.ZipFile(path) as file:
            layout = {}
            for info in file.infolist():
                with file.open(info) as member:
                    shape, dtype, header_bytes = _read_header(member)
                promised = int(np.prod(shape, dtype=object)) * dtype.itemsize + header_bytes
                if info.compress_type != zipfile.ZIP_STORED or info.file_size != promised or promised > size:
                    raise _refusal(path)
                layout[info.filename.removesuffix(".npy")] = shape, dtype
    except _DAMAGED as exc:
        raise _refusal(path) from exc
    if len({shape[0] for shape, _ in layout.values()}) > 1:
        raise _refusal(path)
    return layout


def _read_header(member: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Shape and dtype of an array of numbers, and the length of its header in bytes.

    Raises:
        ValueError: it is no such array.
    """
    version = np.lib.format.read_magic(member)
    if version != (1, 0):
        raise ValueError("a version that numpy.savez does not write")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(member)
    if not shape or is_fortran or dtype.kind not in _KINDS:
        raise ValueError("expected rows of numbers")
    return shape, dtype, member.tell()


def _read_column(path: Path, name: str) -> NDArray[Any]:
    try:
        with np.load(path, allow_pickle=False) as file:
            column: NDArray[Any] = file[name]
            return column
    except _DAMAGED as exc:
        raise _refusal(path) from exc
