"""The results that `lookonce eval` holds against the truth: which file belongs to which sequence, and its boxes."""

from __future__ import annotations

import hashlib
import os
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lookonce.datasets import TrackRows, read_detrac_results, read_mot_results
from lookonce.datasets.jsonl_tracks import read_jsonl_results
from lookonce.errors import ConfigError
from lookonce.evaluation import TrackingResult
from lookonce.video.images import natural_order
from lookonce.video.opening import one_line

__all__ = ["ResultFile", "SequenceResult", "digest", "find_results", "named_paths", "threshold_folders"]

_MOT, _JSON = "tracks.txt", "tracks.jsonl"  # as `lookonce track` calls them
_TABLES = ("_LX", "_LY", "_W", "_H")
_SPEED = "_speed"  # UA-DETRAC's frames per second, beside the tables
_THRESHOLD = re.compile(r"[01]\.[0-9]{1,3}")
_LOOKED_FOR = f"NAME.txt, NAME.jsonl, NAME/{_MOT}, NAME/{_JSON} or NAME_LX.txt and its three others"
_MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class SequenceResult:
    """The boxes of one sequence.

    Attributes:
        result: the boxes.
        class_names: by label; empty where labels are numbers of a MOT file, or -1.
    """

    result: TrackingResult
    class_names: tuple[str, ...] = ()

    @classmethod
    def empty(cls) -> SequenceResult:
        """No boxes."""
        none = np.zeros(0, np.int64)
        return cls(TrackingResult(none, none, np.zeros((0, 4)), none))


@dataclass(frozen=True, slots=True)
class ResultFile:
    """Where the result of one sequence is: a MOT text, JSON lines, or four tables."""

    paths: tuple[Path, ...]

    def read(self) -> SequenceResult:
        """The boxes.

        Raises:
            FormatError: a file breaks its format.
        """
        path = self.paths[0]
        if len(self.paths) > 1:
            rows: TrackRows = read_detrac_results(path.parent, path.stem.removesuffix(_TABLES[0]))
        elif path.suffix.lower() == ".jsonl":
            named = read_jsonl_results(path)
            rows = named.rows
            result = TrackingResult(rows.frames, rows.ids, rows.xyxy, rows.labels, named.left_out)
            return SequenceResult(result, named.names)
        else:
            rows = read_mot_results(path)
        return SequenceResult(TrackingResult.of_rows(rows))

    @property
    def shown(self) -> str:
        """For messages and records."""
        return one_line(self.paths[0])


def digest(paths: Sequence[Path]) -> str:
    """SHA-256 of the files' bytes, one after the other; "" without files."""
    if not paths:
        return ""
    total = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            while chunk := file.read(1 << 20):
                total.update(chunk)
    return total.hexdigest()


def named_paths(given: Sequence[str]) -> dict[str, Path]:
    """``NAME=PATH`` or ``PATH``, which is then named by its last part.

    Raises:
        ConfigError: two have one name, or a path is not there.
    """
    named: dict[str, Path] = {}
    for text in given:
        name, separator, rest = text.partition("=")
        path = Path(text)
        is_named = bool(separator and name and rest) and not os.path.exists(path)  # pathlib raises for very long names
        if is_named:
            path = Path(rest)
        if not os.path.exists(path):
            raise ConfigError(f"{one_line(path)}: no such results; check the spelling")
        if not is_named:
            name = _name_of(path)
        if name in named:
            raise ConfigError(f"two results are called {one_line(name)}; name them: NAME=PATH")
        named[name] = path
    return named


def _name_of(path: Path) -> str:
    absolute = path.absolute()
    if path.name in (_MOT, _JSON):
        return absolute.parent.name
    return absolute.stem if path.is_file() else absolute.name


def threshold_folders(path: Path) -> dict[str, Path]:
    """Folders of one detector threshold each, 0.0 to 1.0, rising; empty where there are not two or more of them."""
    if not path.is_dir():
        return {}
    folders = [one for one in _entries(path) if one.is_dir() and _THRESHOLD.fullmatch(one.name)]
    ordered = sorted(folders, key=lambda folder: float(folder.name))
    return {folder.name: folder for folder in ordered} if len(ordered) > 1 else {}


