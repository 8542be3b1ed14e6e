"""Stills as a source: views and collages of objects, held-out ones apart from the others."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from PIL import Image

from datasets.making import refusal
from lookonce.datasets import open_stills
from lookonce.errors import FormatError
from lookonce.make.training.sources import Canvas
from lookonce.make.training.stills import StillsSource
from make.training.scenes import write_stills

CANVAS = (96, 96)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_stills(tmp_path_factory.mktemp("stills") / "set", range(8))


def make_source(folder, **options) -> StillsSource:
    settings = {"views": 2, "collages": 3, "variants": 0, "held_out": 0.25, "seed": [1]}
    return StillsSource(open_stills(folder), CANVAS, **(settings | options))


def as_bytes(canvas: Canvas) -> tuple[bytes, ...]:
    return tuple(a.tobytes() for a in (canvas.pixels, canvas.boxes, canvas.identities, canvas.frames))


def test_each_picture_gives_views_and_each_object_is_in_collages(folder):
    source = make_source(folder)
    canvases = [task() for task in source.tasks()]
    assert len(canvases) == source.task_count
    views, collages = canvases[:16], canvases[16:]
    assert [set(canvas.identities.tolist()) <= set(range(3 * n, 3 * n + 3)) for n, canvas in enumerate(views[::2])]
    assert all(canvas.pixels.shape == (*CANVAS, 3) for canvas in canvases)
    seen = np.concatenate([canvas.identities for canvas in collages])
    assert len(np.unique(seen)) > 20  # some find no place
    assert np.bincount(seen).max() <= 3


def test_no_object_is_in_one_picture_twice_and_no_view_has_the_number_of_another(folder):
    rows = [
        (identity, frame)
        for task in make_source(folder).tasks()
        for canvas in [task()]
        for identity, frame in zip(canvas.identities.tolist(), canvas.frames.tolist(), strict=True)
    ]
    assert len(rows) == len(set(rows))


@pytest.mark.parametrize("variants", [0, 2])
def test_tasks_do_not_depend_on_order_or_thread(folder, variants):
    in_order = [as_bytes(task()) for task in make_source(folder, variants=variants).tasks()]
    again = list(make_source(folder, variants=variants).tasks())
    with ThreadPoolExecutor(4) as pool:
        side_by_side = list(pool.map(lambda task: as_bytes(task()), again[::-1]))[::-1]
    assert side_by_side == in_order
    assert [as_bytes(task()) for task in make_source(folder, variants=variants, seed=[2]).tasks()] != in_order


@pytest.mark.parametrize("variants", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_held_out_objects_never_share_a_collage_with_others(folder, variants, seed):
    source = make_source(folder, variants=variants, seed=[seed])
    collages = [task() for task in list(source.tasks())[16:]]
    for canvas in collages:
        assert len(set(source.held_out[canvas.identities].tolist())) <= 1
    assert {bool(source.held_out[canvas.identities[0]]) for canvas in collages if len(canvas.identities)} == {
        True,
        False,
    }


@pytest.mark.parametrize("pictures", [2, 8, 30])
@pytest.mark.parametrize("seed", range(3))
def test_some_objects_are_held_out_and_more_are_not(tmp_path, pictures, seed):
    """With few pictures chance alone could hold out none of them, or all."""
    held = make_source(write_stills(tmp_path / "few", range(pictures)), held_out=0.1, seed=[seed]).held_out
    assert 2 <= held.sum() <= len(held) * 2 / 3
    assert held.sum() <= max(2, 0.2 * len(held))


def test_objects_of_one_picture_and_colour_variants_are_held_out_together(folder):
    source = make_source(folder, variants=2)
    assert len(source.held_out) == 24 * 3
    for picture in range(8):
        assert len(set(source.held_out[source.scenes == picture].tolist())) == 1


def test_variants_of_few_objects_are_held_out_together(tmp_path):
    source = make_source(write_stills(tmp_path / "two", (0, 3)), variants=1)
    assert source.held_out[:6].tolist() == source.held_out[6:].tolist()
    assert source.held_out.sum() == 4


def test_objects_of_stills_live_for_ever_and_pictures_are_scenes(folder):
    source = make_source(folder)
    assert source.scenes.tolist() == [n // 3 for n in range(24)]
    assert source.lifetimes.shape == (24, 2)
    assert (source.lifetimes == source.lifetimes[0]).all()


def test_at_most_sixteen_objects_of_a_picture_are_taken(tmp_path):
    folder = write_stills(tmp_path / "crowd", (0,))
    lines = [f"0 {0.03 + 0.03 * n} 0.5 0.02 0.1\n" for n in range(30)]
    (folder / "labels" / "0.txt").write_text("".join(lines))
    assert len(make_source(folder).held_out) == 16


def test_stills_without_objects_have_no_tasks(tmp_path):
    source = make_source(write_stills(tmp_path / "bare", labels=False))
    assert source.task_count == 0
    assert list(source.tasks()) == []
    assert source.held_out.shape == (0,)
    assert source.lifetimes.shape == (0, 2)


def test_stills_much_larger_than_the_network_keep_their_objects(tmp_path):
    """Boxes of a picture that was shrunk on opening are shrunk with it: what they show is the square's colour."""
    folder = write_stills(tmp_path / "large", (0, 3, 5, 6))
    for path in (folder / "images").iterdir():
        with Image.open(path) as small:
            large = small.resize((1600, 1600), Image.Resampling.NEAREST)
        large.save(path)
    source = make_source(folder, collages=2)
    has_colour = []
    for task in source.tasks():
        canvas = task()
        for box in canvas.boxes.round().astype(int):
            left, top, right, bottom = np.clip(box, 0, 96)
            middle = canvas.pixels[(top + bottom) // 2, (left + right) // 2].astype(int)
            has_colour.append(middle.max() - middle.min() > 60)
    assert len(has_colour) > 15
    assert np.mean(has_colour) > 0.9


def test_damaged_stills_are_one_line(tmp_path):
    folder = write_stills(tmp_path / "bad")
    source = make_source(folder)
    path = folder / "images" / "3.png"
    path.write_bytes(path.read_bytes()[:90])
    message = refusal(FormatError, lambda: [task() for task in source.tasks()])
    assert "3.png" in message


def test_cut_out_objects_do_not_stay_when_a_set_is_done(folder):
    """Four sets of stills kept what each had cut out: 1.6 GB until the end of the training."""
    source = make_source(folder)
    tasks = source.tasks()
    for _ in range(source.task_count):
        next(tasks)()
    assert source._cut
    assert next(tasks, None) is None
    assert not source._cut
    assert source._cut_bytes == 0
