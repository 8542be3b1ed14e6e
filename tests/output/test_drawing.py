import numpy as np
import pytest
from PIL import ImageFont

from lookonce.errors import ConfigError
from lookonce.output import TrackPainter, TrailMemory, draw_tracks
from lookonce.output.colours import track_colour
from output.scenes import grey, make_tracks


def _has_colour(area, identity: int) -> bool:
    return bool((area == np.array(track_colour(identity))).all(axis=-1).any())


def test_border_of_the_box_has_the_colour_of_the_id():
    drawn = draw_tracks(grey(120, 160), make_tracks([5], [[40, 40, 100, 90]]))
    colour = list(track_colour(5))
    assert drawn[60, 40].tolist() == drawn[60, 99].tolist() == drawn[89, 70].tolist() == colour
    assert drawn[60, 70].tolist() == [100] * 3  # the object itself stays visible


def test_the_picture_given_is_not_modified():
    image = grey()
    memory = TrailMemory(1.0)
    memory.update(make_tracks([1], [[5, 5, 20, 20]]), 0.0)
    tracks = make_tracks([1], [[30, 30, 50, 50]])
    drawn = draw_tracks(image, tracks, ["person"], memory.update(tracks, 0.5))
    assert (image == 100).all()
    assert (drawn != 100).any()
    assert drawn.shape == image.shape
    assert drawn.dtype == np.uint8


def test_read_only_and_strided_pictures_can_be_drawn_on():
    image = np.broadcast_to(np.uint8(9), (60, 80, 3))[:, ::-1]
    assert (draw_tracks(image, make_tracks([1], [[5, 5, 40, 40]])) != 9).any()


def test_empty_tracks_leave_the_picture_as_it_is():
    image = grey()
    assert np.array_equal(draw_tracks(image, make_tracks()), image)


def test_same_call_gives_the_same_bytes():
    tracks = make_tracks([3, 1, 2], [[5, 5, 40, 40], [10, 10, 50, 50], [20, 9, 70, 55]])
    painter = TrackPainter(["person"])
    first = painter.draw(grey(), tracks)
    assert np.array_equal(first, painter.draw(grey(), tracks))
    assert np.array_equal(first, draw_tracks(grey(), tracks, ["person"]))


def test_object_without_identity_gets_a_grey_box_only():
    drawn = draw_tracks(grey(), make_tracks([-1], [[20, 20, 60, 50]]), ["person"])
    assert drawn[35, 20].tolist() == [190] * 3
    assert (drawn[:18] == 100).all()  # no label above


@pytest.mark.parametrize(
    "box",
    [
        pytest.param([-50, -50, 30, 30], id="over the top left"),
        pytest.param([60, 40, 200, 200], id="over the bottom right"),
        pytest.param([-1e30, -1e30, 1e30, 1e30], id="over everything"),
        pytest.param([0, 0, 80, 60], id="the whole picture"),
        pytest.param([79, 59, 80, 60], id="the last pixel"),
        pytest.param([10, 10, 11, 11], id="one pixel"),
    ],
)
def test_boxes_at_the_border_are_drawn(box):
    assert (draw_tracks(grey(), make_tracks([1], [box]), ["person"]) != 100).any()


@pytest.mark.parametrize(
    "box",
    [
        pytest.param([-50, -50, -10, -10], id="above left"),
        pytest.param([90, 70, 100, 100], id="below right"),
        pytest.param([20, 20, 20, 40], id="no width"),
        pytest.param([np.nan, 0, 5, 5], id="NaN"),
        pytest.param([0, 0, np.inf, 5], id="infinite"),
    ],
)
def test_boxes_without_a_part_in_the_picture_are_left_out(box):
    assert (draw_tracks(grey(), make_tracks([1], [box]), ["person"]) == 100).all()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("a very long class name that never ends and goes on", id="long"),
        pytest.param("Straßenbahn", id="umlaut"),
        pytest.param("自転車 🚲", id="beyond the font"),
        pytest.param("two\nlines", id="line break"),
        pytest.param("", id="empty"),
    ],
)
@pytest.mark.parametrize(("height", "width"), [(240, 320), (60, 80), (5, 7), (1, 1)])
def test_any_name_is_drawn_at_the_top_right_border(name, height, width):
    box = [0.5 * width - 0.5, 0, width, height]
    drawn = draw_tracks(grey(height, width), make_tracks([12345], [box]), [name])
    assert drawn.shape == (height, width, 3)
    assert (drawn != 100).any()


