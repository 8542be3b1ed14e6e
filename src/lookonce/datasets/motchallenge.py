"""MOTChallenge truth (``gt/gt.txt``), also as CVAT exports it with ``gt/labels.txt``."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets.class_names import read_class_names
from lookonce.datasets.text import Table, fault, quoted, read_table, whole
from lookonce.datasets.truth import NO_IDENTITY, Rows, Stated, Truth, checked_boxes
from lookonce.video.images import image_folder, pictures_in, sequence_info

__all__ = ["is_motchallenge", "read_motchallenge"]

MARKED = "marked as ignored"
_COLUMNS = "frame, id, left, top, width, height"
_FLAG, _CLASS, _VISIBILITY = 6, 7, 8
_WORLD_COLUMNS = 10  # from so many on, columns 8 to 10 may be coordinates in the world
# The numbering of MOT16, MOT17 and MOT20. The first seven can be objects of interest, the others cannot.
_BENCHMARK_CLASSES = (
    "pedestrian",
    "person on vehicle",
    "car",
    "bicycle",
    "motorbike",
    "non motorized vehicle",
    "static person",
    "distractor",
    "occluder",
    "occluder on ground",
    "occluder full",
    "reflection",
    "crowd",
)
_STATIC_PERSON = 7
_BENCHMARK = re.compile(r"MOT(16|17|20)-\d", re.IGNORECASE)


def is_motchallenge(folder: Path) -> bool:
    """Whether it is a sequence in this layout."""
    return (folder / "gt" / "gt.txt").is_file()


def read_motchallenge(folder: Path, pictures: Path | None) -> Truth:
    """One sequence from ``gt/gt.txt``, and from ``seqinfo.ini``, ``gt/labels.txt`` and ``ignore.txt`` where they are.

    Six columns or more: frame (from 1), id, left, top, width, height, considered (0 = left out), class, visibility.
    Numbers of boxes are taken as they are, though the benchmarks count pixels from 1. Classes are those of
    ``gt/labels.txt``; else MOT16, MOT17 and MOT20's, if the folder is called so or if nothing but class 1 of 1 to 13 is
    considered; else "class 1" and so on; else, where there is no class, "object".

    Args:
        folder: of the sequence.
        pictures: a folder or a video; None = where ``seqinfo.ini`` says, else ``img1``, else the folder itself.

    Raises:
        FormatError: a file in it breaks its format.
        VideoError: ``seqinfo.ini`` cannot be understood, or names a folder outside.
    """
    path = folder / "gt" / "gt.txt"
    info_path, info = folder / "seqinfo.ini", sequence_info(folder / "seqinfo.ini")
    table = read_table(path, _COLUMNS)
    _check_numbers(table)
    name = folder.resolve().name
    names_path = folder / "gt" / "labels.txt"
    has_names = names_path.is_file()
    labels, classes, left_out = _classes(table, name, read_class_names(names_path) if has_names else None)
    rows = Rows(
        frames=table.values[:, 0].astype(np.int64) - 1,
        identities=table.values[:, 1].astype(np.int64),
        labels=labels,
        xyxy=_corners(table),
        visibility=_visibility(table),
        lines=table.lines,
    )
    kept = left_out == ""
    return Truth(
        path=path,
        name=name,
        layout="cvat" if has_names else "motchallenge",
        pictures=_pictures(folder, info) if pictures is None else pictures,
        fps=_positive(info_path, info, "framerate"),
        stated=_stated_size(info_path, info),
        first_number=1,
        rows=rows[kept],
        frames=np.unique(rows.frames),
        classes=classes,
        ignored=_ignored(folder / "ignore.txt"),
        left_out=Counter(left_out[~kept].tolist()),
    )


def _check_numbers(table: Table) -> None:
    values = table.values
    finite = np.isfinite(values[:, : _FLAG + 1])
    for column in np.flatnonzero(~finite.all(axis=0)):
        table.check(finite[:, column], int(column), f"expected a finite number in column {column + 1}")
    table.check(whole(values[:, 0]), 0, "frame: expected a whole number")
    table.check(values[:, 0] >= 1, 0, "frame: frames count from 1; expected 1 or more")
    table.check(whole(values[:, 1]), 1, "id: expected a whole number")
    if len(values) and (values[:, 1] == -1).all():
        raise fault(table.path, 0, "every id is -1: these are detections, not truth; give the file with identities")


def _corners(table: Table) -> NDArray[np.float64]:
    left_top, size = table.values[:, 2:4], table.values[:, 4:6]
    return np.hstack([left_top, left_top + size])


def _visibility(table: Table) -> NDArray[np.float64]:
    if table.values.shape[1] <= _VISIBILITY or _has_world_coordinates(table):
        return np.ones(len(table.values))
    share = table.values[:, _VISIBILITY]
    return np.where((share >= 0) & (share <= 1), share, 1.0)


def _has_classes(table: Table) -> bool:
    return table.values.shape[1] > _CLASS and not (table.values[:, _CLASS] == -1).all()


def _has_world_coordinates(table: Table) -> bool:
    """Whether column 8 is no class but a coordinate, as in the 3D form of 2D MOT 2015."""
    if table.values.shape[1] < _WORLD_COLUMNS or not _has_classes(table):
        return False
    numbers = table.values[:, _CLASS]
    return not (whole(numbers) & (numbers >= 0)).all()


def _classes(
    table: Table, name: str, names: tuple[str, ...] | None
) -> tuple[NDArray[np.int64], tuple[str, ...], NDArray[np.object_]]:
    """Labels (R,) of the rows, the names of the classes, and why a row is left out (R,), "" = it is not.

    Labels of rows that are left out mean nothing.
    """
    values = table.values
    left_out = np.full(len(values), "", dtype=object)
    left_out[values[:, 1] < 0] = NO_IDENTITY
    if values.shape[1] > _FLAG:
        left_out[values[:, _FLAG] == 0] = MARKED
    if names is None and (not _has_classes(table) or _has_world_coordinates(table)):
        return np.zeros(len(values), np.int64), ("object",), left_out
    numbers = _class_numbers(table, names)
    if names is not None:
        return numbers - 1, names, left_out
    if _is_benchmark(name, numbers, values[:, _FLAG] != 0):
        for number in range(_STATIC_PERSON + 1, len(_BENCHMARK_CLASSES) + 1):
            left_out[numbers == number] = f"no pedestrian (class {number}: {_BENCHMARK_CLASSES[number - 1]})"
        return np.minimum(numbers, _STATIC_PERSON) - 1, _BENCHMARK_CLASSES[:_STATIC_PERSON], left_out
    present = np.unique(numbers[left_out == ""])
    labels = np.searchsorted(present, numbers)
    return labels, tuple(f"class {number}" for number in present.tolist()), left_out


def _class_numbers(table: Table, names: tuple[str, ...] | None) -> NDArray[np.int64]:
    if names is None:
        numbers = table.values[:, _CLASS]
        table.check(whole(numbers) & (numbers >= 0), _CLASS, "class: expected a whole number from 0, or -1 everywhere")
        return numbers.astype(np.int64)
    if table.values.shape[1] <= _CLASS:
        raise fault(
            table.path, 0, "labels.txt names classes, but there is no column 8 with them; remove one of the two"
        )
    numbers = table.values[:, _CLASS]
    fits = whole(numbers) & (numbers >= 1) & (numbers <= len(names))
    table.check(fits, _CLASS, f"class: expected a whole number from 1 to {len(names)}, as many as labels.txt names")
    return numbers.astype(np.int64)


def _is_benchmark(name: str, numbers: NDArray[np.int64], is_considered: NDArray[np.bool_]) -> bool:
    if not ((numbers >= 1) & (numbers <= len(_BENCHMARK_CLASSES))).all():
        return False
    if _BENCHMARK.match(name):
        return True
    return bool(numbers.max(initial=0) >= _STATIC_PERSON and (numbers[is_considered] == 1).all())


def _ignored(path: Path) -> NDArray[np.float32]:
    if not path.is_file():
        return np.zeros((0, 4), np.float32)
    table = read_table(path, "left, top, width, height")
    ltwh = table.values[:, :4]
    return checked_boxes(path, np.hstack([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]]), table.lines)


def _positive(path: Path, info: dict[str, str], key: str) -> float | None:
    text = info.get(key, "").strip()
    if not text:
        return None
    if not re.fullmatch(r"[0-9]{1,9}(\.[0-9]{1,9})?", text) or not float(text):
        raise fault(path, 0, f"{key}: expected a number above 0, got {quoted(text)}; mend or remove it")
    return float(text)


def _stated_size(path: Path, info: dict[str, str]) -> Stated | None:
    height, width = _positive(path, info, "imheight"), _positive(path, info, "imwidth")
    return None if height is None or width is None else Stated((int(height), int(width)), path)


def _pictures(folder: Path, info: dict[str, str]) -> Path:
    if stated := info.get("imdir"):
        return image_folder(folder, stated)
    images = folder / "img1"
    return folder if not images.exists() and pictures_in(folder) else images
