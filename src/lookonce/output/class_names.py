"""From a class index to the name that a reader of the results sees."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["class_name"]


def class_name(names: Sequence[str], label: int) -> str:
    """The name of class ``label``; its number where ``names`` does not reach.

    >>> class_name(["person", "car"], 1), class_name([], 7)
    ('car', '7')
    """
    return names[label] if 0 <= label < len(names) else str(label)
