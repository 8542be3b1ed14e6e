"""Sizes from headers and frame numbers from names, both as ``open_video`` has them."""

from __future__ import annotations

import struct
import zlib

import pytest
from PIL import Image

from datasets.making import refusal, write, write_picture
from lookonce import open_video
from lookonce.datasets import picture_size
from lookonce.errors import FormatError


def _with_orientation(path, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    return write_picture(path, exif=exif)


@pytest.mark.parametrize("orientation", [1, 3, 5, 6, 8])
@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif"])
def test_size_is_that_of_the_frame_that_open_video_shows(tmp_path, suffix, orientation):
    path = _with_orientation(tmp_path / f"a.{suffix}", orientation)
    assert picture_size(path) == open_video(path).size == ((64, 48) if orientation > 4 else (48, 64))


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif", "bmp", "ppm"])
def test_size_of_a_picture_without_exif_is_that_of_its_frame(tmp_path, suffix):
    path = write_picture(tmp_path / f"a.{suffix}")
    assert picture_size(path) == open_video(path).size == (48, 64)


def test_damaged_exif_does_not_hide_the_size(tmp_path):
    path = write_picture(tmp_path / "a.jpg", exif=b"Exif\0\0II*\0\xff\xff\xff\xff")
    assert picture_size(path) == (48, 64)


def test_png_header_is_enough(tmp_path):
    path = write_picture(tmp_path / "a.png")
    write(path, path.read_bytes()[:50])
    assert picture_size(path) == (48, 64)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff\xe0", b"text", b"II*\0\x08\0\0\0\0\0", b"\x89PNG\r\n\x1a\n\0"])
def test_damaged_picture_is_named_with_the_remedy(tmp_path, data):
    path = write(tmp_path / "a.jpg", data)
    message = refusal(FormatError, lambda: picture_size(path))
    assert message == f"{path}: not a picture, or damaged; copy it again or remove it"


def test_missing_picture_is_named(tmp_path):
    assert "a.jpg: not a picture, or damaged; check the spelling" in refusal(
        FormatError, lambda: picture_size(tmp_path / "a.jpg")
    )


@pytest.mark.parametrize(("width", "height"), [(12_000, 12_000), (100_000, 100_000)])
def test_picture_made_to_exhaust_the_memory_is_refused(tmp_path, width, height):
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    path = write(tmp_path / "a.png", data + b"\0\0\0\0IDAT\0\0\0\0")
    assert "a.png: more than 134 megapixels; make it smaller" in refusal(FormatError, lambda: picture_size(path))


def test_allowed_size_that_pillow_warns_of_gives_no_warning(tmp_path):
    header = b"IHDR" + struct.pack(">IIBBBBB", 10_000, 10_000, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    assert picture_size(write(tmp_path / "a.png", data + b"\0\0\0\0IDAT\0\0\0\0")) == (10_000, 10_000)
