"""The errors that tell a user that their *input* is wrong.

    LookonceError
    ├── VideoError     a source that cannot be opened or decoded
    ├── ModelError     a model file that is missing, damaged, foreign or of another version
    ├── WeightsError   a Darknet weights file that does not fit its network
    ├── FormatError    a text file with a wrong line (path and line are named)
    ├── ConfigError    a setting that cannot work
    ├── DownloadError  a published model that cannot be had, or is not the file that it should be
    └── OutputError    a result that cannot be written

Every message names the file and the remedy in one line. A wrong *call* (shape, dtype, type) is ``ValueError`` or
``TypeError`` instead.
"""

from __future__ import annotations

from os import PathLike, fspath

__all__ = [
    "ConfigError",
    "DownloadError",
    "FormatError",
    "LookonceError",
    "ModelError",
    "OutputError",
    "VideoError",
    "WeightsError",
]


class LookonceError(Exception):
    """Root of all errors that are caused by the input; ``str()`` is one line for the user."""


class VideoError(LookonceError):
    """A video, image folder, camera or stream cannot be opened or decoded."""


class ModelError(LookonceError):
    """A model file is missing, damaged, not ours, of another version, or asks for what is not installed."""


class WeightsError(LookonceError):
    """A Darknet weights file does not hold exactly the numbers that its network needs."""


class ConfigError(LookonceError):
    """A setting is unknown, out of range, or contradicts another."""


class DownloadError(LookonceError):
    """A published model is not a known one, cannot be had, or came with other bytes than the registered ones."""


class OutputError(LookonceError):
    """A result cannot be written, or would overwrite an earlier one."""


class FormatError(LookonceError):
    """A text file breaks its format.

    Attributes:
        path: the file.
        line: the line, counted from 1; 0 where the fault has no line.
    """

    def __init__(self, path: str | PathLike[str], line: int, message: str) -> None:
        self.path = fspath(path)
        self.line = line
        where = f"{self.path}:{line}" if line else self.path
        super().__init__(f"{where}: {message}")
