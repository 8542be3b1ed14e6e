import inspect
import os
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from PIL import Image

from lookonce.errors import OutputError
from lookonce.evaluation import PairDistances
from lookonce.make.probing import Neighbourhood, ShownObject, draw_distances, draw_neighbours

SAME, OTHER, QUERY = (0, 158, 115), (213, 94, 0), (235, 235, 235)


def _shown(height=60, width=30, is_same=True, colour=(10, 20, 200)):
    return ShownObject(np.full((height, width, 3), colour, np.uint8), 12, 3.5, 0.25, is_same)


def _row(*same):
    return Neighbourhood(_shown(), tuple(_shown(is_same=is_same) for is_same in same))


def _pairs(genuine=(0, 5, 3, 1, 0, 0, 0, 0), impostor=(0, 0, 0, 2, 4, 9, 3, 0), share=1.0):
    return PairDistances(np.array(genuine, np.int64), np.array(impostor, np.int64), 4, 1, 30, share)


def _pixels(path):
    with Image.open(path) as picture:
        assert picture.format == "PNG"
        return np.asarray(picture.convert("RGB"))


def _count(pixels, colour):
    return int((pixels == colour).all(axis=2).sum())


DRAWINGS = [
    pytest.param(lambda path: draw_neighbours(path, [_row(True, False)]), id="neighbours"),
    pytest.param(lambda path: draw_distances(path, _pairs(), 0.8), id="distances"),
]


