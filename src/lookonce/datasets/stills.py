"""Labelled stills: pictures with YOLO text files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import clip
from lookonce.datasets.class_names import read_class_names, unite
from lookonce.datasets.folders import folders_below
from lookonce.datasets.labelled import LabelledObjects, LabelledStills
from lookonce.datasets.pictures import picture_size
from lookonce.datasets.text import LARGEST_WHOLE, fault, quoted, read_text
from lookonce.datasets.truth import OUTSIDE, checked_boxes
from lookonce.errors import ConfigError
from lookonce.video.images import pictures_in
from lookonce.video.opening import one_line

__all__ = ["open_stills"]

_WITHOUT_LABELS = "pictures without labels"
_DEPTH = 4  # root/set/train/images/part
_PARENTS = 2  # how far above a set its class names may lie
_IMAGES, _LABELS = "images", "labels"
_MAX_UNNAMED = 10_000  # classes; a higher number without names is a mistake
_BOX_COLUMNS, _SCORED_COLUMNS, _LEAST_POLYGON = 5, 6, 7
_FARTHEST = 2.0  # picture widths or heights from the middle; anything farther is in other units


@dataclass(frozen=True, slots=True)
class _Names:
    """The class names of a folder's pictures; no path = classes are numbers."""

    path: Path | None
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Folder:
    """The pictures of one folder, in natural order, and the boxes of each."""

    pictures: list[Path]
    labels: list[NDArray[np.int64]]  # of each picture: (N,)
    boxes: list[NDArray[np.float32]]  # of each picture: xyxy (N, 4)
    names: tuple[str, ...]
    left_out: Counter[str]


def open_stills(path: Path) -> LabelledStills:
    """All pictures at ``path`` and below, in natural order, with the boxes of their YOLO text files.

    The labels of ``images/.../a.jpg`` are in ``labels/.../a.txt`` where there is such a folder, else in ``a.txt``
    beside the picture. A line is ``class cx cy w h`` (a sixth number is ignored), or ``class x1 y1 x2 y2 x3 y3 ...``, a
    polygon, of which the bounding box is taken; as shares of the picture's width and height. Class names are lines of
    ``classes.txt``, ``obj.names`` or another ``*.names`` beside the labels, beside the pictures, in the folder of the
    set or up to two folders above it; else "class 0" and so on. Sets with different names get one numbering.

    A picture with an empty label file has no objects; so has one without a file, which is counted.

    Args:
        path: a folder of pictures, of one set (``images`` and ``labels``), or of several.

    Raises:
        ConfigError: there is no such folder, no picture in it, or more than one file of class names in one place.
        FormatError: a label file breaks its format, or a picture is damaged.
    """
    if not path.is_dir():
        raise ConfigError(f"{one_line(path)}: no such folder; check the spelling")
    folders = [_read_folder(folder, pictures) for folder, pictures in _picture_folders(path)]
    if not folders:
        kinds = "jpg, png, bmp, webp, tif or ppm"
        raise ConfigError(f"{one_line(path)}: no pictures in it or below; expected {kinds}, or a folder images of them")
    classes, numbers = unite([folder.names for folder in folders])
    objects: list[LabelledObjects] = []
    count = 0
    for folder, new in zip(folders, numbers, strict=True):
        for labels, boxes in zip(folder.labels, folder.boxes, strict=True):
            identities = np.arange(count, count + len(boxes), dtype=np.int64)
            objects.append(LabelledObjects(boxes, identities, new[labels], np.ones(len(boxes), np.float32)))
            count += len(boxes)
    return LabelledStills(
        name=path.resolve().name,
        pictures=tuple(picture for folder in folders for picture in folder.pictures),
        objects=tuple(objects),
        classes=classes,
        left_out=dict(sum((folder.left_out for folder in folders), Counter[str]())),
    )


def _picture_folders(root: Path) -> Iterator[tuple[Path, list[Path]]]:
    for folder in [root, *folders_below(root, _DEPTH, closed=(_LABELS,))]:
        pictures = pictures_in(folder)
        if pictures:
            yield folder, pictures


