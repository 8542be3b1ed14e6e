"""Settings from TOML files: the fields of a dataclass by name, checked."""

from __future__ import annotations

import difflib
import sys
import tomllib
from collections.abc import Container
from dataclasses import fields
from math import isfinite
from pathlib import Path
from typing import Any

from lookonce.errors import ConfigError, FormatError

__all__ = ["check_numbers", "read_settings"]

_MAX_BYTES = 1 << 20
_TYPES: dict[str, type] = {"int": int, "float": float, "str": str, "bool": bool}
_IN_WORDS = {"int": "a whole number", "float": "a number", "str": "a text in quotes", "bool": "true or false"}


_LARGEST = 1e6


def check_numbers(settings: object, above_zero: Container[str] = ()) -> None:
    """Refuse a dataclass of settings of which a number is below 0, huge or not finite.

    Args:
        settings: fields that are no numbers are not looked at.
        above_zero: names of those that may not be 0 either.

    Raises:
        ConfigError: the name of the first, with its value.
    """
    for field in fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, field.name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            continue
        least = "above 0" if field.name in above_zero else "0"
        if not (isfinite(value) and 0 <= value <= _LARGEST) or (field.name in above_zero and value == 0):
            raise ConfigError(f"{field.name}={value}: expected {least} to {_LARGEST:g}")


def read_settings(path: Path, settings: type) -> dict[str, Any]:
    """The values of a TOML file for a dataclass with plain fields; what is not named keeps its default.

    Args:
        path: the file: ``name = value`` lines, no tables.
        settings: a dataclass whose annotations are ``int``, ``float``, ``str`` or ``bool``.

    Raises:
        ConfigError: the file cannot be read, or names or types are wrong; the nearest name is told.
        FormatError: it is not TOML.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(_MAX_BYTES + 1)
    except OSError as exc:
        raise ConfigError(f"{path}: cannot read the settings ({exc.strerror}); check the path") from exc
    if len(data) > _MAX_BYTES:
        raise ConfigError(f"{path}: larger than {_MAX_BYTES} bytes; expected a few lines of TOML")
    try:
        content = tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as exc:
        raise ConfigError(f"{path}: not text; expected TOML such as: seed = 1") from exc
    except (ValueError, RecursionError) as exc:  # not TOMLDecodeError: a number may have too many digits
        raise FormatError(path, 0, f"not TOML ({_shown(exc, 200)}); expected lines such as: seed = 1") from exc
    known = {field.name: str(field.type) for field in fields(settings)}
    return {name: _checked(path, name, value, known) for name, value in content.items()}


def _checked(path: Path, name: str, value: object, known: dict[str, str]) -> object:
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(known)}"
        raise ConfigError(f"{path}: unknown setting '{_shown(name, 60)}'; {hint}")
    wanted = _TYPES[known[name]]
    if wanted is float and isinstance(value, int) and not isinstance(value, bool) and abs(value) <= sys.float_info.max:
        return float(value)
    if not isinstance(value, wanted) or (isinstance(value, bool) and wanted is not bool):
        raise ConfigError(f"{path}: {name} = {_shown(value, 60)}: expected {_IN_WORDS[known[name]]}")
    return value


def _shown(value: object, length: int) -> str:
    """The beginning of a value on one line."""
    text = str(value) if not isinstance(value, str) or value.isprintable() else repr(value)
    return "".join(c if c.isprintable() else " " for c in text[:length])
