"""Views of pictures: what is known moves with the pixels."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from lookonce.make.detector import views
from lookonce.make.detector.samples import View, collate
from lookonce.make.detector.views import mosaic, single
from make.detector.rectangles import make_sample, opened

SIZE = (96, 128)  # of the canvas
PAPER = (60, 60, 60)
INKS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]


@pytest.fixture
def _true_colours(monkeypatch):
    """No recolouring, blur, noise or JPEG, so that a rectangle can be found by its colour."""
    monkeypatch.setattr(views, "_colour_matrix", lambda rng: np.eye(3, 4))

    finish = views._finish

    class Never:
        """Whatever happens now and then does not."""

        def random(self):
            return 1.0

    def without_noise(canvas, placed, split, labelled, rng):
        return finish(canvas, placed, split, labelled, Never())

    monkeypatch.setattr(views, "_finish", without_noise)


def paint(path, box, ink, size=(80, 100)) -> None:
    image = np.full((*size, 3), PAPER, np.uint8)
    x1, y1, x2, y2 = box
    image[y1:y2, x1:x2] = ink
    Image.fromarray(image).save(path)


def extent(canvas: np.ndarray, ink) -> list[float] | None:
    """The corners of where that colour is; None where it is nowhere."""
    near = np.abs(canvas.astype(int) - ink).max(axis=2) < 100
    if not near.any():
        return None
    rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    return [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]


def assert_known(view: View, ink, label: int) -> bool:
    """The colour is where an object (or an ignored region) is; whether it is taught."""
    seen, boxes = extent(view.canvas, ink), view.xyxy[view.labels == label]
    assert len(boxes) <= 1
    if seen is None:
        assert not len(boxes) or (boxes[:, 2:] - boxes[:, :2]).min() < 3
        return False
    near = np.abs(np.concatenate([boxes, view.ignored]) - seen).max(axis=1)
    assert near.min() <= 2, (seen, boxes, view.ignored)
    return bool(len(boxes))


@pytest.mark.usefixtures("_true_colours")
@pytest.mark.parametrize("size", [(80, 100), (500, 300), (60, 400)], ids=["usual", "large", "wide"])
def test_boxes_follow_the_pixels(tmp_path, size):
    height, width = size
    box = [width // 5, height // 4, width // 2, height // 2]
    paint(tmp_path / "a.png", box, INKS[0], size)
    sample, taught = make_sample(tmp_path / "a.png", [box]), 0
    for seed in range(60):
        view = single(opened(sample, SIZE), SIZE, np.random.default_rng(seed), least_side_px=0)
        assert view.canvas.shape == (*SIZE, 3)
        assert view.canvas.dtype == np.uint8
        taught += assert_known(view, INKS[0], 0)
    assert taught > 30


@pytest.mark.usefixtures("_true_colours")
def test_boxes_follow_the_pixels_in_mosaics(tmp_path):
    samples = []
    for number, ink in enumerate(INKS):
        box = [20 + 5 * number, 15, 60, 40 + 5 * number]
        paint(tmp_path / f"{number}.png", box, ink)
        samples.append(make_sample(tmp_path / f"{number}.png", [box], [number], labelled=[True] * 4))
    taught = np.zeros(4, int)
    for seed in range(40):
        view = mosaic([opened(s, SIZE) for s in samples], SIZE, np.random.default_rng(seed), least_side_px=0)
        for number, ink in enumerate(INKS):
            taught[number] += assert_known(view, ink, number)
        quarters = view.split[0] * np.array([0, 1, 0, 1]), view.split[1] * np.array([0, 0, 1, 1])
        for box, label in zip(view.xyxy, view.labels, strict=True):
            left, top = quarters[0][label], quarters[1][label]
            right = view.split[0] if label % 2 == 0 else SIZE[1]
            bottom = view.split[1] if label < 2 else SIZE[0]
            assert left <= box[0] < box[2] <= right
            assert top <= box[1] < box[3] <= bottom
    assert (taught > 20).all()


@pytest.mark.usefixtures("_true_colours")
def test_half_of_the_views_are_mirrored(tmp_path):
    image = np.full((80, 100, 3), PAPER, np.uint8)
    image[20:60, 20:50], image[20:60, 50:80] = INKS[0], INKS[2]
    Image.fromarray(image).save(tmp_path / "a.png")
    sample, mirrored = make_sample(tmp_path / "a.png", [[20, 20, 50, 60], [50, 20, 80, 60]], [0, 1]), []
    for seed in range(80):
        view = single(opened(sample, SIZE), SIZE, np.random.default_rng(seed), least_side_px=0)
        if len(view.xyxy) == 2:
            red, blue = (view.xyxy[view.labels == n][0] for n in (0, 1))
            assert extent(view.canvas, INKS[0])[0] == pytest.approx(red[0], abs=2)
            mirrored.append(red[0] > blue[0])
    assert 0.3 < np.mean(mirrored) < 0.7


@pytest.mark.usefixtures("_true_colours")
def test_what_the_border_cuts_is_ignored_when_little_is_left(tmp_path):
    """Below a fifth; what is cut more lightly is taught as far as it is seen."""
    box = [10, 10, 90, 70]
    paint(tmp_path / "a.png", box, INKS[0])
    sample = make_sample(tmp_path / "a.png", [box] * 2 + [[40, 30, 44, 34]], [0, 1, 2], labelled=[True] * 3)
    for seed in range(60):
        view = single(opened(sample, SIZE), SIZE, np.random.default_rng(seed), least_side_px=6)
        known = len(view.xyxy) + len(view.ignored)
        assert known <= 3
        assert ((view.xyxy[:, 2:] - view.xyxy[:, :2]) >= 6).all()
        assert (view.xyxy >= 0).all()
        assert (view.xyxy <= [SIZE[1], SIZE[0]] * 2).all()
        assert (view.labels == 0).sum() == (view.labels == 1).sum()


def test_a_share_of_an_object_is_measured_against_the_whole():
    boxes, matrix = np.array([[0.0, 0, 10, 10], [-8, 0, 2, 10], [-9, 0, 1, 10], [-20, 0, -10, 10]]), np.eye(2)
    cut, share = views._moved(boxes, matrix, np.zeros(2), np.array([0.0, 0, 64, 64]))
    assert share.tolist() == pytest.approx([1, 0.2, 0.1, 0])
    assert cut[1].tolist() == [0, 0, 2, 10]


def placed(monkeypatch, sample, size, part, *, least_side_px=0.0):
    """A sample at its own size in the left top corner of a part of the canvas, unmirrored."""

    class Still:
        """Draws the least of each range, and no accident happens."""

        def uniform(self, low, high, count=None):
            return np.full(count or (), low, float)

        def normal(self, *_):
            return 0.0

        def random(self):
            return 0.9

    monkeypatch.setattr(views, "_drawn", lambda picture, matrix, shift, size, rng: Image.new("RGB", size))
    canvas = Image.new("RGB", size[::-1])
    return views._place_(canvas, opened(sample, size), part, (1.0, 1.0), 1.0, Still(), least_side_px)


def test_small_and_cut_objects_are_ignored_and_ignored_regions_move_along(tmp_path, monkeypatch):
    paint(tmp_path / "a.png", [0, 0, 1, 1], INKS[0], (64, 64))
    boxes = [[4, 4, 20, 20], [4, 30, 6, 40], [30, 4, 40, 20], [35, 40, 64, 50], [50, 50, 60, 60]]
    sample = make_sample(tmp_path / "a.png", boxes, [0, 1, 0, 1, 0], ignored=[[10, 10, 50, 20], [45, 45, 50, 50]])
    found = placed(monkeypatch, sample, (64, 64), (24, 0, 64, 64), least_side_px=4)
    assert found.xyxy.tolist() == [[28, 4, 44, 20], [54, 4, 64, 20]]
    assert found.labels.tolist() == [0, 0]
    # the second is too small, of the fourth a sixth is seen, the fifth is not there, nor the second region
    assert found.ignored.tolist() == [[34, 10, 64, 20], [28, 30, 30, 40], [59, 40, 64, 50]]


def test_quarters_know_what_their_pictures_label(tmp_path):
    samples = []
    for number in range(4):
        paint(tmp_path / f"{number}.png", [0, 0, 9, 9], INKS[number])
        samples.append(make_sample(tmp_path / f"{number}.png", labelled=[number % 2 == 0, number > 1]))
    view = mosaic([opened(s, SIZE) for s in samples], SIZE, np.random.default_rng(0), least_side_px=4)
    assert view.labelled.tolist() == [[True, False], [False, False], [True, True], [False, True]]
    assert (view.split > [0.25 * SIZE[1], 0.25 * SIZE[0]]).all()
    assert (view.split < [0.75 * SIZE[1], 0.75 * SIZE[0]]).all()
    one = single(opened(samples[0], SIZE), SIZE, np.random.default_rng(0), least_side_px=4)
    assert one.labelled.tolist() == [[True, False]] * 4
    assert len(one.xyxy) == len(one.labels) == len(one.ignored) == 0


def same(a: View, b: View) -> bool:
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in View.__slots__)


def test_the_same_numbers_give_the_same_view(tmp_path):
    paint(tmp_path / "a.png", [20, 20, 60, 60], INKS[1])
    sample = opened(make_sample(tmp_path / "a.png", [[20, 20, 60, 60]]), SIZE)
    for make in (single, lambda one, *rest, **more: mosaic([one] * 4, *rest, **more)):
        first, again, other = (make(sample, SIZE, np.random.default_rng(n), least_side_px=4) for n in (1, 1, 2))
        assert same(first, again)
        assert not same(first, other)


def test_light_changes_but_stays_near_what_it_was(tmp_path):
    paint(tmp_path / "a.png", [20, 20, 60, 60], INKS[1])
    sample = opened(make_sample(tmp_path / "a.png"), SIZE)
    means = [
        single(sample, SIZE, np.random.default_rng(seed), least_side_px=4).canvas.mean(axis=(0, 1))
        for seed in range(40)
    ]
    assert np.std(means, axis=0).min() > 5
    assert 40 < np.mean(means) < 160


@pytest.mark.parametrize(
    "size", [(1, 1), (1, 300), (300, 1), (3, 5), (3000, 2000)], ids=lambda size: f"{size[0]}x{size[1]}"
)
def test_pictures_of_any_size_can_be_seen(tmp_path, size):
    height, width = size
    Image.new("RGB", (width, height), INKS[0]).save(tmp_path / "a.png")
    sample = opened(make_sample(tmp_path / "a.png", [[0, 0, width, height]]), SIZE)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        for view in (
            single(sample, SIZE, rng, least_side_px=4),
            mosaic([sample] * 4, SIZE, rng, least_side_px=4),
        ):
            assert view.canvas.shape == (*SIZE, 3)
            assert np.isfinite(view.xyxy).all()
            assert (view.xyxy[:, 2:] > view.xyxy[:, :2]).all()


def test_a_batch_knows_which_view_each_box_is_in(tmp_path):
    paint(tmp_path / "a.png", [0, 0, 9, 9], INKS[0])
    made = []
    for number, count in enumerate((2, 0, 1)):
        boxes = np.full((count, 4), number, np.float32)
        labels, ignored = np.full(count, number, np.int64), np.full((2 - count, 4), number, np.float32)
        canvas, split = np.full((8, 8, 3), number, np.uint8), np.full(2, number, np.float32)
        made.append(View(canvas, boxes, labels, ignored, split, np.full((4, 2), number > 0)))
    batch = collate(made)
    assert batch.image.tolist() == [0, 0, 2]
    assert batch.xyxy[:, 0].tolist() == batch.labels.tolist() == [0, 0, 2]
    assert batch.ignored_image.tolist() == batch.ignored[:, 0].tolist() == [1, 1, 2]
    assert batch.canvases[:, 0, 0, 0].tolist() == batch.split[:, 0].tolist() == [0, 1, 2]
    assert batch.labelled.shape == (3, 4, 2)
    assert batch.image.dtype == batch.ignored_image.dtype == np.int64