def _read_folder(folder: Path, pictures: list[Path]) -> _Folder:
    label_folder, set_folder = _label_folder(folder)
    names = _class_names([label_folder, folder, set_folder, *list(set_folder.absolute().parents)[:_PARENTS]])
    found = _Folder(pictures, [], [], names.names, Counter())
    for picture in pictures:
        size = picture_size(picture)
        path = label_folder / f"{picture.stem}.txt"
        if path.is_file():
            labels, boxes, outside = _read_labels(path, size, names)
        else:
            labels, boxes, outside = np.zeros(0, np.int64), np.zeros((0, 4), np.float32), 0
            found.left_out[_WITHOUT_LABELS] += 1
        found.labels.append(labels)
        found.boxes.append(boxes)
        if outside:
            found.left_out[OUTSIDE] += outside
    if names.path is not None:
        return found
    highest = max((int(labels.max()) for labels in found.labels if len(labels)), default=-1)
    return _Folder(pictures, found.labels, found.boxes, tuple(f"class {n}" for n in range(highest + 1)), found.left_out)


def _label_folder(folder: Path) -> tuple[Path, Path]:
    """The folder of the label files of a folder's pictures, and that of their set."""
    whole = folder.absolute()
    for images in [whole, *list(whole.parents)[:_DEPTH]]:
        labels = images.parent / _LABELS / whole.relative_to(images)
        if images.name == _IMAGES and labels.is_dir():
            return labels, images.parent
    return folder, folder


def _class_names(folders: list[Path]) -> _Names:
    for folder in folders:
        for name in ("classes.txt", "obj.names"):
            if (folder / name).is_file():
                return _Names(folder / name, read_class_names(folder / name))
        others = sorted(folder.glob("*.names"))
        if len(others) > 1:
            both = f"{others[0].name} and {others[1].name}"
            raise ConfigError(f"{one_line(folder)}: class names in {one_line(both)}; keep one, or add classes.txt")
        if others:
            return _Names(others[0], read_class_names(others[0]))
    return _Names(None, ())


def _read_labels(
    path: Path, size: tuple[int, int], names: _Names
) -> tuple[NDArray[np.int64], NDArray[np.float32], int]:
    """Labels (N,) and boxes xyxy (N, 4) in px of one file, and how many were outside of the picture of ``size``."""
    labels, shares, lines = [], [], []
    for line, text in enumerate(read_text(path).split("\n"), 1):
        fields = text.split()
        if fields:
            numbers = _numbers(path, line, fields)
            labels.append(_label(path, line, numbers[0], names))
            shares.append(_corners(path, line, numbers[1:]))
            lines.append(line)
    height, width = size
    scale = np.array([width, height, width, height], np.float64)
    xyxy = np.array(shares, np.float64).reshape(-1, 4) * scale
    boxes = clip(checked_boxes(path, xyxy, np.array(lines, np.int64)), size)
    inside = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    return np.array(labels, np.int64)[inside], boxes[inside], int((~inside).sum())


def _numbers(path: Path, line: int, fields: list[str]) -> list[float]:
    count = len(fields)
    if count not in (_BOX_COLUMNS, _SCORED_COLUMNS) and (count < _LEAST_POLYGON or count % 2 == 0):
        raise fault(path, line, f"expected class cx cy w h, or a class and at least 3 points, got {count} columns")
    try:
        numbers = [float(text) for text in fields]
    except ValueError:
        raise fault(path, line, f"expected numbers separated by blanks, got {quoted(' '.join(fields))}") from None
    numbers = numbers[:_BOX_COLUMNS] if count == _SCORED_COLUMNS else numbers
    if not all(abs(number) <= _FARTHEST for number in numbers[1:]):  # also for NaN
        expected = "expected shares of the picture's width and height, 0 to 1"
        raise fault(path, line, f"{expected}, got {quoted(' '.join(fields[1:]))}; are these px?")
    return numbers


def _label(path: Path, line: int, number: float, names: _Names) -> int:
    if not number.is_integer() or not 0 <= number <= LARGEST_WHOLE:
        raise fault(path, line, f"class: expected a whole number from 0, got {number:g}")
    if names.path is not None and number >= len(names.names):
        raise fault(
            path, line, f"class {number:g}, but {one_line(names.path)} names 0 to {len(names.names) - 1}; mend one"
        )
    if number >= _MAX_UNNAMED:
        raise fault(path, line, f"class {number:g} without a name; add the file classes.txt")
    return int(number)


def _corners(path: Path, line: int, shares: list[float]) -> tuple[float, float, float, float]:
    if len(shares) == _BOX_COLUMNS - 1:
        x, y, width, height = shares
        return x - width / 2, y - height / 2, x + width / 2, y + height / 2
    return min(shares[::2]), min(shares[1::2]), max(shares[::2]), max(shares[1::2])