@pytest.mark.parametrize("draw", DRAWINGS)
def test_same_content_gives_the_same_bytes(draw, tmp_path):
    draw(tmp_path / "new" / "a.png")
    draw(tmp_path / "b.png")
    assert (tmp_path / "new" / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize("draw", DRAWINGS)
def test_no_version_is_written_into_the_file(draw, tmp_path):
    draw(tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as picture:
        assert not {"Software", "Date", "Creation Time"} & picture.info.keys()


@pytest.mark.parametrize("draw", DRAWINGS)
def test_an_earlier_file_is_replaced_and_nothing_else_left(draw, tmp_path):
    (tmp_path / "a.png").write_text("earlier")
    draw(tmp_path / "a.png")
    _pixels(tmp_path / "a.png")
    assert os.listdir(tmp_path) == ["a.png"]


@pytest.mark.parametrize("draw", DRAWINGS)
def test_a_picture_that_cannot_be_written_is_one_line(draw, tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(OutputError, match=r"taken: cannot write the picture \(.+\); choose another place") as caught:
        draw(tmp_path / "taken")
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == ["taken"]
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write the picture"):
        draw(tmp_path / "file" / "a.png")


def test_frames_tell_the_query_from_right_and_wrong_neighbours(tmp_path):
    draw_neighbours(tmp_path / "a.png", [_row(True, False)])
    draw_neighbours(tmp_path / "b.png", [_row(True, True, True)])
    some, all_right = _pixels(tmp_path / "a.png"), _pixels(tmp_path / "b.png")
    frame = _count(some, QUERY)
    assert frame > 1500
    assert _count(some, SAME) == pytest.approx(_count(some, OTHER), rel=0.1)
    assert _count(some, SAME) > frame  # the legend has a mark of each
    assert _count(all_right, OTHER) < 400
    assert _count(all_right, SAME) > 3 * frame


def test_rows_stand_below_each_other_in_the_order_given(tmp_path):
    rows = [
        Neighbourhood(_shown(colour=(200, 0, 200)), (_shown(is_same=True),)),
        Neighbourhood(_shown(colour=(0, 60, 255)), (_shown(is_same=False),)),
    ]
    draw_neighbours(tmp_path / "a.png", rows)
    draw_neighbours(tmp_path / "b.png", rows[:1])
    both, first = _pixels(tmp_path / "a.png"), _pixels(tmp_path / "b.png")
    assert both.shape[1] == first.shape[1]
    first_rows = first[: first.shape[0] - 20]
    np.testing.assert_array_equal(both[: len(first_rows)], first_rows)
    assert _count(both[first.shape[0] :], (0, 60, 255)) > 1000
    assert _count(both, (200, 0, 200)) > 1000


@pytest.mark.parametrize(
    ("height", "width"),
    [
        pytest.param(1, 1, id="one-pixel"),
        pytest.param(1, 400, id="a-line"),
        pytest.param(500, 1, id="a-column"),
        pytest.param(720, 1280, id="a-whole-picture"),
    ],
)
def test_crops_of_any_size_fill_the_cell_in_one_direction(height, width, tmp_path):
    shown = _shown(height, width)
    draw_neighbours(tmp_path / "a.png", [Neighbourhood(shown, (shown,))])
    painted = (_pixels(tmp_path / "a.png") == (10, 20, 200)).all(axis=2)
    extent = painted.any(axis=0).sum() / 2, painted.any(axis=1).sum()  # two crops side by side
    assert max(extent) >= 92
    assert max(extent) <= 152


def test_rows_may_have_different_numbers_of_neighbours(tmp_path):
    draw_neighbours(tmp_path / "a.png", [_row(), _row(True, True, False)])
    draw_neighbours(tmp_path / "b.png", [_row(True, True, False), _row()])
    assert _pixels(tmp_path / "a.png").shape == _pixels(tmp_path / "b.png").shape


def test_an_empty_sheet_says_so(tmp_path):
    draw_neighbours(tmp_path / "a.png", [])
    assert _count(_pixels(tmp_path / "a.png"), (240, 240, 240)) > 50


def test_a_crop_is_not_modified(tmp_path):
    crop = np.full((20, 10, 3), 9, np.uint8)
    crop.setflags(write=False)
    shown = ShownObject(crop[:, ::-1], 1, 0.0)
    draw_neighbours(tmp_path / "a.png", [Neighbourhood(shown, ())])
    assert (crop == 9).all()


@pytest.mark.parametrize(
    "crop",
    [
        pytest.param(np.zeros((0, 5, 3), np.uint8), id="empty"),
        pytest.param(np.zeros((5, 5), np.uint8), id="grey"),
        pytest.param(np.zeros((5, 5, 4), np.uint8), id="alpha"),
        pytest.param(np.zeros((5, 5, 3)), id="float"),
    ],
)
def test_a_crop_that_is_no_picture_is_refused(crop):
    with pytest.raises(ValueError, match="crop: expected"):
        ShownObject(crop, 1, 0.0)


def test_threshold_and_distances_change_the_picture(tmp_path):
    pictures = []
    for number, (pairs, threshold) in enumerate(
        [
            (_pairs(), 0.8),
            (_pairs(), 1.4),
            (_pairs(), float("nan")),
            (_pairs(share=0.5), 0.8),
            (_pairs(genuine=(8, 0, 0, 0, 0, 0, 0, 0)), 0.8),
        ]
    ):
        draw_distances(tmp_path / f"{number}.png", pairs, threshold)
        pictures.append((tmp_path / f"{number}.png").read_bytes())
        assert _pixels(tmp_path / f"{number}.png").shape == (540, 1200, 3)
    assert len(set(pictures)) == len(pictures)


@pytest.mark.parametrize(
    ("genuine", "impostor"),
    [
        pytest.param((0, 0), (0, 0), id="none"),
        pytest.param((0, 0), (1, 2), id="no-genuine"),
        pytest.param((3, 0), (0, 0), id="no-impostor"),
        pytest.param((3,), (1,), id="one-bin"),
    ],
)
def test_missing_pairs_are_drawn_as_nothing(genuine, impostor, tmp_path):
    draw_distances(tmp_path / "a.png", _pairs(genuine, impostor), 0.5)
    assert _pixels(tmp_path / "a.png").shape == (540, 1200, 3)


def test_drawing_leaves_no_global_state(tmp_path):
    before = dict(matplotlib.rcParams)
    draw_distances(tmp_path / "a.png", _pairs(), 0.5)
    assert dict(matplotlib.rcParams) == before
    assert "pyplot" not in Path(inspect.getfile(draw_distances)).read_text(encoding="utf-8")


def _lobes(spike):
    counts = np.zeros(128, np.int64)
    counts[30:60] = 100
    counts[90] = spike
    return _pairs(counts, np.roll(counts, 5))


def test_a_bar_that_dwarfs_the_rest_is_cut_off_so_that_the_rest_can_be_seen(tmp_path):
    """All distances between different grids of native descriptors were one bar, ten times as high as all others."""
    painted = []
    for spike in (100, 1000, 100_000):
        draw_distances(tmp_path / "a.png", _lobes(spike), 0.5)
        red, _, blue = np.moveaxis(_pixels(tmp_path / "a.png").astype(int)[:, 265:285], 2, 0)
        painted.append((blue - red > 20).any(axis=1).sum())  # height of the lobe, where only one kind is
    assert painted[1] > 0.5 * painted[0]  # cut off
    assert painted[2] < 0.1 * painted[0]  # nearly all pairs are in it: shown whole
