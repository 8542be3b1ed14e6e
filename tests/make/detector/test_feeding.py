"""Batches depend on seed and step alone: not on worker processes, not on where a run went on, not on the devices."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from datasets.making import refusal
from lookonce.errors import FormatError
from lookonce.make.detector import feeding
from lookonce.make.detector.feeding import Pictures, batches, steps_in_epoch
from lookonce.make.detector.samples import Batch, View
from make.detector.rectangles import CONFIG, SIZE, make_sample

CANVAS = (SIZE, SIZE)
COUNT = 10


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    folder, rng, made = tmp_path_factory.mktemp("pictures"), np.random.default_rng(0), []
    for number in range(COUNT):
        Image.fromarray(rng.integers(0, 256, (70, 90, 3), np.uint8)).save(folder / f"{number}.png")
        made.append(make_sample(folder / f"{number}.png", [[5, 5, 40, 30 + number]], [number % 2]))
    return made


def same(a: Batch, b: Batch) -> bool:
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in Batch.__slots__)


@pytest.fixture
def views(monkeypatch) -> list[tuple[str, list[str]]]:
    """The pictures of each view that is made, the first of all that were opened first."""
    made: list[tuple[str, list[str]]] = []
    opened: list[str] = []
    get = Pictures.__getitem__

    def remember(self, index):
        opened.append(self._samples[index].picture.stem)
        return get(self, index)

    def view(kind, count):
        def make(pictures, size, rng, *, least_side_px):
            made.append((kind, opened[-count:]))
            empty = np.zeros((0, 4), np.float32)
            labels, split = np.zeros(0, np.int64), np.zeros(2, np.float32)
            return View(np.zeros((1, 1, 3), np.uint8), empty, labels, empty, split, np.ones((4, 2), bool))

        return make

    monkeypatch.setattr(Pictures, "__getitem__", remember)
    monkeypatch.setattr(feeding, "single", view("single", 1))
    monkeypatch.setattr(feeding, "mosaic", view("mosaic", 4))
    return made


@pytest.mark.parametrize("batch", [2, 4, 7, 16])
def test_each_pass_has_every_picture_once_as_the_first_of_a_view(samples, views, batch):
    config = replace(CONFIG, batch=batch, mosaic=0.5, epochs=1000, plain_epochs=0)
    list(batches(samples, config, CANVAS, range(60 // batch + 1), workers=0))
    firsts = [pictures[0] for _, pictures in views]
    passes = [firsts[start : start + COUNT] for start in range(0, 50, COUNT)]
    assert all(Counter(one) == Counter(str(n) for n in range(COUNT)) for one in passes)
    assert len(set(map(tuple, passes))) == len(passes)
    assert {kind for kind, _ in views} == {"single", "mosaic"}


@pytest.mark.parametrize("batch", [3, 4, 10, 16], ids=lambda n: f"batch {n}")
def test_the_last_epochs_are_plain(samples, views, batch):
    """They were counted in passes over the pictures: where the batch does not divide their number, none came."""
    config = replace(CONFIG, batch=batch, mosaic=1, epochs=8, plain_epochs=2)
    epoch = steps_in_epoch(COUNT, config)
    list(batches(samples, config, CANVAS, range(8 * epoch), workers=0))
    kinds = [kind for kind, _ in views]
    assert kinds == ["mosaic"] * (6 * epoch * batch) + ["single"] * (2 * epoch * batch)


def test_the_share_of_mosaics_is_as_asked_for(samples, views):
    list(batches(samples, replace(CONFIG, mosaic=0.7, epochs=1000), CANVAS, range(100), workers=0))
    assert Counter(kind for kind, _ in views)["mosaic"] == pytest.approx(280, abs=40)


def test_steps_in_an_epoch():
    assert [steps_in_epoch(count, CONFIG) for count in (1, 3, 4, 7, 8, 40)] == [1, 1, 1, 1, 2, 10]


def test_batches_are_the_same_in_worker_processes_and_from_a_later_step(samples):
    here = list(batches(samples, CONFIG, CANVAS, range(6), workers=0))
    there = list(batches(samples, CONFIG, CANVAS, range(6), workers=2))
    later = list(batches(samples, CONFIG, CANVAS, range(4, 6), workers=0))
    without_memory = list(batches(samples, replace(CONFIG, cache_gb=0), CANVAS, range(6), workers=0))
    assert len(here) == len(there) == 6
    assert all(map(same, here, there))
    assert all(map(same, here[4:], later))
    assert all(map(same, here, without_memory))
    assert not same(here[0], here[1])
    (other,) = batches(samples, replace(CONFIG, seed=1), CANVAS, range(1), workers=0)
    assert not same(here[0], other)


def test_ranks_share_a_batch(samples):
    whole = list(batches(samples, CONFIG, CANVAS, range(3), workers=0))
    parts = [list(batches(samples, CONFIG, CANVAS, range(3), workers=0, rank=rank, world=2)) for rank in range(2)]
    for one, first, second in zip(whole, *parts, strict=True):
        assert np.concatenate([first.canvases, second.canvases]).tobytes() == one.canvases.tobytes()
        assert np.concatenate([first.xyxy, second.xyxy]).tobytes() == one.xyxy.tobytes()
        assert np.concatenate([first.image, second.image + 2]).tolist() == one.image.tolist()


def test_no_steps_give_no_batches(samples):
    assert list(batches(samples, CONFIG, CANVAS, range(5, 0), workers=0)) == []


@pytest.mark.parametrize("workers", [0, 1])
def test_a_damaged_picture_is_named_wherever_it_is_opened(samples, tmp_path, workers):
    """Raised in a worker process, the error arrived as another one, and training ended in a traceback."""
    path = tmp_path / "damaged.png"
    path.write_bytes(samples[0].picture.read_bytes()[:200])
    bad = [*samples[:3], make_sample(path)]
    message = refusal(FormatError, lambda: list(batches(bad, CONFIG, CANVAS, range(3), workers=workers)))
    assert message.startswith(f"{path}: not a picture, or damaged")


def test_pictures_are_kept_as_far_as_there_is_room(samples, monkeypatch):
    opened = []
    monkeypatch.setattr(
        feeding, "open_picture", lambda path, size, real=feeding.open_picture: opened.append(path) or real(path, size)
    )
    one = 50 * SIZE * 3  # bytes, shrunk to fit
    pictures = Pictures(samples, CANVAS, 3 * one + 10)
    first = [np.asarray(pictures[n].picture).tobytes() for n in range(5)]
    again = [np.asarray(pictures[n].picture).tobytes() for n in range(5)]
    assert first == again
    assert [path.stem for path in opened] == ["0", "1", "2", "3", "4", "3", "4"]
    assert pictures[0].picture.size == (64, 50)
    assert pictures[0].factor.tolist() == pytest.approx([64 / 90, 50 / 70] * 2)
