"""Labelled stills for benchmarks, and detections of any model in their classes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce import Detections
from lookonce.datasets import open_sequences, open_stills, usual_name
from lookonce.evaluation import DetectionTruth
from lookonce.video.images import frame_indices, pictures_in


def usual_names(names: Sequence[str]) -> list[str]:
    """Class names as COCO has them, so that models and labels can be matched."""
    return [usual_name(name) for name in names]


@dataclass(frozen=True, slots=True)
class StillSet:
    """A folder of labelled stills.

    Attributes:
        name: of the folder, and of the list where only some are taken.
        paths: the pictures.
        truths: the true boxes of each.
        classes: names by label, as COCO has them.
    """

    name: str
    paths: tuple[Path, ...]
    truths: tuple[DetectionTruth, ...]
    classes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.paths)

    def images(self) -> Iterator[NDArray[np.uint8]]:
        """Each picture, (H, W, 3) uint8 RGB."""
        for path in self.paths:
            with Image.open(path) as picture:
                yield np.asarray(picture.convert("RGB"))

    def labels_of(self, classes: Sequence[str]) -> list[int]:
        """The labels of some classes."""
        return [self.classes.index(name) for name in usual_names(classes)]

    def count(self, labels: Sequence[int]) -> int:
        """How many true boxes are of these classes."""
        return sum(int(np.isin(truth.labels, labels).sum()) for truth in self.truths)

    def renumber(self, detections: Detections, names: Sequence[str]) -> Detections:
        """The rows whose class, one of a model's ``names``, is among those of the set, with the set's labels."""
        labels = {name: label for label, name in enumerate(self.classes)}
        numbers = np.array([labels.get(name, -1) for name in usual_names(names)], np.int64)[detections.labels]
        known = numbers >= 0
        return Detections(detections.xyxy[known], detections.scores[known], numbers[known])


def read_stills(folder: Path, limit: int | None = None, listed: Path | None = None) -> StillSet:
    """The stills of a folder with the true boxes of all classes.

    Args:
        folder: with ``images`` and ``labels``.
        limit: only the first so many pictures.
        listed: a text file of picture names, one a line, with or without folders and ending; only these pictures. Names
            of another set, such as ``other/images/a.jpg``, and lines that begin with # are passed over.

    Raises:
        ValueError: a listed name is no picture of the folder.
    """
    stills = open_stills(folder)
    rows = list(range(len(stills.pictures)))
    if listed is not None:
        wanted = _names_of(listed, folder.resolve().name)
        rows = [row for row in rows if stills.pictures[row].stem in wanted]
        if missing := wanted - {stills.pictures[row].stem for row in rows}:
            raise ValueError(f"{listed}: no pictures of these names in {folder}: {', '.join(sorted(missing)[:5])}")
    rows = rows[:limit]
    return StillSet(
        name=folder.resolve().name + (f":{listed.stem}" if listed else ""),
        paths=tuple(stills.pictures[row] for row in rows),
        truths=tuple(DetectionTruth(stills.objects[row].xyxy, stills.objects[row].labels) for row in rows),
        classes=tuple(usual_names(stills.classes)),
    )


def _names_of(listed: Path, set_name: str) -> set[str]:
    """The stems of the pictures of one set that a list names."""
    paths = [Path(line.strip()) for line in listed.read_text().splitlines() if line.strip() and line[0] != "#"]
    return {path.stem for path in paths if len(path.parts) < 3 or path.parts[-3] == set_name}


def read_frames(folder: Path, start: int, every: int, only_class: str) -> StillSet:
    """Every so many-th frame of a labelled sequence of pictures, from frame ``start`` on.

    A sequence without classes, whose objects are just objects, has objects of ``only_class``.
    """
    (sequence,) = open_sequences(folder)
    pictures = pictures_in(sequence.pictures)
    paths = dict(zip(frame_indices(pictures), pictures, strict=True))
    frames = [frame for frame in sequence.frames if frame.index >= start and (frame.index - start) % every == 0]
    return StillSet(
        name=f"{sequence.name}:{start}",
        paths=tuple(paths[frame.index] for frame in frames),
        truths=tuple(DetectionTruth(frame.objects.xyxy, frame.objects.labels) for frame in frames),
        classes=(only_class,) if sequence.classes == ("object",) else tuple(usual_names(sequence.classes)),
    )
