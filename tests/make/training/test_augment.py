"""Views and collages: the boxes follow the pixels, whatever the pictures' sizes."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from lookonce.make.training.augment import View, collage, jitter_boxes, other_colours, view

SEEDS = range(40)
CANVASES = [
    pytest.param((320, 320), id="square"),
    pytest.param((240, 400), id="wide"),
    pytest.param((400, 240), id="high"),
]


def picture_with(box: tuple[int, int, int, int], size: tuple[int, int] = (120, 160), grey: int = 60) -> Image.Image:
    """A grey picture (height, width) with a magenta rectangle."""
    pixels = np.full((*size, 3), grey, np.uint8)
    left, top, right, bottom = box
    pixels[top:bottom, left:right] = (255, 0, 255)
    return Image.fromarray(pixels)


def as_boxes(*boxes: tuple[float, ...]) -> np.ndarray:
    return np.array(boxes, np.float64).reshape(-1, 4)


def magenta(canvas: np.ndarray) -> np.ndarray:
    """Where the rectangle is, as a mask: red and blue far above green."""
    red, green, blue = canvas.astype(int).transpose(2, 0, 1)
    return np.minimum(red, blue) - green > 40


def overlap(mask: np.ndarray, box: np.ndarray) -> float:
    """Intersection over union of a mask and a box."""
    inside = np.zeros_like(mask)
    left, top, right, bottom = np.round(box).astype(int)
    inside[top:bottom, left:right] = True
    return float((mask & inside).sum() / (mask | inside).sum())


def uncovered(seen: View) -> bool:
    """Whether no other part of the canvas was put over the rectangle."""
    left, top, right, bottom = np.round(seen.boxes[0]).astype(int)
    return bool(magenta(seen.canvas)[top:bottom, left:right].mean() > 0.93)


@pytest.mark.parametrize("canvas", CANVASES)
@pytest.mark.parametrize(
    "enlarged", [pytest.param(1, id="as large"), pytest.param(4, id="larger"), pytest.param(0.4, id="smaller")]
)
def test_boxes_of_views_follow_the_pixels(canvas, enlarged):
    box = tuple(round(n * enlarged) for n in (40, 30, 110, 90))
    picture = picture_with(box, (round(120 * enlarged), round(160 * enlarged)))
    checked = 0
    for seed in SEEDS:
        seen = view(picture, as_boxes(box), canvas, np.random.default_rng(seed))
        assert seen.canvas.shape == (*canvas, 3)
        assert seen.canvas.dtype == np.uint8
        if seen.visible[0] > 0.9 and uncovered(seen):
            assert overlap(magenta(seen.canvas), seen.boxes[0]) > 0.8, seed
            checked += 1
    assert checked >= len(SEEDS) // 3


@pytest.mark.parametrize("canvas", CANVASES)
@pytest.mark.parametrize(
    "enlarged", [pytest.param(1, id="as large"), pytest.param(4, id="larger"), pytest.param(0.4, id="smaller")]
)
def test_boxes_of_collages_follow_the_pixels(canvas, enlarged):
    """The mask is soft and rounds the corners off; so what is looked at is where the middle of the magenta is."""
    box = tuple(round(n * enlarged) for n in (40, 30, 110, 90))
    picture = picture_with(box, (round(120 * enlarged), round(160 * enlarged)))
    background = picture_with((0, 0, 0, 0), (50, 70))
    placed = 0
    for seed in SEEDS:
        seen = collage(background, [(picture, np.array(box, float))], canvas, np.random.default_rng(seed))
        assert seen.canvas.shape == (*canvas, 3)
        if np.isnan(seen.boxes[0, 0]):
            assert seen.visible[0] == 0
            continue
        assert seen.visible[0] == 1
        rows, columns = np.nonzero(magenta(seen.canvas))
        extent = seen.boxes[0, 2:] - seen.boxes[0, :2]
        middle = (seen.boxes[0, :2] + seen.boxes[0, 2:]) / 2
        assert (np.abs([columns.mean() + 0.5, rows.mean() + 0.5] - middle) < 0.1 * extent + 1).all(), seed
        assert overlap(magenta(seen.canvas), seen.boxes[0]) > 0.7, seed
        placed += 1
    assert placed > len(SEEDS) // 2


def test_boxes_stay_inside_the_canvas():
    boxes = as_boxes((0, 0, 30, 40), (130, 90, 160, 120), (60, 50, 70, 60))
    for seed in SEEDS:
        seen = view(picture_with((0, 0, 30, 40)), boxes, (64, 96), np.random.default_rng(seed))
        assert (seen.boxes >= 0).all()
        assert (seen.boxes <= [96, 64, 96, 64]).all()
        assert ((seen.visible >= 0) & (seen.visible <= 1 + 1e-9)).all()


def test_visible_share_is_what_lies_inside_the_canvas():
    """The picture's left half and the whole of it are two boxes: what can be seen of them adds up."""
    whole, left, right = (0, 0, 160, 120), (0, 0, 80, 120), (80, 0, 160, 120)
    cut = 0
    for seed in SEEDS:
        seen = view(picture_with((0, 0, 0, 0)), as_boxes(whole, left, right), (64, 64), np.random.default_rng(seed))
        areas = (seen.boxes[:, 2:] - seen.boxes[:, :2]).prod(axis=1)
        full = areas / np.maximum(seen.visible, 1e-9)
        if seen.visible[1] > 0 and seen.visible[2] > 0:
            assert full[1] == pytest.approx(full[0] / 2, rel=1e-6)
            assert full[2] == pytest.approx(full[0] / 2, rel=1e-6)
            cut += bool(0.3 < seen.visible[1] < 0.7)
    assert cut  # some box was about half outside


