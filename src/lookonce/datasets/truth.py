"""From the rows of one truth file, whatever its layout, to a checked sequence."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import clip
from lookonce.datasets.labelled import LabelledFrame, LabelledObjects, LabelledSequence
from lookonce.datasets.pictures import picture_size
from lookonce.datasets.text import fault
from lookonce.errors import ConfigError, VideoError
from lookonce.video import open_video
from lookonce.video.images import frame_indices, pictures_in
from lookonce.video.opening import one_line

__all__ = [
    "NO_IDENTITY",
    "OUTSIDE",
    "Rows",
    "Stated",
    "Truth",
    "assemble",
    "checked_boxes",
    "picture_folder",
    "relabel",
]

NO_IDENTITY = "no identity"
OUTSIDE = "outside the picture"
_FARTHEST_PX = 1e7  # float32 still tells neighbouring pixels apart


@dataclass(frozen=True, slots=True)
class Rows:
    """Truth rows of one file, in its order; R rows.

    Attributes:
        frames: (R,) int64, from 0.
        identities: (R,) int64.
        labels: (R,) int64.
        xyxy: (R, 4) float64, px, as the file says.
        visibility: (R,) float64, 0 to 1.
        lines: (R,) int64, in the file, from 1.
    """

    frames: NDArray[np.int64]
    identities: NDArray[np.int64]
    labels: NDArray[np.int64]
    xyxy: NDArray[np.float64]
    visibility: NDArray[np.float64]
    lines: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> Rows:
        return Rows(
            self.frames[rows],
            self.identities[rows],
            self.labels[rows],
            self.xyxy[rows],
            self.visibility[rows],
            self.lines[rows],
        )


@dataclass(frozen=True, slots=True)
class Stated:
    """A picture size (height, width) in px, and the file that says so."""

    size: tuple[int, int]
    path: Path


@dataclass(frozen=True, slots=True)
class Truth:
    """What one truth file says, before it is held against the pictures.

    Attributes:
        path: the file.
        name: of the sequence.
        layout: one of ``LAYOUTS``.
        pictures: a folder of pictures or a video file.
        fps: of a picture folder.
        stated: the pictures' size, where a file states it.
        first_number: how the layout counts its first frame.
        rows: objects.
        frames: (F,) int64, rising: the frames that have truth.
        classes: class names.
        ignored: (M, 4) float32, px.
        left_out: why -> rows.
    """

    path: Path
    name: str
    layout: str
    pictures: Path
    fps: float | None
    stated: Stated | None
    first_number: int
    rows: Rows
    frames: NDArray[np.int64]
    classes: tuple[str, ...]
    ignored: NDArray[np.float32]
    left_out: Counter[str]


def assemble(truth: Truth) -> LabelledSequence:
    """The truth as a sequence: boxes checked and cut at the picture's border, frames held against the pictures.

    Raises:
        FormatError: a box, an identity or a stated size cannot be, or no object is left.
        VideoError: there are no pictures, or not for every frame that has truth.
        ConfigError: ``pictures`` is not what is needed.
    """
    _refuse_no_objects(truth, len(truth.rows), truth.left_out)
    _refuse_twins(truth)
    xyxy = checked_boxes(truth.path, truth.rows.xyxy, truth.rows.lines)
    size = _look_at_pictures(truth)
    ignored, left_out, rows = truth.ignored, truth.left_out.copy(), truth.rows
    if size is not None:
        xyxy, ignored = clip(xyxy, size), clip(ignored, size)
        ignored = ignored[_has_area(ignored)]
        inside = _has_area(xyxy)
        rows, xyxy = rows[inside], xyxy[inside]
        left_out += Counter({OUTSIDE: int((~inside).sum())})
        _refuse_no_objects(truth, len(rows), left_out)
    return LabelledSequence(
        name=truth.name,
        layout=truth.layout,
        pictures=truth.pictures,
        fps=truth.fps if truth.pictures.is_dir() else None,
        frames=_frames(rows, xyxy, truth.frames),
        classes=truth.classes,
        ignored=ignored,
        left_out=dict(left_out),
    )


def checked_boxes(path: Path, xyxy: NDArray[np.float64], lines: NDArray[np.int64]) -> NDArray[np.float32]:
    """Boxes ``xyxy (R, 4)`` as float32; ``FormatError`` names the first that is none by its line, of ``lines (R,)``."""
    near = np.abs(xyxy) <= _FARTHEST_PX  # False also for NaN and infinity
    boxes = np.where(near, xyxy, 0).astype(np.float32)
    is_right = near.all(axis=1) & _has_area(boxes)
    if is_right.all():
        return boxes
    row = int(is_right.argmin())
    left, top, right, bottom = xyxy[row].tolist()
    if near[row].all():
        message = f"expected width and height above 0, got {right - left:g} x {bottom - top:g}"
    else:
        corners = f"{left:g}, {top:g}, {right:g}, {bottom:g}"
        message = f"expected finite numbers up to {_FARTHEST_PX:,.0f} px, got corners {corners}"
    raise fault(path, int(lines[row]), f"{message}; mend or remove this box")


def _has_area(xyxy: NDArray[np.float32]) -> NDArray[np.bool_]:
    return (xyxy[:, 2] > xyxy[:, 0]) & (xyxy[:, 3] > xyxy[:, 1])


def _refuse_no_objects(truth: Truth, count: int, left_out: Counter[str]) -> None:
    if not count:
        reasons = ", ".join(f"{rows} {why}" for why, rows in left_out.items())
        why = f" is left (left out: {reasons})" if reasons else " in it"
        raise fault(truth.path, 0, f"no object{why}; check that it is the right file, or leave this sequence out")


def _refuse_twins(truth: Truth) -> None:
    rows = truth.rows
    order = np.lexsort((rows.lines, rows.identities, rows.frames))  # stable: equal lines stay in the file's order
    frames, identities = rows.frames[order], rows.identities[order]
    twins = np.flatnonzero((np.diff(frames) == 0) & (np.diff(identities) == 0))
    if len(twins):
        first, second = order[twins[0]], order[twins[0] + 1]
        raise fault(
            truth.path,
            int(rows.lines[second]),
            f"identity {rows.identities[first]} a second time in frame {rows.frames[first] + truth.first_number} "
            f"(first in line {rows.lines[first]}); remove one or give it another identity",
        )


def _frames(rows: Rows, xyxy: NDArray[np.float32], frames: NDArray[np.int64]) -> tuple[LabelledFrame, ...]:
    order = np.argsort(rows.frames, kind="stable")
    starts = np.searchsorted(rows.frames[order], frames)
    ends = np.searchsorted(rows.frames[order], frames, side="right")
    objects = LabelledObjects(
        xyxy[order], rows.identities[order], rows.labels[order], rows.visibility[order].astype(np.float32)
    )
    return tuple(
        LabelledFrame(frame, objects[start:end])
        for frame, start, end in zip(frames.tolist(), starts.tolist(), ends.tolist(), strict=True)
    )


def picture_folder(path: Path) -> Path:
    """``path`` itself, or the ``img1`` in it where the pictures are in there."""
    inner = path / "img1"
    return inner if not pictures_in(path) and pictures_in(inner) else path


def _look_at_pictures(truth: Truth) -> tuple[int, int] | None:
    """The pictures' (height, width) in px, after a look at whether they fit the truth."""
    path = truth.pictures
    shown = one_line(path)
    if not path.exists():
        raise VideoError(
            f"{shown}: no such pictures for {one_line(truth.path)}; put them there or name them (pictures)"
        )
    if path.is_dir():
        size = _look_into_folder(truth)
    else:
        if not path.is_file():
            raise ConfigError(f"{shown}: pictures must be a folder of pictures or a video file")
        with open_video(path, max_frames=1) as video:
            size = video.size or (0, 0)
    if truth.stated is not None and truth.stated.size != size:
        height, width = truth.stated.size
        said = f"says that the pictures have {width} x {height} px, {shown} has {size[1]} x {size[0]}"
        raise fault(truth.stated.path, 0, f"{said}; mend it, or use the right pictures")
    return size


