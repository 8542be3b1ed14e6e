"""Folders below a folder, without getting lost in them."""

from __future__ import annotations

import os
from pathlib import Path

from lookonce.errors import ConfigError
from lookonce.video.images import natural_order
from lookonce.video.opening import one_line

__all__ = ["folders_below"]

_MAX_FOLDERS = 20_000


def folders_below(root: Path, depth: int, *, closed: tuple[str, ...] = ()) -> list[Path]:
    """The folders inside ``root`` to that depth, each once and in natural order; hidden ones left out.

    Args:
        root: the folder, itself not in the result.
        depth: 1 = only those directly inside.
        closed: folders whose names start so are in the result but not entered.

    Raises:
        ConfigError: there are very many, or one cannot be listed.
    """
    found: dict[str, Path] = {os.path.realpath(root): root}
    level = [root]
    for _ in range(depth):
        below: list[Path] = []
        for folder in level:
            for inner in natural_order(_listed(folder)):
                real = os.path.realpath(inner)
                if real not in found:  # links may lead in circles
                    found[real] = inner
                    below.append(inner)
            if len(found) > _MAX_FOLDERS:
                raise ConfigError(
                    f"{one_line(root)}: more than {_MAX_FOLDERS:,} folders in it; name the one with the data"
                )
        level = [folder for folder in below if not folder.name.startswith(closed)] if closed else below
    return natural_order(path for path in found.values() if path != root)


def _listed(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            return [folder / entry.name for entry in entries if not entry.name.startswith(".") and entry.is_dir()]
    except OSError as exc:
        raise ConfigError(f"{one_line(folder)}: cannot be listed ({exc.strerror}); check its permissions") from exc
