"""Labelled sequences from a folder or a file, whatever layout is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from lookonce.datasets.class_names import unite
from lookonce.datasets.detrac import PicturePlaces, annotation_files, read_detrac
from lookonce.datasets.folders import folders_below
from lookonce.datasets.kitti import LABELS, kitti_files, read_kitti
from lookonce.datasets.labelled import LabelledSequence
from lookonce.datasets.motchallenge import is_motchallenge, read_motchallenge
from lookonce.datasets.truth import Truth, assemble, picture_folder, relabel
from lookonce.errors import ConfigError
from lookonce.video.images import is_image, natural_order
from lookonce.video.opening import one_line

__all__ = ["open_sequences"]

_ROOT_DEPTH = 2  # MOT17/train/MOT17-02
_LOOKED_FOR = (
    "gt/gt.txt (MOTChallenge, CVAT), label_02 (KITTI), *.xml or a folder *Annotations-XML (UA-DETRAC), "
    "or folders of such sequences"
)


@dataclass(frozen=True, slots=True)
class _Found:
    """A sequence that is there and not yet read: its truth file or folder, and what reads it."""

    path: Path
    read: Callable[[Path, Path | None], Truth]


def open_sequences(path: Path, *, pictures: Path | None = None) -> tuple[LabelledSequence, ...]:
    """All sequences with truth at ``path``, by name in natural order; the layout is recognised by what is there.

    - MOTChallenge: a sequence (``gt/gt.txt``, pictures in ``img1`` or where ``seqinfo.ini`` says) or folders of them.
      With ``gt/labels.txt`` it is CVAT's "MOT 1.1". An ``ignore.txt`` beside ``gt`` holds ignored regions.
    - UA-DETRAC: the root as distributed, a folder with XML and pictures, or one XML file.
    - KITTI tracking: the root with ``label_02`` and ``image_02`` (or its ``training``), or one file of ``label_02``.

    Boxes are left, top, left + width, top + height as the files give them (KITTI: its corners), though MOTChallenge and
    UA-DETRAC count pixels from 1; then cut at the picture's border. Rows that do not count are left out and counted.
    ``visibility`` is MOTChallenge's column 9; for UA-DETRAC 1 less the share of the box that others cover; for KITTI 1,
    0.6, 0.2 or 0, which stand in for its words. A pass over the pictures' names and first and last headers (of a video:
    its first frame) holds them against the truth; the number of a video's frames is not looked at.

    Args:
        path: a folder or a file.
        pictures: where the pictures are, if elsewhere: a folder or a video file. Only for a single sequence.

    Raises:
        ConfigError: nothing is recognised at ``path``, or ``pictures`` does not fit.
        FormatError: a truth file breaks its format, contradicts the pictures, or holds no object.
        VideoError: pictures are missing or cannot be read.
    """
    found = _find(path)
    if pictures is not None:
        pictures = _usable(pictures, path, len(found))
    truths = [one.read(one.path, pictures) for one in found]
    by_name: dict[str, Truth] = {}
    for truth in truths:
        twin = by_name.setdefault(truth.name, truth)
        if twin is not truth:
            both = f"{one_line(twin.path)} and {one_line(truth.path)}"
            raise ConfigError(
                f"two sequences are called {one_line(truth.name)}: {both}; name the folder of one of them"
            )
    classes, numbers = unite([truth.classes for truth in truths])
    sequences = {
        Path(truth.name): assemble(relabel(truth, classes, new)) for truth, new in zip(truths, numbers, strict=True)
    }
    return tuple(sequences[name] for name in natural_order(sequences))


def _find(path: Path) -> list[_Found]:
    if path.is_file():
        return [_find_file(path)]
    if not path.is_dir():
        raise ConfigError(f"{one_line(path)}: no such folder or file; check the spelling")
    found = _find_in(path)
    if not found:
        below = folders_below(path, _ROOT_DEPTH)
        found = [one for folder in below for one in _find_sequence(folder)]
    if not found:
        raise ConfigError(f"{one_line(path)}: no truth is recognised here; looked for {_LOOKED_FOR}")
    return found


def _find_file(path: Path) -> _Found:
    if path.suffix.lower() == ".xml":
        return _detrac([path])[0]
    if path.name == "gt.txt" and path.absolute().parent.name == "gt":
        return _Found(path.absolute().parent.parent, read_motchallenge)
    if path.suffix.lower() == ".txt" and path.absolute().parent.name == LABELS:
        return _Found(path, read_kitti)
    expected = f"expected gt/gt.txt, {LABELS}/0000.txt or a UA-DETRAC XML"
    raise ConfigError(f"{one_line(path)}: not a truth file that is known by its name; {expected}, or a folder")


def _find_in(folder: Path) -> list[_Found]:
    """The sequences of a folder that is a sequence or a root as distributed."""
    if is_motchallenge(folder):
        return [_Found(folder, read_motchallenge)]
    if files := kitti_files(folder):
        return [_Found(file, read_kitti) for file in natural_order(files)]
    return _detrac(natural_order(annotation_files(folder)))


def _find_sequence(folder: Path) -> list[_Found]:
    """The sequences of a folder among others, which may well hold XML of other kinds."""
    if is_motchallenge(folder):
        return [_Found(folder, read_motchallenge)]
    return _detrac(natural_order(folder.glob("MVI_*.xml")))


def _detrac(files: list[Path]) -> list[_Found]:
    places = PicturePlaces()
    return [_Found(file, partial(read_detrac, places=places)) for file in files]


def _usable(pictures: Path, path: Path, count: int) -> Path:
    if count != 1:
        raise ConfigError(f"{one_line(path)}: holds {count} sequences, and pictures fit one only; name one sequence")
    if pictures.is_file() and is_image(pictures):
        raise ConfigError(f"{one_line(pictures)}: a single picture; pictures must be a folder of them or a video file")
    return picture_folder(pictures)
