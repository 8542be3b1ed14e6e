"""A file that grows by whole records, whatever happens."""

from __future__ import annotations

import contextlib
import os
from io import FileIO
from pathlib import Path

from lookonce.errors import OutputError

__all__ = ["AppendOnlyFile"]


class AppendOnlyFile:
    """A new file of which every record reaches the system whole or not at all.

    Nothing is buffered in this process, so a crash loses no record that ``append`` accepted. A record that the disk
    takes only in part is cut off again.

    Args:
        path: the file; an existing one is emptied.
        keep: go on after so many bytes of an existing file; what follows them is cut off.

    Attributes:
        path: the file.
        size: bytes of the whole records.

    Raises:
        OutputError: the file cannot be created, or is shorter than what is to be kept.
    """

    def __init__(self, path: Path, keep: int | None = None) -> None:
        self.path = path
        self.size = keep or 0
        self._failed = False
        try:
            self._file = FileIO(path, "w" if keep is None else "r+")
            if self._file.seek(0, os.SEEK_END) < self.size:
                self._file.close()
                raise OutputError(f"{path}: shorter than when the run stopped; start again with --overwrite")
            if keep is not None:
                self._file.truncate(keep)
                self._file.seek(keep)
        except OSError as exc:
            raise OutputError(f"{path}: cannot be created ({_reason(exc)}); choose another folder") from exc

    def append(self, record: bytes) -> None:
        """Write one record; an empty one writes nothing.

        Raises:
            OutputError: the disk refuses it, now or at an earlier record.
            ValueError: the file is closed.
        """
        if self._failed:
            raise OutputError(f"{self.path}: ends at the record before the failed one; free some space and start again")
        if self._file.closed:
            raise ValueError(f"{self.path}: write after close")
        try:
            self._write_all(record)
        except OSError as exc:
            self._cut_off_part()
            raise OutputError(
                f"{self.path}: cannot be written ({_reason(exc)}); it is valid up to the record before"
            ) from exc
        self.size += len(record)

    def _write_all(self, record: bytes) -> None:
        rest = memoryview(record)
        while rest:
            rest = rest[self._file.write(rest) :]

    def _cut_off_part(self) -> None:
        self._failed = True
        with contextlib.suppress(OSError):  # a pipe or a device has nothing to cut
            self._file.truncate(self.size)
        self.close()

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        try:
            self._file.close()
        except OSError as exc:
            if not self._failed:
                raise OutputError(f"{self.path}: cannot be completed ({_reason(exc)})") from exc


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
