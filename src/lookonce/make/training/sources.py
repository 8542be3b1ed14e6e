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
from PIL import Image

from lookonce.datasets import LabelledObjects, LabelledSequence
from lookonce.errors import VideoError
from lookonce.letterbox import Letterboxer
from lookonce.make.training.augment import View, jitter_boxes, view
from lookonce.make.training.linking import Links
from lookonce.video import Frame, open_video
from lookonce.video.opening import one_line

__all__ = [
    "ALWAYS",
    "Canvas",
    "SequenceSource",
    "Source",
    "Task",
    "TrackedBoxes",
    "canvas_of_view",
    "coexist",
]

ALWAYS = (0, 2**31 - 1)
"""The lifetime of an object that is surely another than all others."""

_LEAST_SIDE_PX = 6.0  # of a box on the canvas: below, the finest map has a cell or two of it
_LEAST_VISIBLE = 0.6


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
        kind: ``sequences``, ``clips``, ``stills`` or ``rendered people``; a kind's part of the
            batches does not depend on how many sources it has.
        task_count: how many tasks there are.
        row_count: about how many objects they show in all.
        lifetimes: by identity the first and last frame in which it exists, see ``coexist``.
        scenes: by identity the scene it belongs to, numbered from 0: identities of one scene were seen side by side.
        held_out: identities kept for validation.
    """

    @property
    def name(self) -> str:
        """For messages."""
        ...

    @property
    def kind(self) -> str:
        """``sequences``, ``clips``, ``stills`` or ``rendered people``."""
        ...

    @property
    def task_count(self) -> int:
        """How many tasks there are."""
        ...

    @property
    def row_count(self) -> int:
        """About how many objects the tasks show in all."""
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


def coexist(a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether lifetimes (..., 2), first and last frame, overlap: then two identities are surely two objects.

    Tracks made by linking may be pieces of one object; two that were alive at once are not.
    """
    overlap: NDArray[np.bool_] = np.minimum(a[..., 1], b[..., 1]) >= np.maximum(a[..., 0], b[..., 0])
    return overlap


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
        """The truth of a labelled sequence, without boxes that show more of other objects than of their own."""
        seen = [(frame.index, frame.objects[frame.objects.visibility >= _LEAST_VISIBLE]) for frame in sequence.frames]
        objects = [objects for _, objects in seen] or [LabelledObjects.empty()]
        identities = np.concatenate([of_frame.identities for of_frame in objects])
        return cls(
            sequence.name,
            sequence.pictures,
            sequence.fps,
            np.concatenate([np.full(len(of_frame), index, np.int64) for index, of_frame in seen] or [identities]),
            np.concatenate([of_frame.xyxy for of_frame in objects]),
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

    def lifetimes(self) -> NDArray[np.int64]:
        """By identity, (identities, 2), see ``coexist``: whole ones of true tracks, of linked ones their spans."""
        spans = self.spans()
        return np.full_like(spans, ALWAYS) if self.is_complete else spans

    def spans(self) -> NDArray[np.int64]:
        """By identity the first and last frame with a box of it, (identities, 2)."""
        spans = np.tile(np.array([ALWAYS[1], 0], np.int64), (int(self.identities.max(initial=-1)) + 1, 1))
        np.minimum.at(spans[:, 0], self.identities, self.frames)
        np.maximum.at(spans[:, 1], self.identities, self.frames)
        return spans


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
        self.name, self.kind = tracked.name, "sequences" if tracked.is_complete else "clips"
        self.held_out = held_out
        self._tracked, self._size, self._seed = tracked, size, tuple(seed)
        present = np.unique(tracked.frames)
        even = np.linspace(0, len(present) - 1, min(frames, len(present))).round().astype(int)
        self._chosen = present[np.unique(even)]
        self.task_count = 2 * len(self._chosen)
        self.row_count = 2 * int(np.isin(tracked.frames, self._chosen).sum())
        self.scenes = np.zeros(len(held_out), np.int64)
        self.lifetimes = tracked.lifetimes()

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
                f"{one_line(self._tracked.pictures)}: has no frame {min(wanted)} (counted from 0), for which "
                f"{one_line(self.name)} has boxes ({len(wanted)} such frames); give the pictures that belong to them"
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
        is_wanted = ~self.held_out[identities]
        return canvas_of_view(seen, identities, np.full(len(identities), frame.index), is_wanted, rng)


def canvas_of_view(
    seen: View, identities: NDArray[np.int64], frames: NDArray[np.int64], is_wanted: NDArray[np.bool_], rng: Generator
) -> Canvas:
    """A view with those objects that are wanted, large enough and visible; boxes shifted as a detector's are."""
    boxes = np.nan_to_num(seen.boxes)
    is_large = (boxes[:, 2:] - boxes[:, :2]).min(axis=1, initial=np.inf) >= _LEAST_SIDE_PX
    is_usable = is_wanted & is_large & (seen.visible >= _LEAST_VISIBLE)
    return _canvas(seen.canvas, jitter_boxes(boxes, rng), identities, frames, is_usable)


def _canvas(
    pixels: NDArray[np.uint8],
    boxes: NDArray[np.float32],
    identities: NDArray[np.int64],
    frames: NDArray[np.int64],
    is_usable: NDArray[np.bool_],
) -> Canvas:
    return Canvas(pixels, boxes[is_usable], identities[is_usable], frames[is_usable].astype(np.int64))
