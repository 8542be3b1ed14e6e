"""A file that is there whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from lookonce.errors import OutputError

__all__ = ["write_whole"]


def write_whole(path: Path, content: bytes, kind: str = "picture") -> None:
    """Write under a temporary name beside ``path``, then rename it; missing folders are created.

    Args:
        path: the file; an existing one is replaced.
        content: all of it.
        kind: what messages call it.

    Raises:
        OutputError: the file cannot be written; what was there before is untouched.
    """
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_bytes(content)
        os.replace(unfinished, path)
    except OSError as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(f"{path}: cannot write the {kind} ({exc.strerror}); choose another place for it") from exc
