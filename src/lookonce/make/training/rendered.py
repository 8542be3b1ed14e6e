"""Rendered crowds as a source of identities: look-alikes who walk, turn and hide each other, with exact truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.random import Generator
from PIL import Image

from lookonce.make.descriptors.anchors import PEOPLE_CLASSES
from lookonce.make.training.augment import View, maybe_jpeg
from lookonce.make.training.pictures import open_picture
from lookonce.make.training.sources import ALWAYS, Canvas, Task, canvas_of_view
from lookonce.synthetic.crowd import MEMBERS, Crowd

__all__ = ["CrowdSource", "knows_people"]

_FRAMES = 6  # of each crowd
_PATCHES = 6  # rows and columns of the colours that stand behind a crowd where there are no pictures


def knows_people(classes: Sequence[str]) -> bool:
    """Whether crowds of people teach something to a detector of these classes."""
    return any(name.lower() in PEOPLE_CLASSES for name in classes)


class CrowdSource:
    """Crowds, each a scene of its own, six frames of each.

    Args:
        size: of the network's input (height, width) in px.
        crowds: how many.
        backdrops: pictures to stand before; none: before patches of colour.
        seed: of all choices.
    """

    def __init__(
        self,
        size: tuple[int, int],
        *,
        crowds: int,
        backdrops: Sequence[Path],
        seed: Sequence[int],
    ) -> None:
        self.name = self.kind = "rendered people"
        self._size, self._crowds = size, crowds
        self._backdrops, self._seed = backdrops, tuple(seed)
        self.scenes = np.repeat(np.arange(crowds, dtype=np.int64), MEMBERS)
        self.lifetimes = np.tile(np.array(ALWAYS, np.int64), (len(self.scenes), 1))
        self.held_out = np.zeros(len(self.scenes), np.bool_)  # real objects judge
        self.task_count = crowds * _FRAMES
        self.row_count = len(self.scenes) * _FRAMES
        self._gather = lru_cache(maxsize=4)(self._gather_anew)  # a crowd's frames are drawn one after the other

    def tasks(self) -> Iterator[Task]:
        """Frame by frame, crowd by crowd.

        Raises:
            FormatError: a picture is damaged.
        """
        for crowd in range(self._crowds):
            yield from (partial(self._frame, crowd, frame) for frame in range(_FRAMES))

    def _frame(self, crowd: int, frame: int) -> Canvas:
        rng = np.random.default_rng([*self._seed, crowd, 1 + frame])
        seen = self._gather(crowd).picture(rng)
        view = View(maybe_jpeg(seen.image, rng), seen.xyxy, seen.visible)
        identities = crowd * MEMBERS + np.arange(MEMBERS, dtype=np.int64)
        return canvas_of_view(view, identities, np.full(MEMBERS, frame), np.ones(MEMBERS, bool), rng)

    def _gather_anew(self, crowd: int) -> Crowd:
        rng = np.random.default_rng([*self._seed, crowd, 0])
        return Crowd.gather(self._size, self._backdrop(rng), rng)

    def _backdrop(self, rng: Generator) -> Image.Image:
        if self._backdrops:
            return open_picture(self._backdrops[int(rng.integers(len(self._backdrops)))], self._size)[0]
        patches = Image.fromarray(rng.integers(20, 230, (_PATCHES, _PATCHES, 3), np.uint8))
        return patches.resize(self._size[::-1], Image.Resampling.BICUBIC)
