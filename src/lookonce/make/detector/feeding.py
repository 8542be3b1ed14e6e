"""Batches of training views, made by worker processes; which views these are depends on seed and step alone."""

from __future__ import annotations

import warnings
from collections.abc import Generator, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch.utils.data import DataLoader, Dataset

from lookonce.errors import LookonceError
from lookonce.make.detector.samples import Batch, Sample, View, collate
from lookonce.make.detector.settings import DetectorConfig
from lookonce.make.detector.views import Opened, mosaic, single
from lookonce.make.training.pictures import open_picture

__all__ = ["Pictures", "batches", "steps_in_epoch"]


class Pictures:
    """The decoded pictures of all samples, kept in memory as far as there is room.

    They are shrunk to fit the network's input: views enlarge them by little.
    """

    def __init__(self, samples: Sequence[Sample], size: tuple[int, int], limit_bytes: int) -> None:
        self._samples, self._size, self._free = samples, size, limit_bytes
        self._kept: dict[int, tuple[NDArray[np.uint8], NDArray[np.float64]]] = {}

    def __len__(self) -> int:
        return len(self._samples)

    def __getitem__(self, index: int) -> Opened:
        """One picture, decoded."""
        if index in self._kept:
            pixels, factor = self._kept[index]
            return Opened(Image.fromarray(pixels), factor, self._samples[index])
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"PIL\.")  # of pictures that are large, and of damaged EXIF
            picture, factor = open_picture(self._samples[index].picture, self._size)
        fit = min(self._size[1] / picture.width, self._size[0] / picture.height)
        if fit < 1:
            smaller = max(1, round(picture.width * fit)), max(1, round(picture.height * fit))
            factor = factor * np.tile(np.array(smaller) / picture.size, 2)
            picture = picture.resize(smaller, Image.Resampling.BILINEAR, reducing_gap=2.0)
        pixels = np.asarray(picture)
        if pixels.nbytes <= self._free:
            self._kept[index] = pixels, factor
            self._free -= pixels.nbytes
        return Opened(picture, factor, self._samples[index])


class _Views(Dataset[Batch | int]):
    """Batch number -> batch, or the number again where a picture is damaged."""

    def __init__(
        self, pictures: Pictures, config: DetectorConfig, size: tuple[int, int], rank: int, world: int
    ) -> None:
        self._pictures, self._config, self._size = pictures, config, size
        self._rank, self._world = rank, world

    def __getitem__(self, step: int) -> Batch | int:
        try:
            return self.make(step)
        except LookonceError:  # raised in a worker process, it would arrive as another error
            return step

    def make(self, step: int) -> Batch:
        """The batch of that number."""
        config = self._config
        share = config.batch // self._world
        first = step * config.batch + self._rank * share
        is_plain = step // steps_in_epoch(len(self._pictures), config) >= config.epochs - config.plain_epochs
        return collate([self._view(first + number, is_plain=is_plain) for number in range(share)])

    def _view(self, number: int, *, is_plain: bool) -> View:
        """The ``number``-th view of the whole training: each pass has every picture once as the first of a view."""
        config, count = self._config, len(self._pictures)
        turn, place = divmod(number, count)
        order = np.random.default_rng([config.seed, 4, turn]).permutation(count)
        rng = np.random.default_rng([config.seed, 5, number])
        first = self._pictures[int(order[place])]
        if is_plain or rng.random() >= config.mosaic:
            return single(first, self._size, rng, least_side_px=config.least_side_px)
        others = [self._pictures[int(n)] for n in rng.integers(count, size=3)]
        four = [first, *others]
        shuffled = [four[int(n)] for n in rng.permutation(4)]
        return mosaic(shuffled, self._size, rng, least_side_px=config.least_side_px)


def steps_in_epoch(samples: int, config: DetectorConfig) -> int:
    """Steps until every picture was seen once, at least one."""
    return max(1, samples // config.batch)


def batches(
    samples: Sequence[Sample],
    config: DetectorConfig,
    size: tuple[int, int],
    steps: range,
    *,
    workers: int,
    rank: int = 0,
    world: int = 1,
) -> Generator[Batch]:
    """The batches of some steps, in order; to be closed, which ends the processes.

    Args:
        samples: to learn from.
        config: settings.
        size: (height, width) of the network's input.
        steps: which.
        workers: processes; 0: in this one.
        rank: of this process among ``world`` that train together: each gets its share of every batch.
        world: see rank.

    Raises:
        FormatError: a picture is damaged.
    """
    pictures = Pictures(samples, size, round(config.cache_gb * 1e9 / max(1, workers)))
    views = _Views(pictures, config, size, rank, world)
    loader = DataLoader(
        views,
        batch_size=None,
        sampler=steps,
        num_workers=workers,
        prefetch_factor=4 if workers else None,
        worker_init_fn=_one_thread,
        collate_fn=_as_it_is,
    )
    for made in loader:
        yield views.make(made) if isinstance(made, int) else made


def _one_thread(_: int) -> None:
    torch.set_num_threads(1)


def _as_it_is(batch: Any) -> Any:
    return batch
