"""Rendered crowds as a source of identities."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from PIL import Image

from datasets.making import refusal
from lookonce.errors import FormatError
from lookonce.make.training.rendered import CrowdSource, knows_people
from lookonce.synthetic.crowd import MEMBERS

CANVAS = (128, 160)


def make_source(backdrops=(), **options) -> CrowdSource:
    return CrowdSource(CANVAS, **({"crowds": 3, "backdrops": backdrops, "seed": [1]} | options))


def as_bytes(task) -> bytes:
    canvas = task()
    return b"".join(a.tobytes() for a in (canvas.pixels, canvas.boxes, canvas.identities, canvas.frames))


@pytest.mark.parametrize(
    ("classes", "expected"),
    [
        (("person", "bicycle", "car"), True),
        (("Pedestrian",), True),
        (("van", "boat"), False),
    ],
)
def test_a_detector_that_knows_people_gets_crowds(classes, expected):
    assert knows_people(classes) == expected


def test_each_crowd_has_identities_of_its_own_seen_in_several_frames():
    source = make_source()
    canvases = [task() for task in source.tasks()]
    assert len(canvases) == source.task_count == 18
    assert source.row_count == 18 * MEMBERS
    for number, canvas in enumerate(canvases):
        assert canvas.pixels.shape == (*CANVAS, 3)
        assert canvas.boxes.dtype == np.float32
        assert set(canvas.identities.tolist()) <= set(range(number // 6 * MEMBERS, (number // 6 + 1) * MEMBERS))
        assert (canvas.frames == number % 6).all()
    seen = np.bincount(np.concatenate([canvas.identities for canvas in canvases]), minlength=3 * MEMBERS)
    assert (seen > 1).sum() > 50
    assert source.scenes.tolist() == [0] * MEMBERS + [1] * MEMBERS + [2] * MEMBERS
    assert not source.held_out.any()


def test_tasks_do_not_depend_on_order_or_thread():
    in_order = [as_bytes(task) for task in make_source().tasks()]
    tasks = list(make_source().tasks())
    assert [as_bytes(task) for task in reversed(tasks)][::-1] == in_order
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(as_bytes, make_source().tasks())) == in_order
    assert [as_bytes(task) for task in make_source(seed=[2]).tasks()] != in_order


def test_crowds_stand_before_the_given_pictures(tmp_path):
    Image.new("RGB", (80, 60), (250, 10, 10)).save(tmp_path / "red.png")
    red = next(iter(make_source([tmp_path / "red.png"]).tasks()))().pixels.astype(int)
    assert (red[..., 0] > red[..., 1] + 60).mean() > 0.5
    patches = next(iter(make_source().tasks()))().pixels.astype(int)
    assert (patches[..., 0] > patches[..., 1] + 60).mean() < 0.5


def test_a_damaged_picture_is_named(tmp_path):
    (tmp_path / "damaged.png").write_bytes(b"no picture")
    message = refusal(FormatError, next(iter(make_source([tmp_path / "damaged.png"]).tasks())))
    assert "damaged.png" in message
