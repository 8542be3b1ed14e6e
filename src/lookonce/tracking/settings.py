"""Settings of a tracker as TOML text, and changes of single ones by name."""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from inspect import cleandoc
from pathlib import Path
from typing import Any, cast

from lookonce.config import check_settings, read_toml, setting_types
from lookonce.errors import ConfigError
from lookonce.tracking.paper import PaperConfig
from lookonce.tracking.tracker import PRESETS, TrackerConfig

__all__ = [
    "ChosenTracker",
    "change_tracker_settings",
    "choose_tracker",
    "read_tracker_settings",
    "replace_settings",
    "tracker_settings_toml",
]

_PRESET = "preset"
_THRESHOLD = "match_threshold"
_LINE = 110
_SHOWN = 60
_LONGEST_PATH = 4096
_FIRST_LINES = "Settings of the tracker; what is left out keeps the preset's value."
_THRESHOLD_LINE = "Named here, it goes before what the model file says."


@dataclass(frozen=True, slots=True)
class ChosenTracker:
    """Settings that somebody chose.

    Attributes:
        config: all of them.
        has_threshold: whether the match threshold was named: then it goes before the calibrated one of a model file.
    """

    config: TrackerConfig
    has_threshold: bool = False

    def threshold(self, flag: float | None = None) -> float | None:
        """The match threshold that somebody named, in a flag of its own or here; None = nobody did."""
        return self.config.match_threshold if flag is None and self.has_threshold else flag


def choose_tracker(given: str, changes: Sequence[str] = ()) -> ChosenTracker:
    """The settings of a preset or a TOML file, changed.

    Args:
        given: a preset's name, or the path of a file: with the ending .toml, or in another folder.
        changes: such as ``memory_s=4`` or ``motion.place_noise=0.1``; of one name the last counts.

    Raises:
        ConfigError: there is no such preset or file, or a setting is unknown or out of range.
        FormatError: the file is not TOML.
    """
    if given in PRESETS:
        chosen = ChosenTracker(PRESETS[given]())
    elif given.casefold().endswith(".toml") or "/" in given or "\\" in given:
        chosen = _read(Path(given))
    else:
        raise ConfigError(f"tracker {given!r}: expected one of {', '.join(PRESETS)}, or a file such as tracker.toml")
    names = {change.partition("=")[0].strip() for change in changes}
    config = change_tracker_settings(chosen.config, changes)
    return ChosenTracker(config, chosen.has_threshold or _THRESHOLD in names)


def read_tracker_settings(path: Path) -> TrackerConfig:
    """The settings of a TOML file: ``preset = "default"``, then settings by name, those of motion in ``[motion]``.

    What is not named keeps the preset's value.

    Raises:
        ConfigError: the file cannot be read, or a name or value in it is wrong; it is named with the nearest known one.
        FormatError: it is not TOML.
    """
    return _read(path).config


def _read(path: Path) -> ChosenTracker:
    content, where = read_toml(path), _shown(str(path), _LONGEST_PATH)
    preset = content.pop(_PRESET, None)
    if not isinstance(preset, str) or preset not in PRESETS:
        known = ", ".join(f'"{name}"' for name in PRESETS)
        near = difflib.get_close_matches(preset, PRESETS, n=1) if isinstance(preset, str) else []
        hint = f"did you mean {near[0]}?" if near else f"expected {_PRESET} = one of {known}"
        what = "is missing" if preset is None else f"= {_shown(str(preset))}"
        raise ConfigError(f"{where}: {_PRESET} {what}; {hint}")
    return ChosenTracker(_changed(where, PRESETS[preset](), content), _THRESHOLD in content)


def change_tracker_settings(config: TrackerConfig, changes: Sequence[str]) -> TrackerConfig:
    """The same settings with some changed, one after the other.

    Args:
        config: what they are now.
        changes: such as ``memory_s=4`` or ``motion.place_noise=0.1``.

    Raises:
        ConfigError: a change has no ``=``, a setting is unknown, or a value cannot be.

    >>> change_tracker_settings(PRESETS["default"](), ["motion.place_noise=0.2"]).motion.place_noise
    0.2
    """
    for change in changes:
        name, equals, value = (part.strip() for part in change.partition("="))
        where = f"setting {_shown(change)!r}"
        if not (name and equals and value):
            raise ConfigError(f"{where}: expected NAME=VALUE such as memory_s=4 or motion.place_noise=0.1")
        config = replace_settings(config, {name: _value(value)}, where)
    return config


