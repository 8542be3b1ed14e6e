"""Files of an earlier run: refused, or replaced when that was asked for."""

from __future__ import annotations

from pathlib import Path

from lookonce.errors import OutputError

__all__ = ["claim"]


def claim(folder: Path, pattern: str, *, overwrite: bool) -> None:
    """Makes a folder in which no file fits ``pattern``.

    Raises:
        OutputError: such files are there and may not be replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted(folder.glob(pattern)):
        if not overwrite:
            raise OutputError(f"{path} exists; give --overwrite to replace this sequence, or another folder")
        path.unlink()
