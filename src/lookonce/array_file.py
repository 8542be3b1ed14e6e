"""Named arrays in one file: an .npz that is written whole, and read with nothing trusted and nothing unpickled."""

from __future__ import annotations

import contextlib
import io
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import FormatError, OutputError

__all__ = ["read_arrays", "write_arrays"]

_MOST_DIMENSIONS = 3


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the file in one piece: it is whole, or as it was before.

    Raises:
        OutputError: it cannot be written.
    """
    draft = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with draft.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        draft.replace(path)
    except OSError as exc:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise OutputError(f"{path}: cannot be written ({exc.strerror}); choose another place") from exc


def read_arrays(path: Path, dtypes: Mapping[str, type], most_bytes: int, remedy: str) -> dict[str, NDArray[Any]]:
    """What ``write_arrays`` wrote.

    Args:
        path: the file.
        dtypes: the arrays that it may hold.
        most_bytes: all of them together.
        remedy: what to do about a bad file, for messages.

    Raises:
        FormatError: it is something else, damaged, or too large.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            names = [member.filename.removesuffix(".npy") for member in members]
            if len(set(names)) < len(names) or not set(names) <= dtypes.keys():
                raise FormatError(path, 0, f"holds other arrays than expected; {remedy}")
            if sum(member.file_size for member in members) > most_bytes:
                raise FormatError(path, 0, f"larger than {most_bytes / 1e9:g} GB; {remedy}")
            return {name: _array(path, archive, name, dtypes[name], remedy) for name in names}
    except (zipfile.BadZipFile, NotImplementedError, EOFError, OSError, KeyError, RuntimeError) as exc:
        raise FormatError(path, 0, f"damaged, or no such file ({exc}); {remedy}") from exc


def _array(path: Path, archive: zipfile.ZipFile, name: str, wanted: type, remedy: str) -> NDArray[Any]:
    """One array, of the dtype that it should have, whose header promises no more than there is."""
    data = io.BytesIO(archive.read(f"{name}.npy"))  # no more than the directory says, or zipfile refuses
    try:
        if np.lib.format.read_magic(data) != (1, 0):
            raise ValueError("another version of .npy")
        shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(cast("IO[bytes]", data))
        values = np.frombuffer(data.getbuffer()[data.tell() :], np.uint8)
        if is_fortran or dtype != np.dtype(wanted) or len(shape) > _MOST_DIMENSIONS:
            raise ValueError(f"expected {np.dtype(wanted).name}, got {dtype}")
        return values.view(dtype).reshape(shape).copy()
    except ValueError as exc:
        raise FormatError(path, 0, f"array {name}: {exc}; {remedy}") from exc