def find_results(path: Path, names: Sequence[str], *, may_miss: bool, with_classes: bool) -> dict[str, ResultFile]:
    """The result of each sequence, by name; sequences without are absent.

    Args:
        path: a file for one sequence; a folder of them, of runs of ``lookonce track``, or of UA-DETRAC's tables.
        names: of the sequences that have truth.
        may_miss: whether sequences may be without result.
        with_classes: of a run take the JSON lines, which name classes, before the MOT text.

    Raises:
        ConfigError: nothing is recognised, a name has no truth, a sequence has two results, or none.
    """
    found = (
        _in_folder(path, names, with_classes) if path.is_dir() else {_name_of_file(path, names): [ResultFile((path,))]}
    )
    if unknown := sorted(found.keys() - set(names)):
        known = f"the truth has {_some(names)}"
        raise ConfigError(f"{one_line(path)}: results for unknown sequences: {_some(unknown)}; {known}; move them away")
    for name, files in found.items():
        if len(files) > 1:
            both = f"{files[0].shown} and {files[1].shown}"
            raise ConfigError(f"sequence {one_line(name)} has two results: {both}; remove one of them")
    missing = [name for name in names if name not in found]
    if missing and not may_miss:
        remedy = "track them too, or give --missing-as-empty"
        raise ConfigError(
            f"{one_line(path)}: no result for {len(missing)} of {len(names)} sequences: {_some(missing)}; {remedy}"
        )
    return {name: files[0] for name, files in found.items()}


def _some(names: Sequence[str]) -> str:
    rest = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(one_line(name) for name in names[:_MOST_NAMED]) + rest


def _name_of_file(path: Path, names: Sequence[str]) -> str:
    """The sequence that a single file belongs to."""
    if path.stem.endswith(_TABLES):
        raise ConfigError(f"{one_line(path)}: one of UA-DETRAC's four tables; name their folder")
    if len(names) == 1:
        return names[0]
    name = path.absolute().parent.name if path.name in (_MOT, _JSON) else path.stem
    if name not in names:
        remedy = "call it as its sequence, or name the truth of this one only"
        raise ConfigError(
            f"{one_line(path)}: one file for {len(names)} sequences, of which none is {one_line(name)}; {remedy}"
        )
    return name


def _in_folder(folder: Path, names: Sequence[str], with_classes: bool) -> Mapping[str, list[ResultFile]]:
    if run := _run(folder, with_classes):
        own = folder.resolve().name
        return {names[0] if len(names) == 1 else own: [run]}
    found: defaultdict[str, list[ResultFile]] = defaultdict(list)
    entries = _entries(folder)
    files = [one for one in entries if one.suffix.lower() in (".txt", ".jsonl") and one.is_file()]
    tabled = {one.stem.removesuffix(_TABLES[0]) for one in files if one.stem.endswith(_TABLES[0])}
    for name in natural_order(Path(one) for one in tabled):
        found[str(name)].append(ResultFile(tuple(folder / f"{name}{table}.txt" for table in _TABLES)))
    belonging = {f"{name}{part}" for name in tabled for part in (*_TABLES, _SPEED)}
    for file in files:
        if file.stem not in belonging:
            found[file.stem].append(ResultFile((file,)))
    for inner in entries:
        if inner.is_dir() and (run := _run(inner, with_classes)):
            found[inner.name].append(run)
    if not found:
        raise ConfigError(f"{one_line(folder)}: no results are recognised here; looked for {_LOOKED_FOR}")
    return found


def _entries(folder: Path) -> list[Path]:
    """What is in a folder, hidden things left out, in natural order."""
    try:
        return natural_order(one for one in folder.iterdir() if not one.name.startswith("."))
    except OSError as exc:
        raise ConfigError(f"{one_line(folder)}: cannot be listed ({exc.strerror}); check its permissions") from exc


def _run(folder: Path, with_classes: bool) -> ResultFile | None:
    """What ``lookonce track`` left in a folder."""
    order = (_JSON, _MOT) if with_classes else (_MOT, _JSON)
    return next((ResultFile((folder / name,)) for name in order if (folder / name).is_file()), None)
