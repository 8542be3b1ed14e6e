"""Pictures opened for training: upright, bounded in size, boxes scaled with them."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from datasets.making import refusal
from lookonce.datasets import picture_size
from lookonce.errors import FormatError
from lookonce.make.training.pictures import open_picture

SIZE = (64, 96)
_ORIENTATION = 0x0112


def quarters(width: int, height: int) -> Image.Image:
    """Red in the left upper quarter, black elsewhere."""
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[: height // 2, : width // 2] = (255, 0, 0)
    return Image.fromarray(pixels)


def save(picture: Image.Image, path, orientation: int = 1):
    exif = Image.Exif()
    exif[_ORIENTATION] = orientation
    picture.save(path, exif=exif)
    return path


def red_box(picture: Image.Image) -> list[int]:
    rows, columns = np.nonzero(np.asarray(picture)[..., 0] > 127)
    return [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "webp"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_boxes_in_px_of_the_upright_file_fit_whatever_its_orientation(tmp_path, suffix, orientation):
    path = save(quarters(640, 320), tmp_path / f"a.{suffix}", orientation)
    upright = Image.fromarray(np.asarray(Image.open(save(quarters(640, 320), tmp_path / "b.png"))))
    turned = {
        2: Image.Transpose.FLIP_LEFT_RIGHT,
        3: Image.Transpose.ROTATE_180,
        4: Image.Transpose.FLIP_TOP_BOTTOM,
        5: Image.Transpose.TRANSPOSE,
        6: Image.Transpose.ROTATE_270,
        7: Image.Transpose.TRANSVERSE,
        8: Image.Transpose.ROTATE_90,
    }
    if orientation > 1:
        upright = upright.transpose(turned[orientation])
    assert picture_size(path) == upright.size[::-1]
    picture, factor = open_picture(path, SIZE)
    assert picture.mode == "RGB"
    assert np.abs(np.multiply(red_box(upright), factor) - red_box(picture)).max() <= 2


@pytest.mark.parametrize("width", [4000, 4001, 3999])
def test_large_pictures_are_shrunk_but_never_below_the_network(tmp_path, width):
    path = save(quarters(width, 3000), tmp_path / "large.jpg")
    picture, factor = open_picture(path, SIZE)
    assert SIZE[1] <= picture.width <= 6 * SIZE[1]
    assert picture.height >= SIZE[0]
    assert factor == pytest.approx(np.tile([picture.width / width, picture.height / 3000], 2))


def test_small_pictures_stay_as_they_are(tmp_path):
    picture, factor = open_picture(save(quarters(7, 5), tmp_path / "small.png"), SIZE)
    assert picture.size == (7, 5)
    assert factor.tolist() == [1, 1, 1, 1]


@pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
def test_pictures_of_a_hundred_megapixels_are_read(tmp_path):
    Image.new("1", (10_000, 10_000)).save(tmp_path / "huge.png")
    picture, factor = open_picture(tmp_path / "huge.png", SIZE)
    assert picture.width <= 4 * SIZE[1]
    assert factor[0] == pytest.approx(picture.width / 10_000)


def test_pictures_made_to_exhaust_the_memory_are_refused(tmp_path):
    Image.new("1", (20_000, 20_000)).save(tmp_path / "bomb.png")
    message = refusal(FormatError, lambda: open_picture(tmp_path / "bomb.png", SIZE))
    assert "bomb.png" in message


@pytest.mark.parametrize("mode", ["L", "P", "RGBA", "CMYK", "1", "LA"])
def test_every_mode_becomes_rgb(tmp_path, mode):
    suffix = "tif" if mode == "CMYK" else "png"
    quarters(40, 30).convert(mode).save(tmp_path / f"a.{suffix}")
    assert open_picture(tmp_path / f"a.{suffix}", SIZE)[0].mode == "RGB"


def damage(kind: str, path):
    if kind == "cut short":
        save(quarters(400, 300), path)
        path.write_bytes(path.read_bytes()[:1000])
    elif kind == "text":
        path.write_text("not a picture")
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "folder":
        path.mkdir()
    elif kind == "postscript":  # Pillow would start Ghostscript for it
        path.write_text("%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\nshowpage\n")
    return path


@pytest.mark.parametrize("kind", ["missing", "cut short", "text", "empty", "folder", "postscript"])
def test_what_is_no_picture_is_refused_in_one_line(tmp_path, kind):
    path = damage(kind, tmp_path / "bad.jpg")
    message = refusal(FormatError, lambda: open_picture(path, SIZE))
    assert "bad.jpg" in message
    assert "remove it" in message


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_damaged_pictures_never_raise_anything_else(tmp_path):
    """Any byte may be wrong: either it is a picture still, or the refusal is one line."""
    rng = np.random.default_rng(5)
    refusals = []
    for suffix in ("jpg", "png", "tif", "webp", "bmp"):
        whole = save(quarters(60, 40), tmp_path / f"whole.{suffix}", 6) if suffix != "bmp" else tmp_path / "whole.bmp"
        if suffix == "bmp":
            quarters(60, 40).save(whole)
        content = bytearray(whole.read_bytes())
        for number in range(60):
            changed = content.copy()
            for place in rng.integers(0, min(len(changed), 600), 4):
                changed[place] = rng.integers(256)
            path = tmp_path / f"{number}.{suffix}"
            path.write_bytes(changed)
            try:
                picture, factor = open_picture(path, SIZE)
            except FormatError as error:
                refusals.append(str(error))
            else:
                assert picture.mode == "RGB"
                assert (factor > 0).all()
    assert len(refusals) > 20
    assert all(message.isprintable() for message in refusals)
