"""Settings from TOML files: the fields of a dataclass by name, checked."""

from __future__ import annotations

import difflib
import sys
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

from lookonce.errors import ConfigError, FormatError

__all__ = ["read_settings"]

_MAX_BYTES = 1 << 20
_TYPES: dict[str, type] = {"int": int, "float": float, "str": str, "bool": bool}
_IN_WORDS = {"int": "a whole number", "float": "a number", "str": "a text in quotes", "bool": "true or false"}


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
