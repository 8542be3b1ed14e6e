"""Batches of training views, made by worker processes; which views these are depends on seed and step alone."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch.utils.data import DataLoader, Dataset

from lookonce.make.detector.samples import Batch, Sample, View, collate
from lookonce.make.detector.settings import DetectorConfig
from lookonce.make.detector.views import Opened, mosaic, single
from lookonce.make.training.pictures import open_picture

__all__ = ["Pictures", "batches", "steps_in_epoch"]

_TIMES_AS_LARGE = 1.0  # pictures are kept so many times as large as they fit the network's input


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
        fit = min(self._size[1] / picture.width, self._size[0] / picture.height) * _TIMES_AS_LARGE
        if fit < 1:
            smaller = max(1, round(picture.width * fit)), max(1, round(picture.height * fit))
            factor = factor * np.tile(np.array(smaller) / picture.size, 2)
            picture = picture.resize(smaller, Image.Resampling.BILINEAR, reducing_gap=2.0)
        pixels = np.asarray(picture)
        if pixels.nbytes <= self._free:
            self._kept[index] = pixels, factor
            self._free -= pixels.nbytes
        return Opened(picture, factor, self._samples[index])


class _Views(Dataset[Batch]):
    """Batch number -> batch."""

    def __init__(
        self, pictures: Pictures, config: DetectorConfig, size: tuple[int, int], rank: int, world: int
    ) -> None:
        self._pictures, self._config, self._size = pictures, config, size
        self._rank, self._world = rank, world

    def __getitem__(self, step: int) -> Batch:
        share = self._config.batch // self._world
        first = step * self._config.batch + self._rank * share
        return collate([self._view(first + number) for number in range(share)])

    def _view(self, number: int) -> View:
        """The ``number``-th view of the whole training: each epoch has every picture once as the first of a view."""
        config, count = self._config, len(self._pictures)
        epoch, place = divmod(number, count)
        order = np.random.default_rng([config.seed, 4, epoch]).permutation(count)
        rng = np.random.default_rng([config.seed, 5, number])
        first = self._pictures[int(order[place])]
        is_plain = epoch >= config.epochs - config.plain_epochs
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
) -> Iterator[Batch]:
    """The batches of some steps, in order.

    Args:
        samples: to learn from.
        config: settings.
        size: (height, width) of the network's input.
        steps: which.
        workers: processes; 0: in this one.
        rank: of this process among ``world`` that train together: each gets its share of every batch.
        world: see rank.
    """
    pictures = Pictures(samples, size, round(config.cache_gb * 1e9 / max(1, workers)))
    loader = DataLoader(
        _Views(pictures, config, size, rank, world),
        batch_size=None,
        sampler=steps,
        num_workers=workers,
        prefetch_factor=4 if workers else None,
        worker_init_fn=_one_thread,
        collate_fn=_as_it_is,
    )
    yield from loader


def _one_thread(_: int) -> None:
    torch.set_num_threads(1)


def _as_it_is(batch: Any) -> Any:
    return batch
