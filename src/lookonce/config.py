"""Settings from TOML files: the fields of a dataclass by name, checked; dataclasses in it are tables."""

from __future__ import annotations

import difflib
import sys
import tomllib
from collections.abc import Container, Mapping
from dataclasses import fields, is_dataclass
from math import isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import Any, get_type_hints

from lookonce.errors import ConfigError, FormatError

__all__ = ["check_numbers", "check_settings", "read_settings", "read_toml", "setting_types"]

_MAX_BYTES = 1 << 20
_LONGEST_PATH = 4096
_IN_WORDS = {int: "a whole number", float: "a number", str: "a text in quotes", bool: "true or false"}


_LARGEST = 1e6


def check_numbers(settings: object, above_zero: Container[str] = ()) -> None:
    """Refuse a dataclass of settings of which a number is below 0, huge, not finite, or none at all.

    Args:
        settings: fields whose defaults are no numbers are not looked at.
        above_zero: names of those that may not be 0 either.

    Raises:
        ConfigError: the name of the first, with its value.
    """
    for field in fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, field.name)
        kind = next((one for one in (bool, int, float) if isinstance(field.default, one)), None)
        if kind is not None and not _is_a(value, kind):
            raise ConfigError(f"{field.name}={value!r}: expected {_IN_WORDS[kind]}")
        if isinstance(value, bool) or not isinstance(value, Real):
            continue
        least = "above 0" if field.name in above_zero else "0"
        if not (isfinite(value) and 0 <= float(value) <= _LARGEST) or (field.name in above_zero and value == 0):
            raise ConfigError(f"{field.name}={value}: expected {least} to {_LARGEST:g}")


def _is_a(value: object, kind: type) -> bool:
    """Whether a value can be one of the kind; NumPy's numbers are some, too."""
    if kind is bool or isinstance(value, bool):
        return kind is bool and isinstance(value, bool)
    return isinstance(value, Integral if kind is int else Real)


def read_settings(path: Path, settings: type) -> dict[str, Any]:
    """The values of a TOML file for a dataclass; what is not named keeps its default.

    Args:
        path: the file: ``name = value`` lines, and a table for each field that is a dataclass.
        settings: a dataclass whose annotations are ``int``, ``float``, ``str``, ``bool`` or dataclasses of these.

    Raises:
        ConfigError: the file cannot be read, or names or types are wrong; the nearest name is told.
        FormatError: it is not TOML.
    """
    return check_settings(_shown(str(path), _LONGEST_PATH), read_toml(path), settings)


def read_toml(path: Path) -> dict[str, Any]:
    """What a small TOML file holds, as it is.

    Raises:
        ConfigError: the file cannot be read or is large.
        FormatError: it is not TOML.
    """
    where = _shown(str(path), _LONGEST_PATH)
    try:
        with open(path, "rb") as file:
            data = file.read(_MAX_BYTES + 1)
    except (OSError, ValueError) as exc:  # ValueError: a zero byte in the path
        raise ConfigError(f"{where}: cannot read the settings ({_reason(exc)}); check the path") from exc
    if len(data) > _MAX_BYTES:
        raise ConfigError(f"{where}: larger than {_MAX_BYTES} bytes; expected a few lines of TOML")
    try:
        return tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as exc:
        raise ConfigError(f"{where}: not text; expected TOML such as: seed = 1") from exc
    except (ValueError, RecursionError) as exc:  # not TOMLDecodeError: a number may have too many digits
        raise FormatError(where, 0, f"not TOML ({_shown(exc, 200)}); expected lines such as: seed = 1") from exc


def setting_types(settings: type) -> dict[str, type]:
    """The type of each field of a dataclass; fields of dataclasses in it by names such as ``motion.place_noise``."""
    found: dict[str, type] = {}
    for name, kind in get_type_hints(settings).items():
        inner = (
            {f"{name}.{one}": type_ for one, type_ in setting_types(kind).items()}
            if isinstance(kind, type) and is_dataclass(kind)
            else {}
        )
        found |= inner or {name: kind}
    return found


def check_settings(where: str, content: Mapping[str, object], settings: type) -> dict[str, Any]:
    """The same values by name, checked: tables are mappings again; whole numbers become numbers where these are meant.

    Args:
        where: the file or flag that they come from, for messages.
        content: values by name, of tables mappings.
        settings: the dataclass that they are for.

    Raises:
        ConfigError: a name is unknown, or a value of another type.
    """
    known = setting_types(settings)
    tables = {name.rpartition(".")[0] for name in known} - {""}
    return _checked_table(where, content, known, tables, "")


def _checked_table(
    where: str, content: Mapping[str, object], known: Mapping[str, type], tables: Container[str], prefix: str
) -> dict[str, Any]:
    checked: dict[str, Any] = {}
    for name, value in content.items():
        full = prefix + name
        if "." in name:
            raise ConfigError(f"{where}: unknown setting '{_shown(full, 60)}'; names with a dot are those of tables")
        if full not in tables:
            checked[name] = _checked(where, full, value, known)
        elif isinstance(value, Mapping):
            checked[name] = _checked_table(where, value, known, tables, f"{full}.")
        else:
            raise ConfigError(f"{where}: {full} = {_shown(value, 60)}: expected a table [{full}] with settings in it")
    return checked


def _checked(where: str, name: str, value: object, known: Mapping[str, type]) -> object:
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(known)}"
        raise ConfigError(f"{where}: unknown setting '{_shown(name, 60)}'; {hint}")
    wanted = known[name]
    if wanted is float and isinstance(value, int) and not isinstance(value, bool) and abs(value) <= sys.float_info.max:
        return float(value)
    if not isinstance(value, wanted) or (isinstance(value, bool) and wanted is not bool):
        raise ConfigError(f"{where}: {name} = {_shown(value, 60)}: expected {_IN_WORDS[wanted]}")
    return value


def _reason(error: OSError | ValueError) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def _shown(value: object, length: int) -> str:
    """The beginning of a value on one line."""
    text = str(value) if not isinstance(value, str) or value.isprintable() else repr(value)
    return "".join(c if c.isprintable() else " " for c in text[:length])