def _look_into_folder(truth: Truth) -> tuple[int, int]:
    folder = truth.pictures
    paths = pictures_in(folder)
    if not paths:
        remedy = "put them there, or name a folder or a video (pictures)"
        raise VideoError(f"{one_line(folder)}: no pictures in it for {one_line(truth.path)}; {remedy}")
    indices = frame_indices(paths)
    last_name = paths[-1].stem
    if truth.first_number == 0 and last_name.isdecimal() and int(last_name) == indices[-1] + 1:
        raise VideoError(f"{one_line(paths[0])}: the pictures must start with number 0, as the truth does; add it")
    missing = truth.frames[~np.isin(truth.frames, indices)]
    if len(missing):
        more = f" and {len(missing) - 1:,} more that have truth" if len(missing) > 1 else ""
        raise VideoError(
            f"{one_line(folder)}: no picture of frame {missing[0] + truth.first_number}{more}, "
            f"see {one_line(truth.path)}; add the pictures, or remove the truth without pictures"
        )
    size, last = picture_size(paths[0]), picture_size(paths[-1])
    if size != last:
        other = f"{last[1]} x {last[0]} px, the first picture has {size[1]} x {size[0]}"
        raise fault(paths[-1], 0, f"{other}; a sequence needs one size")
    return size


def relabel(truth: Truth, classes: tuple[str, ...], numbers: NDArray[np.int64]) -> Truth:
    """The truth with other ``classes``, label k becoming ``numbers (classes before,)[k]``."""
    return replace(truth, classes=classes, rows=replace(truth.rows, labels=numbers[truth.rows.labels]))
