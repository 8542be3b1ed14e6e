"""The folder that the results of one run go into."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from lookonce.errors import OutputError

__all__ = ["prepare_output_folder"]


def prepare_output_folder(folder: Path, files: Sequence[str], overwrite: bool) -> None:
    """Create ``folder`` with its parents, and make room for the ``files`` of this run.

    Args:
        folder: where the results go.
        files: the names, inside ``folder``, that this run will write.
        overwrite: remove exactly these files where an earlier run left them.

    Raises:
        OutputError: the folder cannot be created or written, or a file exists and ``overwrite`` is False.
    """
    _create(folder)
    earlier = [folder / name for name in files if os.path.lexists(folder / name)]
    if earlier and not overwrite:
        raise OutputError(
            f"{earlier[0]} exists from an earlier run; give --overwrite to replace it or choose another folder with -o"
        )
    _try_writing(folder)
    for path in earlier:
        _remove(path)


def _create(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise OutputError(f"{folder}: cannot be created ({exc.strerror}); choose another folder with -o") from exc


def _try_writing(folder: Path) -> None:
    """Write a nameless file: the permission bits alone do not tell about read-only disks, quotas or foreign owners."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as exc:
        raise OutputError(f"{folder}: cannot be written ({exc.strerror}); choose another folder with -o") from exc


def _remove(path: Path) -> None:
    try:
        path.unlink()
    except OSError as exc:
        raise OutputError(f"{path}: cannot be replaced ({exc.strerror}); choose another folder with -o") from exc