@pytest.mark.parametrize("make", ["view", "collage"])
def test_the_same_seed_gives_the_same_bytes(make):
    box = (50, 40, 90, 75)
    picture = picture_with(box)

    def render(seed: int) -> View:
        rng = np.random.default_rng(seed)
        if make == "view":
            return view(picture, as_boxes(box), (64, 96), rng)
        return collage(picture, [(picture, np.array(box, float))] * 3, (64, 96), rng)

    first, second, other = render(7), render(7), render(8)
    assert first.canvas.tobytes() == second.canvas.tobytes()
    assert first.boxes.tobytes() == second.boxes.tobytes()
    assert first.visible.tobytes() == second.visible.tobytes()
    assert first.canvas.tobytes() != other.canvas.tobytes()


def test_arguments_are_left_as_they_are():
    box = (50, 40, 90, 75)
    picture, boxes = picture_with(box), as_boxes(box)
    before = picture.tobytes()
    view(picture, boxes, (64, 96), np.random.default_rng(1))
    collage(picture, [(picture, boxes[0])], (64, 96), np.random.default_rng(1))
    other_colours(picture, np.random.default_rng(1))
    jitter_boxes(boxes, np.random.default_rng(1))
    assert picture.tobytes() == before
    assert boxes.tolist() == [list(map(float, box))]


def test_crowded_collages_leave_objects_out_and_tell_what_is_covered():
    box = (50, 40, 90, 75)
    objects = [(picture_with(box), np.array(box, float))] * 40
    seen = collage(picture_with((0, 0, 0, 0)), objects, (96, 96), np.random.default_rng(3))
    has_place = ~np.isnan(seen.boxes[:, 0])
    assert 0 < has_place.sum() < 40
    assert (seen.visible[~has_place] == 0).all()
    assert (seen.visible[has_place] <= 1).all()
    assert (seen.visible[has_place] < 1).any()
    assert seen.visible[np.flatnonzero(has_place)[-1]] == 1  # the last one covers, and nothing covers it


def test_objects_larger_than_the_canvas_have_no_place():
    picture = picture_with((0, 0, 400, 400), (400, 400))
    seen = collage(picture, [(picture, np.array([0.0, 0, 400, 400]))], (16, 16), np.random.default_rng(0))
    assert np.isnan(seen.boxes).all()
    assert seen.visible.tolist() == [0]


@pytest.mark.parametrize(
    "box",
    [
        pytest.param((0, 60, 160, 60.0001), id="flat"),
        pytest.param((80, 0, 80.0001, 120), id="narrow"),
        pytest.param((80, 60, 80.0001, 60.0001), id="a point"),
    ],
)
def test_boxes_without_extent_take_no_memory(box):
    """A flat box was enlarged until it was 10 px high, its width with it: millions of columns."""
    picture = picture_with((0, 0, 0, 0))
    for seed in range(5):
        seen = collage(picture, [(picture, np.array(box, float))], (64, 96), np.random.default_rng(seed))
        assert seen.canvas.shape == (64, 96, 3)
        seen = view(picture, as_boxes(box), (64, 96), np.random.default_rng(seed))
        assert np.isfinite(seen.boxes).all()


def test_pictures_and_boxes_of_one_pixel_are_fine():
    dot = Image.new("RGB", (1, 1), (255, 0, 255))
    line = Image.new("RGB", (300, 1), (255, 0, 255))
    for seed in SEEDS:
        for picture in (dot, line):
            rng = np.random.default_rng(seed)
            seen = view(picture, as_boxes((0, 0, 1, 1)), (64, 96), rng)
            assert np.isfinite(seen.boxes).all()
            seen = collage(picture, [(picture, np.array([0.0, 0, 1, 1]))], (64, 96), rng)
            assert seen.canvas.shape == (64, 96, 3)
            assert other_colours(picture, rng).size == picture.size


def test_no_objects_are_fine():
    picture = picture_with((0, 0, 0, 0))
    for seen in (
        view(picture, as_boxes(), (64, 96), np.random.default_rng(0)),
        collage(picture, [], (64, 96), np.random.default_rng(0)),
    ):
        assert seen.boxes.shape == (0, 4)
        assert seen.visible.shape == (0,)


def test_jitter_is_small_and_keeps_boxes_boxes():
    boxes = np.tile(as_boxes((100, 100, 140, 180)), (500, 1))
    jittered = jitter_boxes(boxes, np.random.default_rng(0))
    assert jittered.dtype == np.float32
    assert (jittered[:, 2:] > jittered[:, :2]).all()
    assert np.abs(jittered.mean(axis=0) - boxes[0]).max() < 2
    assert 0.5 < (jittered[:, 0] - 100).std() < 8
    assert jitter_boxes(as_boxes(), np.random.default_rng(0)).shape == (0, 4)


def test_other_colours_keep_the_shape():
    picture = picture_with((50, 40, 90, 75))
    changed = other_colours(picture, np.random.default_rng(4))
    assert changed.size == picture.size
    assert changed.mode == "RGB"
    assert changed.tobytes() != picture.tobytes()
