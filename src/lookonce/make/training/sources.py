"""Where identities come from: pictures for the detector to read, with boxes whose identity is known.

Every source hands out *tasks*, each good for one pass of the detector: called in any thread, a task renders its canvas.
All choices follow from the seed and the task's number, so an interrupted reading goes on where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from PIL import Image, ImageOps

from lookonce.datasets import LabelledSequence, LabelledStills
from lookonce.errors import FormatError, VideoError
from lookonce.letterbox import Letterboxer
from lookonce.make.training.augment import View, collage, jitter_boxes, view
from lookonce.make.training.linking import Links
from lookonce.video import Frame, open_video

__all__ = ["Canvas", "SequenceSource", "Source", "StillsSource", "Task", "TrackedBoxes"]

_LEAST_SIDE_PX = 6.0  # of a box on the canvas: below, the finest map has a cell or two of it
_LEAST_VISIBLE = 0.6
_OBJECTS_A_COLLAGE = 24
_OBJECTS_A_STILL = 16  # more of one picture add little
_CROP_HEIGHT_PX = 140.0  # of objects that are kept for collages, at least where they are as large
_ORIENTATION = 0x0112  # EXIF tag; 5 to 8 lie on their side
_ALWAYS = (0, 2**31 - 1)  # alive in all frames


@dataclass(frozen=True, slots=True)
class Canvas:
    """A picture as the network reads it, with N objects.

    Attributes:
        pixels: (H, W, 3) uint8 RGB of the network's size.
        boxes: xyxy (N, 4) float32 px of the canvas.
        identities: (N,) int64, unique within the source.
        frames: (N,) int64: number of the frame, or of the view.
        heights_px: (N,) float32, of the box on the canvas.
    """

    pixels: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    identities: NDArray[np.int64]
    frames: NDArray[np.int64]

    @property
    def heights_px(self) -> NDArray[np.float32]:
        """(N,) heights of the boxes."""
        return self.boxes[:, 3] - self.boxes[:, 1]


Task = Callable[[], Canvas]


class Source(Protocol):
    """Pictures with objects of known identity.

    Attributes:
        name: for messages.
        task_count: how many tasks there are.
        lifetimes: by identity the first and last frame in which it exists; two identities are surely different objects
            only where these overlap.
        scenes: by identity the scene it belongs to, numbered from 0: identities of one scene were seen side by side.
        held_out: identities kept for validation.
    """

    @property
    def name(self) -> str:
        """For messages."""
        ...

    @property
    def task_count(self) -> int:
        """How many tasks there are."""
        ...

    @property
    def lifetimes(self) -> NDArray[np.int64]:
        """(identities, 2)."""
        ...

    @property
    def scenes(self) -> NDArray[np.int64]:
        """(identities,)."""
        ...

    @property
    def held_out(self) -> NDArray[np.bool_]:
        """(identities,)."""
        ...

    def tasks(self) -> Iterator[Task]:
        """All tasks in order."""
        ...


@dataclass(frozen=True, slots=True)
class TrackedBoxes:
    """Boxes with identities in the frames of one video or folder of pictures; R rows ordered by frame.

    Attributes:
        name: for messages.
        pictures: what ``open_video`` takes.
        fps: of a folder of pictures; None = the video's own clock.
        frames: (R,) int64 index from 0.
        xyxy: (R, 4) float32 px of the picture.
        identities: (R,) int64 from 0, without gaps.
        is_complete: whether an object has one identity only. False for tracks made by linking, where two tracks that
            are not alive at once may be one object.
    """

    name: str
    pictures: Path
    fps: float | None
    frames: NDArray[np.int64]
    xyxy: NDArray[np.float32]
    identities: NDArray[np.int64]
    is_complete: bool

    @classmethod
    def of_sequence(cls, sequence: LabelledSequence) -> TrackedBoxes:
        """The truth of a labelled sequence."""
        count = [len(frame.objects) for frame in sequence.frames]
        identities = np.concatenate([frame.objects.identities for frame in sequence.frames])
        return cls(
            sequence.name,
            sequence.pictures,
            sequence.fps,
            np.repeat([frame.index for frame in sequence.frames], count).astype(np.int64),
            np.concatenate([frame.objects.xyxy for frame in sequence.frames]),
            np.unique(identities, return_inverse=True)[1].astype(np.int64),
            is_complete=True,
        )

    @classmethod
    def of_links(cls, name: str, pictures: Path, links: Links) -> TrackedBoxes:
        """The pure tracks of an unlabelled video."""
        return cls(
            name,
            pictures,
            None,
            np.array([row.frame for row in links.rows], np.int64),
            np.array([row.xyxy for row in links.rows], np.float32).reshape(-1, 4),
            np.array([row.track for row in links.rows], np.int64),
            is_complete=False,
        )


class SequenceSource:
    """Frames whose boxes carry identities: each chosen one as it is, and once transformed.

    Args:
        tracked: boxes with identities.
        size: of the network's input (height, width) in px.
        frames: at most so many frames, evenly spread.
        held_out: (identities,) which are kept for validation; their frames are shown as they are only.
        seed: of all choices.
    """

    def __init__(
        self,
        tracked: TrackedBoxes,
        size: tuple[int, int],
        *,
        frames: int,
        held_out: NDArray[np.bool_],
        seed: Sequence[int],
    ) -> None:
        self.name = tracked.name
        self.held_out = held_out
        self._tracked, self._size, self._seed = tracked, size, tuple(seed)
        present = np.unique(tracked.frames)
        even = np.linspace(0, len(present) - 1, min(frames, len(present))).round().astype(int)
        self._chosen = present[np.unique(even)]
        self.task_count = 2 * len(self._chosen)
        self.scenes = np.zeros(len(held_out), np.int64)
        self.lifetimes = np.tile(np.array(_ALWAYS, np.int64), (len(held_out), 1))
        if not tracked.is_complete:
            self.lifetimes[:, 0] = _ALWAYS[1]
            np.minimum.at(self.lifetimes[:, 0], tracked.identities, tracked.frames)
            self.lifetimes[:, 1] = 0
            np.maximum.at(self.lifetimes[:, 1], tracked.identities, tracked.frames)

    def tasks(self) -> Iterator[Task]:
        """Two for each chosen frame.

        Raises:
            VideoError: there are boxes for frames that the pictures do not have.
        """
        wanted = set(self._chosen.tolist())
        last = int(self._chosen[-1]) if len(self._chosen) else -1
        letterbox = Letterboxer(self._size)
        with open_video(self._tracked.pictures, fps=self._tracked.fps) as video:
            for frame in video:
                if frame.index in wanted:
                    wanted.discard(frame.index)
                    pixels, placed = letterbox(frame.picture, frame.rotation)
                    yield partial(self._as_is, frame.index, pixels, placed.to_network(self._boxes(frame.index)))
                    yield partial(self._transformed, frame)
                if frame.index >= last:
                    break
        if wanted:
            raise VideoError(
                f"{self._tracked.pictures}: has no frame {min(wanted)} (counted from 0), for which {self.name} has"
                f" boxes ({len(wanted)} such frames); give the pictures that belong to the truth"
            )

    def _boxes(self, index: int) -> NDArray[np.float32]:
        boxes: NDArray[np.float32] = self._tracked.xyxy[self._tracked.frames == index]
        return boxes

    def _as_is(self, index: int, pixels: NDArray[np.uint8], boxes: NDArray[np.float32]) -> Canvas:
        identities = self._tracked.identities[self._tracked.frames == index]
        is_held = self.held_out[identities]
        jittered = jitter_boxes(boxes.astype(np.float64), np.random.default_rng([*self._seed, index]))
        boxes = np.where(is_held[:, None], boxes, jittered)
        return _canvas(pixels, boxes, identities, np.full(len(boxes), index), (boxes[:, 3] > boxes[:, 1]))

    def _transformed(self, frame: Frame) -> Canvas:
        rng = np.random.default_rng([*self._seed, frame.index, 1])
        rows = self._tracked.frames == frame.index
        identities = self._tracked.identities[rows]
        seen = view(Image.fromarray(frame.image), self._tracked.xyxy[rows].astype(np.float64), self._size, rng)
        is_usable = (seen.visible >= _LEAST_VISIBLE) & ~self.held_out[identities]
        return _canvas_of_view(seen, identities, np.full(len(identities), frame.index), is_usable, rng)


@dataclass(frozen=True, slots=True)
class _Object:
    """A labelled box of a still: where it is, and its picture once it has been cut out."""

    picture: int
    box: NDArray[np.float64]
    identity: int


class StillsSource:
    """Stills, each box its own identity: views of whole pictures, and collages of objects of many.

    Args:
        stills: pictures with boxes.
        size: of the network's input (height, width) in px.
        views: of each picture.
        collages: how often each object is put into a collage.
        held_out: share of the pictures whose objects are kept for validation.
        seed: of all choices.
    """

    def __init__(
        self,
        stills: LabelledStills,
        size: tuple[int, int],
        *,
        views: int,
        collages: int,
        held_out: float,
        seed: Sequence[int],
    ) -> None:
        self.name = stills.name
        self._stills, self._size, self._views, self._seed = stills, size, views, tuple(seed)
        rng = np.random.default_rng([*self._seed, 0])
        self._objects: list[_Object] = []
        self._of_picture: list[list[_Object]] = []
        is_held_picture = rng.random(len(stills.pictures)) < held_out
        for index, objects in enumerate(stills.objects):
            chosen = [_Object(index, box, 0) for box in self._choose(objects.xyxy, stills.pictures[index], rng)]
            numbered = [_Object(o.picture, o.box, len(self._objects) + n) for n, o in enumerate(chosen)]
            self._of_picture.append(numbered)
            self._objects += numbered
        self.held_out = np.array([is_held_picture[o.picture] for o in self._objects], bool)
        self.lifetimes = np.tile(np.array(_ALWAYS, np.int64), (len(self._objects), 1))
        self.scenes = np.array([o.picture for o in self._objects], np.int64)
        self._shown = [index for index, objects in enumerate(self._of_picture) if objects]
        self._collages = [part for number in range(collages) for part in self._shuffled(number)]
        self._cut: dict[int, tuple[Image.Image, NDArray[np.float64]]] = {}
        self.task_count = len(self._shown) * views + len(self._collages)

    def _choose(self, xyxy: NDArray[np.float32], path: Path, rng: Generator) -> NDArray[np.float64]:
        boxes = xyxy.astype(np.float64)
        return boxes[np.sort(rng.permutation(len(boxes))[:_OBJECTS_A_STILL])]

    def _shuffled(self, number: int) -> list[list[int]]:
        """All identities in random parts; those for validation among themselves."""
        rng = np.random.default_rng([*self._seed, 1, number])
        parts = []
        for is_held in (False, True):
            order = rng.permutation(np.flatnonzero(self.held_out == is_held))
            parts += [
                order[start : start + _OBJECTS_A_COLLAGE].tolist() for start in range(0, len(order), _OBJECTS_A_COLLAGE)
            ]
        return parts

    def tasks(self) -> Iterator[Task]:
        """Views, picture by picture; then collages.

        Raises:
            FormatError: a picture is damaged.
        """
        for index in self._shown:
            yield from (partial(self._view, index, number) for number in range(self._views))
        for number, part in enumerate(self._collages):
            yield partial(self._collage, number, part)

    def _view(self, index: int, number: int) -> Canvas:
        rng = np.random.default_rng([*self._seed, 2, index, number])
        picture, factor = _open_picture(self._stills.pictures[index], self._size)
        objects = self._of_picture[index]
        boxes = np.array([o.box for o in objects]).reshape(-1, 4) * factor
        seen = view(picture, boxes, self._size, rng)
        identities = np.array([o.identity for o in objects], np.int64)
        return _canvas_of_view(seen, identities, np.full(len(objects), number), seen.visible >= _LEAST_VISIBLE, rng)

    def _collage(self, number: int, part: Sequence[int]) -> Canvas:
        rng = np.random.default_rng([*self._seed, 3, number])
        background, _ = _open_picture(self._stills.pictures[rng.integers(len(self._stills.pictures))], self._size)
        seen = collage(background, [self._cut_out(identity) for identity in part], self._size, rng)
        frames = np.full(len(part), self._views + number)
        return _canvas_of_view(seen, np.array(part, np.int64), frames, seen.visible >= _LEAST_VISIBLE, rng)

    def _cut_out(self, identity: int) -> tuple[Image.Image, NDArray[np.float64]]:
        """The object with some surroundings, small enough to be kept, and its box in that."""
        if identity not in self._cut:
            found = self._objects[identity]
            picture, factor = _open_picture(self._stills.pictures[found.picture], self._size)
            for other in self._of_picture[found.picture]:
                self._cut[other.identity] = _crop(picture, other.box * factor)
        return self._cut[identity]


def _canvas_of_view(
    seen: View, identities: NDArray[np.int64], frames: NDArray[np.int64], is_usable: NDArray[np.bool_], rng: Generator
) -> Canvas:
    boxes = np.nan_to_num(seen.boxes)
    is_usable = is_usable & ((boxes[:, 2:] - boxes[:, :2]).min(axis=1, initial=np.inf) >= _LEAST_SIDE_PX)
    return _canvas(seen.canvas, jitter_boxes(boxes, rng), identities, frames, is_usable)


def _canvas(
    pixels: NDArray[np.uint8],
    boxes: NDArray[np.float32],
    identities: NDArray[np.int64],
    frames: NDArray[np.int64],
    is_usable: NDArray[np.bool_],
) -> Canvas:
    return Canvas(pixels, boxes[is_usable], identities[is_usable], frames[is_usable].astype(np.int64))


def _crop(picture: Image.Image, box: NDArray[np.float64]) -> tuple[Image.Image, NDArray[np.float64]]:
    margin = 0.2 * (box[2:] - box[:2])
    outer = np.concatenate([np.floor(box[:2] - margin), np.ceil(box[2:] + margin)])
    outer = np.clip(outer, 0, np.tile(picture.size, 2)).astype(int)
    crop, inner = picture.crop(tuple(outer.tolist())), box - np.tile(outer[:2], 2)
    shrink = int((inner[3] - inner[1]) // _CROP_HEIGHT_PX)
    if shrink > 1:
        small = crop.reduce(shrink)
        inner = inner * np.tile(np.array(small.size) / crop.size, 2)
        crop = small
    return crop, inner


def _open_picture(path: Path, size: tuple[int, int]) -> tuple[Image.Image, NDArray[np.float64]]:
    """The picture upright in RGB, shrunk where it is much larger than the network's input; and (4,) how much."""
    try:
        with Image.open(path) as file:
            upright_size = file.size
            file.draft("RGB", (2 * size[1], 2 * size[0]))
            picture = ImageOps.exif_transpose(file).convert("RGB")
            if file.getexif().get(_ORIENTATION, 1) >= 5:
                upright_size = upright_size[::-1]
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as exc:
        raise FormatError(path, 0, f"not a picture, or damaged ({str(exc).splitlines()[0]:.80}); remove it") from exc
    shrink = int(min(picture.width / size[1], picture.height / size[0]) // 2)
    if shrink > 1:
        picture = picture.reduce(shrink)
    factor = np.array(picture.size) / upright_size
    return picture, np.tile(factor, 2)
