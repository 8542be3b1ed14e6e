"""Pictures of any size inside the detector's input, and the way back."""

from __future__ import annotations

import av
import numpy as np
import pytest

from lookonce.letterbox import PADDING_GREY, Letterboxer, fit, to_rgb

SIZES = [(540, 960), (480, 640), (1080, 1920), (37, 501), (501, 37), (513, 511), (1, 1), (64, 64), (3, 2000), (2, 2)]
NETWORKS = [(512, 512), (320, 576), (576, 320), (64, 96)]


def _smooth(height, width):
    """A picture without sharp edges: every way of scaling gives nearly the same."""
    y, x = np.mgrid[0:height, 0:width] / max(height, width)
    channels = [60 + 120 * x, 200 - 120 * y, 90 + 60 * np.sin(3 * (x + y))]
    return np.stack(channels, axis=2).astype(np.uint8)


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("source", SIZES)
def test_picture_is_as_large_as_possible_and_centred(source, network):
    placed = fit(source, network)
    (height, width), (top, left) = placed.scaled, placed.offset
    assert (placed.source, placed.network) == (source, network)
    assert height == network[0] or width == network[1]
    assert 1 <= height <= network[0]
    assert 1 <= width <= network[1]
    assert 0 <= network[0] - height - 2 * top <= 1
    assert 0 <= network[1] - width - 2 * left <= 1
    scale = min(network[0] / source[0], network[1] / source[1])
    assert abs(height - source[0] * scale) <= 0.5 or height == 1
    assert abs(width - source[1] * scale) <= 0.5 or width == 1


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("source", SIZES)
def test_boxes_come_back_within_a_thousandth_of_a_pixel(source, network):
    placed = fit(source, network)
    corners = np.random.default_rng(0).uniform(-0.2, 1.2, (50, 4)) * np.array([*source[::-1], *source[::-1]])
    scale = np.array(placed.scaled[::-1] * 2) / np.array(source[::-1] * 2)
    inside = (corners * scale + np.array(placed.offset[::-1] * 2)).astype(np.float32)
    before = inside.copy()
    back = placed.to_source(inside)
    assert back.dtype == np.float32
    largest = max(1.0, float((1 / scale).max()))  # shrinking multiplies float32's rounding
    np.testing.assert_allclose(back, corners, atol=1e-3 * largest)
    np.testing.assert_array_equal(inside, before)
    assert placed.to_source(inside[:0]).shape == (0, 4)


def test_corners_of_the_picture_are_the_corners_of_its_place():
    placed = fit((540, 960), (512, 512))
    assert (placed.scaled, placed.offset) == ((288, 512), (112, 0))
    box = np.array([[0, 112, 512, 400]], np.float32)
    np.testing.assert_allclose(placed.to_source(box), [[0, 0, 960, 540]], atol=1e-3)


@pytest.mark.parametrize("source", [(90, 160), (161, 91), (33, 500), (64, 96), (7, 5), (1, 1)])
def test_margin_is_grey_and_the_picture_lies_where_it_is_said_to(source):
    picture = np.full((*source, 3), (250, 10, 40), np.uint8)
    canvas, placed = Letterboxer((64, 96))(picture)
    assert (canvas.shape, canvas.dtype) == ((64, 96, 3), np.uint8)
    assert placed == fit(source, (64, 96))
    (height, width), (top, left) = placed.scaled, placed.offset
    inside = np.zeros((64, 96), bool)
    inside[top : top + height, left : left + width] = True
    assert np.abs(canvas[inside].astype(int) - (250, 10, 40)).max() <= 1
    assert (canvas[~inside] == PADDING_GREY).all()


def test_content_stays_upright_and_in_colour():
    """A red top left, a green top right, a blue bottom left corner, found again at their places."""
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[:60, :80, 0] = picture[:60, 80:, 1] = picture[60:, :80, 2] = 255
    canvas, placed = Letterboxer((64, 64))(picture)
    top, left = placed.offset
    rows, columns = top + np.array([12, 36]), left + np.array([16, 48])
    colours = canvas[np.ix_(rows, columns)].reshape(4, 3).astype(int)
    assert np.abs(colours - [[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 0, 0]]).max() <= 2


@pytest.mark.parametrize("source", [(120, 90), (90, 160), (77, 131), (101, 51)])
@pytest.mark.parametrize("rotation", [1, 2, 3, -1, 5])
def test_rotated_picture_equals_the_picture_turned_before(source, rotation):
    picture = _smooth(*source)
    turned = np.rot90(picture, rotation)
    canvas, placed = Letterboxer((64, 96))(picture, rotation)
    expected, expected_placed = Letterboxer((64, 96))(turned)
    assert placed == expected_placed == fit(turned.shape[:2], (64, 96))
    assert np.abs(canvas.astype(int) - expected).max() <= 3


@pytest.mark.parametrize("source", [(120, 90), (90, 160), (64, 96), (1080, 1920), (76, 130)])
@pytest.mark.parametrize("kind", ["yuv420p", "yuv444p", "nv12", "rgb24", "gray"])
def test_decoders_frame_gives_nearly_what_its_rgb_picture_gives(source, kind):
    """The one goes from YUV straight to the small picture, the other by way of a large RGB one."""
    frame = av.VideoFrame.from_ndarray(_smooth(*source), format="rgb24").reformat(format=kind)
    direct, placed = Letterboxer((64, 96))(frame)
    by_rgb, expected = Letterboxer((64, 96))(to_rgb(frame))
    assert placed == expected
    difference = np.abs(direct.astype(int) - by_rgb)
    assert difference.max() <= 6
    assert difference.mean() < 1.5


def test_letterboxer_serves_pictures_of_changing_sizes():
    letterboxer = Letterboxer((64, 96))
    for source in [(90, 160), (160, 90), (90, 160), (64, 96)]:
        canvas, _ = letterboxer(_smooth(*source))
        np.testing.assert_array_equal(canvas, Letterboxer((64, 96))(_smooth(*source))[0])


def test_argument_is_left_alone_and_need_not_be_contiguous():
    picture = _smooth(90, 160)
    before = picture.copy()
    flipped, _ = Letterboxer((64, 96))(picture[:, ::-1])
    expected, _ = Letterboxer((64, 96))(np.ascontiguousarray(picture[:, ::-1]))
    np.testing.assert_array_equal(flipped, expected)
    np.testing.assert_array_equal(picture, before)


def test_frame_becomes_rgb_upright():
    picture = np.zeros((16, 24, 3), np.uint8)
    picture[:8] = (255, 0, 0)
    frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
    np.testing.assert_array_equal(to_rgb(frame), picture)
    for rotation in (1, 2, 3):
        turned = to_rgb(frame, rotation)
        np.testing.assert_array_equal(turned, np.rot90(picture, rotation))
        assert turned.flags.c_contiguous
