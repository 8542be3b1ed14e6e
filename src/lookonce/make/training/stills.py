"""Stills as a source of identities: each labelled box is its own, seen again in views and collages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from PIL import Image

from lookonce.datasets import LabelledStills
from lookonce.make.training.augment import collage, other_colours, view
from lookonce.make.training.pictures import open_picture
from lookonce.make.training.sources import ALWAYS, Canvas, Task, canvas_of_view

__all__ = ["StillsSource"]

_OBJECTS_A_COLLAGE = 24
_OBJECTS_A_STILL = 16  # more of one picture add little
_MOST_CUT_BYTES = 400_000_000  # of objects kept for collages; others are cut out again each time
_CROP_HEIGHT_PX = 140.0  # of objects that are kept for collages, at least where they are as large
_FEWEST_HELD_OUT = 2  # identities; one alone has no other to be mistaken for


@dataclass(frozen=True, slots=True)
class _Object:
    """A labelled box of a still.

    Attributes:
        picture: number of the still.
        box: xyxy (4,) px of it.
        identity: number of this object.
        original: identity whose picture it shows, in other colours where that is not its own.
    """

    picture: int
    box: NDArray[np.float64]
    identity: int
    original: int


class StillsSource:
    """Stills, each box its own identity: views of whole pictures, and collages of objects of many.

    Args:
        stills: pictures with boxes.
        size: of the network's input (height, width) in px.
        views: of each picture.
        collages: how often each object is put into a collage.
        variants: so many more identities are made of each object by other colours; they appear in collages only.
        held_out: share of the pictures whose objects are kept for validation; of few pictures, share of the objects.
        seed: of all choices.
    """

    def __init__(
        self,
        stills: LabelledStills,
        size: tuple[int, int],
        *,
        views: int,
        collages: int,
        variants: int,
        held_out: float,
        seed: Sequence[int],
    ) -> None:
        self.name, self.kind = stills.name, "stills"
        self._stills, self._size, self._views, self._seed = stills, size, views, tuple(seed)
        rng = np.random.default_rng([*self._seed, 0])
        self._objects: list[_Object] = []
        self._of_picture: list[list[_Object]] = []
        for index, objects in enumerate(stills.objects):
            boxes = _choose(objects.xyxy, rng)
            first = len(self._objects)
            numbered = [_Object(index, box, first + n, first + n) for n, box in enumerate(boxes)]
            self._of_picture.append(numbered)
            self._objects += numbered
        for original in self._objects[:]:
            first = len(self._objects)
            self._objects += [replace(original, identity=first + n) for n in range(variants)]
        self.lifetimes = np.tile(np.array(ALWAYS, np.int64), (len(self._objects), 1))
        self.scenes = np.array([o.picture for o in self._objects], np.int64)
        self._shown = [index for index, objects in enumerate(self._of_picture) if objects]
        self.held_out = self._hold_out(held_out, rng)
        self._collages = [part for number in range(collages) for part in self._shuffled(number)]
        self._cut: dict[int, tuple[Image.Image, NDArray[np.float64]]] = {}
        self._cut_bytes = 0
        self.task_count = len(self._shown) * views + len(self._collages)
        self.row_count = sum(map(len, self._of_picture)) * views + len(self._objects) * collages

    def _hold_out(self, share: float, rng: Generator) -> NDArray[np.bool_]:
        """Which objects are kept for validation: those of whole pictures, or where these are few, any.

        Objects that differ in colours only go together.
        """
        pictures = round(share * len(self._shown))
        if pictures >= _FEWEST_HELD_OUT:
            return np.isin(self.scenes, rng.permutation(self._shown)[:pictures])
        count = sum(len(objects) for objects in self._of_picture)
        held = max(_FEWEST_HELD_OUT, round(share * count)) if count >= 2 * _FEWEST_HELD_OUT else 0
        is_held = rng.permutation(count) < held
        return np.array([is_held[found.original] for found in self._objects], bool)

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
        self._cut.clear()  # the next set of stills needs the room; what is still to be drawn is cut out again
        self._cut_bytes = 0

    def _view(self, index: int, number: int) -> Canvas:
        rng = np.random.default_rng([*self._seed, 2, index, number])
        picture, factor = open_picture(self._stills.pictures[index], self._size)
        objects = self._of_picture[index]
        boxes = np.array([o.box for o in objects]).reshape(-1, 4) * factor
        seen = view(picture, boxes, self._size, rng)
        identities = np.array([o.identity for o in objects], np.int64)
        return canvas_of_view(seen, identities, np.full(len(objects), number), np.ones(len(objects), bool), rng)

    def _collage(self, number: int, part: Sequence[int]) -> Canvas:
        rng = np.random.default_rng([*self._seed, 3, number])
        background, _ = open_picture(self._stills.pictures[rng.integers(len(self._stills.pictures))], self._size)
        seen = collage(background, [self._cut_out(identity) for identity in part], self._size, rng)
        frames = np.full(len(part), self._views + number)
        return canvas_of_view(seen, np.array(part, np.int64), frames, np.ones(len(part), bool), rng)

    def _cut_out(self, identity: int) -> tuple[Image.Image, NDArray[np.float64]]:
        """The object with some surroundings, small enough to be kept, and its box in that."""
        shown = self._objects[identity]
        if shown.original in self._cut:
            crop, box = self._cut[shown.original]
        else:
            picture, factor = open_picture(self._stills.pictures[shown.picture], self._size)
            crop, box = _crop(picture, shown.box * factor)
            if self._cut_bytes < _MOST_CUT_BYTES:
                self._cut[shown.original] = crop, box
                self._cut_bytes += 3 * crop.width * crop.height
        if identity != shown.original:
            crop = other_colours(crop, np.random.default_rng([*self._seed, 4, identity]))
        return crop, box


def _choose(xyxy: NDArray[np.float32], rng: Generator) -> NDArray[np.float64]:
    """At most 16 of a still's boxes (N, 4), in their order."""
    return xyxy[np.sort(rng.permutation(len(xyxy))[:_OBJECTS_A_STILL])].astype(np.float64)


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