def test_long_name_is_shortened_so_that_the_id_stays_in_view():
    boxes = [[200, 40, 230, 80]]
    one, other = (draw_tracks(grey(240, 320), make_tracks([identity], boxes), ["x" * 200]) for identity in (1111, 1118))
    assert (one != 100).any(axis=2).sum() < 320 * 40
    shapes = [(picture == picture[30, 210]).all(axis=2) for picture in (one, other)]
    assert not np.array_equal(*shapes)


def test_label_shows_the_score_and_does_without_one_that_is_no_number():
    box = [[40, 40, 60, 60]]
    low, high, none = (
        draw_tracks(grey(120, 160), make_tracks([1], box, [score])) for score in (0.11, 0.99, float("nan"))
    )
    assert not np.array_equal(low, high)
    assert (none != 100).sum() < (low != 100).sum()


@pytest.mark.parametrize(
    ("size", "line_px"),
    [
        pytest.param((240, 320), 1, id="320x240"),
        pytest.param((540, 960), 2, id="960x540"),
        pytest.param((1080, 1920), 3, id="1920x1080"),
        pytest.param((2160, 3840), 6, id="3840x2160"),
    ],
)
def test_lines_grow_with_the_picture(size, line_px):
    drawn = draw_tracks(grey(*size), make_tracks([1], [[100, 100, 200, 200]]))
    row = (drawn[150, :150] == np.array(track_colour(1))).all(axis=1)
    assert row.sum() == line_px


def test_painter_follows_a_change_of_size():
    painter = TrackPainter(["person"])
    tracks = make_tracks([1], [[20, 20, 50, 50]])
    for height, width in ((240, 320), (1080, 1920), (61, 83), (240, 320)):
        drawn = painter.draw(grey(height, width), tracks)
        assert np.array_equal(drawn, draw_tracks(grey(height, width), tracks, ["person"]))


def test_painter_keeps_bounded_memory_with_ever_new_ids():
    painter = TrackPainter(["person"])
    for identity in range(1, 3000):
        painter.draw(grey(), make_tracks([identity], [[20, 20, 50, 50]]))
    assert len(painter._palettes) <= 1024


def test_colour_of_an_id_does_not_depend_on_the_others():
    box, other = [20, 30, 50, 50], [100, 80, 130, 110]
    alone = draw_tracks(grey(120, 160), make_tracks([7], [box]))
    beside = draw_tracks(grey(120, 160), make_tracks([8, 7], [other, box]))
    assert np.array_equal(alone[:60], beside[:60])
    assert _has_colour(beside, 8)


def test_names_beyond_ascii_are_spelled_without_accents():
    tracks = make_tracks([1], [[40, 40, 60, 60]])
    accented, plain = (draw_tracks(grey(120, 160), tracks, [name]) for name in ("vélo", "velo"))
    assert np.array_equal(accented, plain)


def test_font_of_ones_own_keeps_the_accents(tmp_path):
    font = tmp_path / "font.ttf"
    font.write_bytes(ImageFont.load_default(10).path.getvalue())  # Pillow's own, as a file
    tracks = make_tracks([1], [[40, 40, 60, 60]])
    velo, accented = (draw_tracks(grey(120, 160), tracks, [name], font=font) for name in ("velo", "vélo"))
    assert (velo != 100).any()
    assert not np.array_equal(velo, accented)


@pytest.mark.parametrize("content", [pytest.param(None, id="missing"), pytest.param(b"no font", id="damaged")])
def test_font_that_cannot_be_read_is_named(tmp_path, content):
    font = tmp_path / "font.ttf"
    if content:
        font.write_bytes(content)
    with pytest.raises(ConfigError, match=r"font\.ttf: cannot be read as a font"):
        TrackPainter(["person"], font)