def replace_settings(config: TrackerConfig, values: Mapping[str, object], where: str = "settings") -> TrackerConfig:
    """The same settings with some replaced by name, such as ``memory_s`` or ``motion.place_noise``.

    Args:
        config: what they are now.
        values: the new ones.
        where: they come from, for messages.

    Raises:
        ConfigError: a setting is unknown, or a value cannot be.
    """
    content: dict[str, Any] = {}
    for name, value in values.items():
        table, _, inner = name.rpartition(".") if name.count(".") == 1 else ("", "", name)
        if table:
            content.setdefault(table, {})[inner] = value
        else:
            content[name] = value
    return _changed(where, config, content)


def _value(text: str) -> object:
    """``true``, ``false``, a whole number or a number; else the text itself."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:  # not such a number
            continue
    return text


def _changed(where: str, config: TrackerConfig, content: Mapping[str, object]) -> TrackerConfig:
    values = check_settings(where, content, type(config))
    for name, value in values.items():
        if isinstance(value, dict):
            values[name] = _replaced(where, getattr(config, name), value, f"{name}.")
    return cast(TrackerConfig, _replaced(where, config, values, ""))


def _replaced(where: str, config: Any, values: Mapping[str, Any], prefix: str) -> Any:
    try:
        return replace(config, **values)
    except ConfigError as exc:
        raise ConfigError(f"{where}: {prefix}{exc}") from exc


def tracker_settings_toml(config: TrackerConfig, *, leaves_threshold: bool = False, about: Sequence[str] = ()) -> str:
    """All settings as TOML, which ``read_tracker_settings`` reads back as the same.

    What each means stands above it, as the settings' own documentation has it. Nothing but these comments is taken
    from there, so a setting without documentation, or Python run without any (``-OO``), only lacks its comment.

    Args:
        config: the settings.
        leaves_threshold: write the match threshold as a comment: reading it back gives the preset's, and a model file
            may still say another.
        about: first lines, as comments.
    """
    preset = "paper" if isinstance(config, PaperConfig) else "default" if config.appearance else "iou"
    lines = [*_comment(about or [_FIRST_LINES]), f'{_PRESET} = "{preset}"']
    skipped = {_THRESHOLD} if leaves_threshold else set()
    lines += _lines(config, skipped)
    for field in fields(config):
        inner = getattr(config, field.name)
        if is_dataclass(inner) and not isinstance(inner, type):
            lines += ["", *_comment([_meanings(type(config)).get(field.name, "")]), f"[{field.name}]", *_lines(inner)]
    return "\n".join(lines) + "\n"


def _lines(settings: Any, skipped: set[str] | None = None) -> Iterator[str]:
    """Lines of the plain fields, each with its comment."""
    meanings = _meanings(type(settings))
    for name, kind in setting_types(type(settings)).items():
        if "." in name:
            continue
        value = kind(getattr(settings, name))
        text = str(value).lower() if kind is bool else repr(value)
        yield ""
        yield from _comment([meanings.get(name, ""), *([_THRESHOLD_LINE] if name == _THRESHOLD else [])])
        yield f"{'# ' if name in (skipped or set()) else ''}{name} = {text}"


def _comment(paragraphs: Sequence[str]) -> Iterator[str]:
    for paragraph in filter(None, paragraphs):
        plain = "".join(c if c.isprintable() else " " for c in paragraph)
        yield from textwrap.wrap(plain, _LINE, initial_indent="# ", subsequent_indent="# ", break_long_words=False)


def _meanings(settings: type) -> dict[str, str]:
    """What the documentation of a dataclass says of each field, in one line."""
    found: dict[str, str] = {}
    name = ""
    _, _, section = cleandoc(settings.__doc__ or "").partition("\nAttributes:\n")
    for line in section.splitlines():
        if line.startswith(" " * 8) and name:
            found[name] += f" {line.strip()}"
        elif line.startswith(" " * 4):
            name, _, meaning = line.strip().partition(": ")
            found[name] = meaning
        elif line:
            break
    return {name: meaning.replace("``", "`") for name, meaning in found.items()}


def _shown(text: str, length: int = _SHOWN) -> str:
    return "".join(c if c.isprintable() else " " for c in text[:length])
