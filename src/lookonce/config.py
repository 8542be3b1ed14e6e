"""Settings from TOML files: the fields of a dataclass by name, checked."""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

from lookonce.errors import ConfigError, FormatError

__all__ = ["read_settings"]

_MAX_BYTES = 1 << 20
_TYPES: dict[str, type] = {"int": int, "float": float, "str": str, "bool": bool}


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
            text = file.read(_MAX_BYTES + 1).decode("utf-8")
    except OSError as exc:
        raise ConfigError(f"{path}: cannot read the settings ({exc.strerror}); check the path") from exc
    except UnicodeDecodeError as exc:
        raise ConfigError(f"{path}: not text; expected TOML such as: seed = 1") from exc
    if len(text) > _MAX_BYTES:
        raise ConfigError(f"{path}: larger than {_MAX_BYTES} bytes; expected a few lines of TOML")
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as exc:
        reason = str(exc).splitlines()[0][:200]
        raise FormatError(path, 0, f"not TOML ({reason}); expected lines such as: seed = 1") from exc
    known = {field.name: str(field.type) for field in fields(settings)}
    return {name: _checked(path, name, value, known) for name, value in content.items()}


def _checked(path: Path, name: str, value: object, known: dict[str, str]) -> object:
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(known)}"
        raise ConfigError(f"{path}: unknown setting '{name[:60]}'; {hint}")
    wanted = _TYPES[known[name]]
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, wanted) or (isinstance(value, bool) and wanted is not bool):
        raise ConfigError(f"{path}: {name} = {value!r:.60}: expected {known[name]}")
    return value
