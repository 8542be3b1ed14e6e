"""Class names: files of them, and one numbering for several parts of a data set."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets.text import fault, quoted, read_text

__all__ = ["check_class_name", "read_class_names", "unite", "usual_name"]

_MAX_BYTES = 1_000_000
_MAX_LENGTH = 200  # characters of a name

# Darknet's names of COCO's classes -> COCO's own
_USUAL_NAMES = {
    "aeroplane": "airplane",
    "diningtable": "dining table",
    "motorbike": "motorcycle",
    "pottedplant": "potted plant",
    "sofa": "couch",
    "tvmonitor": "tv",
}


def usual_name(name: str) -> str:
    """A class name as COCO has it, in lower case, so that models and labels can be matched.

    >>> usual_name("Motorbike"), usual_name("car")
    ('motorcycle', 'car')
    """
    lower = name.strip().lower()
    return _USUAL_NAMES.get(lower, lower)


def check_class_name(name: str, path: Path, line: int) -> str:
    """``name`` itself; raises ``FormatError`` for one that is empty, very long or not printable."""
    if not name or len(name) > _MAX_LENGTH or not name.isprintable():
        raise fault(path, line, f"expected a class name of 1 to {_MAX_LENGTH} printable characters, got {quoted(name)}")
    return name


def read_class_names(path: Path) -> tuple[str, ...]:
    """The names of a file with one a line; blank lines at its end do not count.

    Raises:
        FormatError: it is no text, holds no name, a blank line among names, or a name twice.
    """
    names: dict[str, int] = {}
    for line, text in enumerate(read_text(path, _MAX_BYTES).rstrip().split("\n"), 1):
        name = check_class_name(text.strip(), path, line)
        if name in names:
            raise fault(path, line, f"class {quoted(name)} a second time (first in line {names[name]}); rename one")
        names[name] = line
    return tuple(names)


def unite(parts: Sequence[tuple[str, ...]]) -> tuple[tuple[str, ...], list[NDArray[np.int64]]]:
    """One tuple of class names for several.

    Args:
        parts: each part's class names.

    Returns:
        The names (those of the parts where these agree, else all of them in natural order), and for each part its
        labels' new numbers, (classes of the part,) int64.

    >>> unite([("car", "bus"), ("van", "car")])
    (('bus', 'car', 'van'), [array([1, 0]), array([2, 1])])
    """
    distinct = set(parts)
    if len(distinct) == 1:
        names = parts[0]
    else:
        names = tuple(sorted({name for part in parts for name in part}, key=_natural))
    numbers = {name: number for number, name in enumerate(names)}
    return names, [np.array([numbers[name] for name in part], np.int64) for part in parts]


def _natural(name: str) -> tuple[str, str]:
    """Sorts class 2 before class 10."""
    return re.sub(r"\d+", lambda digits: digits[0].zfill(_MAX_LENGTH), name), name
