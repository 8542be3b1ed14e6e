"""Folders of pictures, sequences, globs and single pictures."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from PIL import Image

from lookonce.errors import ConfigError, VideoError
from lookonce.video import open_video
from lookonce.video.images import pictures_in
from video.clips import DATA, numbers_in, write_clip, write_pictures


def test_pictures_come_in_natural_order_by_position(tmp_path):
    write_pictures(tmp_path / "shots", ["shot2.png", "shot10.png", "shot1.png"])
    source = open_video(tmp_path / "shots", fps=10)
    frames = list(source)
    assert numbers_in(frames) == [2, 0, 1]
    assert [f.index for f in frames] == [0, 1, 2]
    assert [f.time_s for f in frames] == [0.0, 0.1, 0.2]
    assert (source.name, source.frame_count, source.rate, source.size) == ("shots", 3, 10.0, (48, 64))


@pytest.mark.parametrize(
    ("names", "indices"),
    [
        pytest.param(["000001.jpg", "000002.jpg", "000005.jpg"], [0, 1, 4], id="mot-with-a-gap"),
        pytest.param(["img00003.jpg", "img00004.jpg"], [2, 3], id="ua-detrac"),
        pytest.param(["000000.png", "000001.png", "000003.png"], [0, 1, 3], id="from-zero"),
        pytest.param(["shot_5.jpg", "shot_7.jpg"], [0, 1], id="other-names"),
        pytest.param(["000001.jpg", "000001.png", "000002.jpg"], [0, 1, 2], id="same-number-twice"),
        pytest.param(["1403636579763.png", "1403636579813.png"], [0, 1], id="time-stamps"),
        pytest.param(["000007.png"], [0], id="one"),
    ],
)
def test_numbered_names_keep_their_numbers(tmp_path, names, indices):
    frames = list(open_video(write_pictures(tmp_path / "s", names)))
    assert [f.index for f in frames] == indices
    assert [f.time_s for f in frames] == [i / 25 for i in indices]


def test_sequence_folder_names_its_pictures_and_rate(tmp_path):
    write_pictures(tmp_path / "MOT-01" / "frames", ["000001.jpg", "000002.jpg"])
    (tmp_path / "MOT-01" / "seqinfo.ini").write_text("[Sequence]\nname=MOT-01\nimDir=frames\nframeRate=14\n")
    for folder in (tmp_path / "MOT-01", tmp_path / "MOT-01" / "frames"):
        source = open_video(folder)
        assert (source.rate, source.frame_count) == (14.0, 2)
        assert [f.time_s for f in source] == [0, 1 / 14]
    assert open_video(tmp_path / "MOT-01").name == "MOT-01"
    assert open_video(tmp_path / "MOT-01", fps=7).rate == 7.0


def test_img1_folder_is_named_after_its_sequence(tmp_path):
    write_pictures(tmp_path / "PETS" / "img1", ["000001.jpg"])
    assert open_video(tmp_path / "PETS").name == open_video(tmp_path / "PETS" / "img1").name == "PETS"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(b"frameRate=3", "seqinfo.ini:1: expected [Sequence]", id="no-section"),
        pytest.param(b"[Sequence]\nname\n", "seqinfo.ini: expected [Sequence] and lines of key=value", id="no-value"),
        pytest.param(b"\xff\xfe[\0S\0", "seqinfo.ini:1: expected [Sequence]", id="utf-16"),
        pytest.param(b"[Sequence]\n" + b"#\n" * 500_000, "seqinfo.ini: larger than 1000 kB", id="endless"),
    ],
)
def test_bad_sequence_file_is_named(tmp_path, text, message):
    write_pictures(tmp_path / "s", ["000001.jpg"])
    (tmp_path / "s" / "seqinfo.ini").write_bytes(text)
    with pytest.raises(VideoError) as caught:
        open_video(tmp_path / "s")
    assert message in str(caught.value)
    assert str(caught.value).isprintable()


def test_sequence_file_may_leave_the_folder_open(tmp_path):
    write_pictures(tmp_path / "s" / "img1", ["000001.jpg"])
    (tmp_path / "s" / "seqinfo.ini").write_text("[Sequence]\nimDir=\nframeRate=10\n")
    assert open_video(tmp_path / "s").rate == open_video(tmp_path / "s" / "img1").rate == 10


def test_hidden_files_and_other_files_are_no_pictures(tmp_path):
    write_pictures(tmp_path, ["b.png", ".a.png"])
    (tmp_path / "gt.txt").touch()
    assert [path.name for path in pictures_in(tmp_path)] == ["b.png"]
    assert pictures_in(tmp_path / "none") == []


def test_sequence_cannot_lead_out_of_its_folder(tmp_path):
    write_pictures(tmp_path / "secret", ["000001.jpg"])
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "seqinfo.ini").write_text("[Sequence]\nimDir=../secret\n")
    with pytest.raises(VideoError, match="outside"):
        open_video(tmp_path / "s")


@pytest.mark.parametrize("suffix", ["jpg", "jpeg", "png", "bmp", "webp", "tif", "tiff", "ppm", "JPG"])
def test_single_picture_is_a_source_of_one_frame(tmp_path, suffix):
    write_pictures(tmp_path, [f"a.{suffix}"])
    source = open_video(tmp_path / f"a.{suffix}")
    [frame] = source
    assert (source.name, source.frame_count, frame.index, frame.time_s, frame.size) == ("a", 1, 0, 0.0, (48, 64))
    assert frame.image.mean() == pytest.approx(20, abs=3)


def test_picture_with_the_wrong_suffix_is_read_all_the_same(tmp_path):
    (write_pictures(tmp_path, ["a.png"]) / "a.png").rename(tmp_path / "a.jpg")
    assert len(list(open_video(tmp_path / "a.jpg"))) == 1


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif"])
@pytest.mark.parametrize(("orientation", "turns"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_exif_orientation_is_honoured(tmp_path, orientation, turns, suffix):
    """A TIFF with an orientation, even 1, could not be opened."""
    image = _smooth_noise()
    exif = Image.Exif()
    exif[0x0112] = orientation
    image.save(tmp_path / f"a.{suffix}", exif=exif)
    expected = np.rot90(np.asarray(image), turns)
    [frame] = open_video(tmp_path / f"a.{suffix}")
    assert frame.size == expected.shape[:2]
    assert np.abs(frame.image.astype(int) - expected).mean() < 12  # chroma is scaled up differently


def _smooth_noise():
    return Image.fromarray(np.random.default_rng(3).integers(0, 256, (6, 8, 3), np.uint8)).resize((64, 48))


def _tiff(compression=None, *, mode="RGB", **options):
    """With what cameras and programs add: resolution, author, orientation."""
    exif = Image.Exif()
    exif[315], exif[0x0112] = "somebody", 1
    file = io.BytesIO()
    _smooth_noise().convert(mode).save(file, "TIFF", compression=compression, dpi=(300, 300), exif=exif, **options)
    return file.getvalue()


@pytest.mark.parametrize("compression", ["raw", "packbits", "tiff_lzw", "tiff_adobe_deflate"])
@pytest.mark.parametrize("options", [{}, {"big_endian": True}, {"mode": "L"}, {"mode": "RGBA"}], ids=str)
def test_tiff_with_notes_gives_its_pixels(tmp_path, compression, options):
    """TIFFs that say how many dots an inch has, or what else FFmpeg does not know, could not be opened."""
    (tmp_path / "a.tif").write_bytes(_tiff(compression, **options))
    [frame] = open_video(tmp_path / "a.tif")
    np.testing.assert_array_equal(frame.image, _smooth_noise().convert(options.get("mode", "RGB")).convert("RGB"))


@pytest.mark.parametrize("compression", ["raw", "packbits", "tiff_lzw", "tiff_adobe_deflate"])
def test_cut_tiff_is_refused(tmp_path, compression):
    data = _tiff(compression)
    for length in range(4, len(data) - 8, len(data) // 23):
        (tmp_path / "a.tif").write_bytes(data[:length])
        with pytest.raises(VideoError, match="no picture in it can be decoded"):
            list(open_video(tmp_path / "a.tif"))


@pytest.mark.parametrize("compression", ["raw", "packbits", "tiff_lzw"])
def test_tiff_whose_pixels_end_early_is_refused(tmp_path, compression):
    """FFmpeg gives such a picture, partly empty, unless it is told not to."""
    data = _tiff(compression)
    with Image.open(io.BytesIO(data)) as image:
        (length,) = image.tag_v2[279]
    stated, half = (struct.pack("<HHII", 279, 4, 1, number) for number in (length, length // 2))
    assert data.count(stated) == 1
    (tmp_path / "a.tif").write_bytes(data.replace(stated, half))
    with pytest.raises(VideoError, match="no picture in it can be decoded"):
        list(open_video(tmp_path / "a.tif"))


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(_tiff("jpeg"), id="jpeg"),
        pytest.param(b"II*\0" + struct.pack("<IH", 8, 65535), id="no-directory"),
        pytest.param(b"MM\0*\xff\xff\xff\xff", id="far-directory"),
        pytest.param(b"II*\0", id="nothing"),
    ],
)
def test_tiff_that_ffmpeg_would_guess_is_refused(tmp_path, data):
    (tmp_path / "a.tif").write_bytes(data)
    with pytest.raises(VideoError, match="no picture in it can be decoded"):
        list(open_video(tmp_path / "a.tif"))


@pytest.mark.parametrize("kind", [2, 3])
def test_tiff_of_signed_numbers_or_fractions_is_refused(tmp_path, kind):
    """FFmpeg would take its samples for whole numbers from 0."""
    values = struct.pack("<3H", kind, kind, kind)
    data = _tiff("raw")
    (start,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, start)
    entries = [data[start + 2 + 12 * n : start + 14 + 12 * n] for n in range(count)]
    entries.append(struct.pack("<HHII", 339, 3, 3, len(data)))
    directory = struct.pack("<H", count + 1) + b"".join(entries) + bytes(4)
    data = data[:4] + struct.pack("<I", len(data) + len(values)) + data[8:] + values + directory
    (tmp_path / "a.tif").write_bytes(data)
    with pytest.raises(VideoError, match="no picture in it can be decoded"):
        list(open_video(tmp_path / "a.tif"))
    (tmp_path / "a.tif").write_bytes(data.replace(values + directory, struct.pack("<3H", 1, 1, 1) + directory))
    assert open_video(tmp_path / "a.tif").size == (48, 64)


def test_pictures_of_other_sizes_keep_them(tmp_path):
    write_pictures(tmp_path / "s", ["a.jpg"], (48, 64))
    write_pictures(tmp_path / "s", ["b.jpg"], (30, 20))
    assert [f.size for f in open_video(tmp_path / "s")] == [(48, 64), (30, 20)]


@pytest.mark.parametrize("kind", ["cut", "text", "empty", "directory"])
def test_damaged_picture_is_left_out_and_named(tmp_path, kind):
    folder = write_pictures(tmp_path / "s", [f"{i:06d}.jpg" for i in range(1, 5)])
    victim = folder / "000003.jpg"
    data = victim.read_bytes()
    victim.unlink()
    if kind == "directory":
        victim.mkdir()
    else:
        victim.write_bytes({"cut": data[: len(data) * 2 // 3], "text": b"hello", "empty": b""}[kind])
    source = open_video(folder)
    assert [f.index for f in source] == [0, 1, 3]
    [warning] = source.warnings
    assert "000003.jpg" in warning


def test_folder_of_damaged_pictures_only_is_refused(tmp_path):
    for i in range(30):
        (tmp_path / f"{i}.jpg").write_text("no")
    with pytest.raises(VideoError, match="all 30"):
        open_video(tmp_path)


def test_folder_without_pictures_is_refused(tmp_path):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(VideoError, match="no pictures in this folder"):
        open_video(tmp_path)


def test_selection_works_on_pictures(tmp_path):
    folder = write_pictures(tmp_path / "s", [f"{i:06d}.jpg" for i in range(1, 21)])
    source = open_video(folder, fps=10, start_s=0.5, end_s=1.5, every=2, max_frames=3)
    assert (numbers_in(source), source.frame_count) == ([6, 8, 10], 3)
    with pytest.raises(VideoError, match=r"2\.00 s long"):
        open_video(folder, fps=10, start_s=2)
    for fps in (0, -1, float("nan"), float("inf")):
        with pytest.raises(ConfigError, match="fps"):
            open_video(folder, fps=fps)


def test_globs_open_pictures_or_one_video(tmp_path):
    folder = write_pictures(tmp_path / "frames", ["b10.jpg", "b9.jpg", "c.png"])
    source = open_video(folder / "*.jpg", fps=5)
    assert (numbers_in(source), source.name) == ([1, 0], "frames")
    write_clip(folder / "clip.mp4", 3)
    assert open_video(f"{folder}/*.mp4").name == "clip"
    write_clip(folder / "other.mp4", 3)
    with pytest.raises(ConfigError, match="one at a time"):
        open_video(f"{folder}/*.mp4")
    with pytest.raises(VideoError, match="nothing matches"):
        open_video(f"{folder}/*.avi")


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "count", "size"),
    [("PETS09-S2L1", 795, (576, 768)), ("UA-DETRAC-MVI_20011-9frames", 9, (540, 960))],
)
def test_real_sequence_gives_all_pictures(name, count, size):
    folder = DATA / "sequences" / name
    if not folder.exists():
        pytest.skip(f"needs {folder}")
    source = open_video(folder)
    assert [f.index for f in source] == list(range(count))
    assert (source.name, source.size, source.warnings) == (name, size, [])
