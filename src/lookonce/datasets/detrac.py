"""UA-DETRAC sequences: where annotations and pictures lie, and what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets.detrac_xml import ROW_LENGTH, read_annotation
from lookonce.datasets.folders import folders_below
from lookonce.datasets.text import fault
from lookonce.datasets.truth import Rows, Truth, checked_boxes
from lookonce.video.images import pictures_in

__all__ = ["PicturePlaces", "annotation_files", "read_detrac"]

_ANNOTATIONS = "annotations-xml"  # in the names of the folders as distributed, in lower case
_SEQUENCE = "MVI_"
_ANNOTATIONS_DEPTH, _PICTURES_DEPTH = 2, 4
_FPS = 25.0


def annotation_files(folder: Path) -> list[Path]:
    """The XML files of a root as distributed, of an annotation folder, or beside pictures; in no certain order."""
    below = folders_below(folder, _ANNOTATIONS_DEPTH, closed=(_SEQUENCE,))
    places = [place for place in below if _ANNOTATIONS in place.name.casefold()]
    return [path for place in (places or [folder]) for path in sorted(place.glob("*.xml")) if path.is_file()]


class PicturePlaces:
    """Where pictures of annotations may be; each root is searched once, and only when asked for."""

    def __init__(self) -> None:
        self._places: dict[Path, dict[str, Path]] = {}

    def find(self, path: Path, name: str) -> Path:
        """The folder with the pictures of sequence ``name``, annotated in the file ``path``; it may not exist."""
        beside = path.parent
        for folder in (beside / name, beside / path.stem, beside):
            if pictures_in(folder):
                return folder
        root = beside
        while _ANNOTATIONS in root.name.casefold():
            root = root.parent
        if root not in self._places:
            self._places[root] = _folders_by_name(root)
        places = self._places[root]
        return places.get(name, places.get(path.stem, beside / name))


def _folders_by_name(root: Path) -> dict[str, Path]:
    """Of several folders of one name, the first with pictures."""
    places: dict[str, Path] = {}
    for folder in folders_below(root, _PICTURES_DEPTH, closed=(_SEQUENCE,)):
        if folder.name not in places or not pictures_in(places[folder.name]):
            places[folder.name] = folder
    return places


def read_detrac(path: Path, pictures: Path | None, places: PicturePlaces) -> Truth:
    """One sequence. Numbers of boxes are taken as they are, though UA-DETRAC counts pixels from 1.

    Args:
        path: the XML file.
        pictures: a folder or a video; None = the folder called as the sequence or as the file, or the file's
            own folder.
        places: finds that folder.

    Raises:
        FormatError: it breaks its format.
    """
    annotation = read_annotation(path)
    values = np.array(annotation.rows, np.float64).reshape(-1, ROW_LENGTH)
    whole = values[:, [0, 1, 2, 8]].astype(np.int64)
    classes = tuple(sorted(annotation.types))
    order = np.array([classes.index(name) for name in annotation.types], np.int64)
    name = annotation.name or path.stem
    if not name.isprintable() or "/" in name or "\\" in name:
        raise fault(path, 0, "the name of <sequence> is no plain name such as MVI_20011; mend it")
    return Truth(
        path=path,
        name=name,
        layout="ua-detrac",
        pictures=places.find(path, name) if pictures is None else pictures,
        fps=_FPS,
        stated=None,
        first_number=1,
        rows=Rows(whole[:, 0] - 1, whole[:, 1], order[whole[:, 2]], values[:, 3:7], values[:, 7], whole[:, 3]),
        frames=np.unique(np.array(annotation.frames, np.int64)) - 1,
        classes=classes,
        ignored=_ignored(path, np.array(annotation.ignored, np.float64).reshape(-1, 5)),
        left_out=annotation.left_out,
    )


def _ignored(path: Path, values: NDArray[np.float64]) -> NDArray[np.float32]:
    return checked_boxes(path, values[:, :4], values[:, 4].astype(np.int64))
