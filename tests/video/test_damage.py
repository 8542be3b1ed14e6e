"""Files that are cut short or damaged inside."""

from __future__ import annotations

import hashlib
import logging
import os

import av
import numpy as np
import pytest

from lookonce.errors import VideoError
from lookonce.video import open_video
from video.clips import DATA, cut, write_clip

FRAGMENTS = {"movflags": "frag_keyframe+empty_moov+default_base_moof"}


def noise_clip(path, count=20, codec="libx264", **settings):
    """Frames that compress badly, so that every part of the file is picture data."""
    rng = np.random.default_rng(5)
    images = [rng.integers(0, 256, (48, 64, 3), np.uint8) for _ in range(count)]
    return write_clip(path, images=images, codec=codec, **settings)


def contents(source):
    return [(f.index, f.time_s, hashlib.sha256(f.image.tobytes()).hexdigest()) for f in source]


CUTS = [
    pytest.param("avi", "mpeg4", {}, id="avi"),
    pytest.param("mkv", "libx264", {"b_frames": 2}, id="mkv"),
    pytest.param("mp4", "libx264", {"options": {"movflags": "faststart"}, "b_frames": 2}, id="mp4-index-first"),
    pytest.param("mp4", "libx264", {"options": FRAGMENTS}, id="mp4-fragments"),
]


@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize(("suffix", "codec", "settings"), CUTS)
def test_cut_file_gives_its_good_frames_and_one_warning(tmp_path, caplog, suffix, codec, settings, share):
    whole = noise_clip(tmp_path / f"whole.{suffix}", codec=codec, **settings)
    good = contents(open_video(whole))
    source = open_video(cut(whole, tmp_path / f"clip.{suffix}", share))
    with caplog.at_level(logging.WARNING):
        got = contents(source)
    assert 1 < len(got) < 20
    assert got == good[: len(got)]
    [warning] = source.warnings
    assert f"broken after frame {got[-1][0]} ({got[-1][1]:.2f} s)" in warning
    assert "cut short" in warning
    assert [record.message for record in caplog.records].count(warning) == 1


def test_cut_mp4_with_its_index_last_cannot_be_opened_and_says_why(tmp_path):
    whole = noise_clip(tmp_path / "whole.mp4")
    with pytest.raises(VideoError, match=r"clip\.mp4: the file is cut short .* index"):
        open_video(cut(whole, tmp_path / "clip.mp4", 0.9))


def test_good_files_give_no_warning(tmp_path):
    for suffix, codec in [("avi", "mpeg4"), ("mkv", "libx264"), ("mp4", "libx264"), ("ts", "libx264")]:
        source = open_video(noise_clip(tmp_path / f"clip.{suffix}", codec=codec))
        assert (len(list(source)), source.warnings) == (20, [])
    pause = open_video(write_clip(tmp_path / "pause.mkv", 3, times_s=[0, 0.1, 30.0]))
    assert (len(list(pause)), pause.warnings) == (3, [])


def test_tail_of_zeros_is_noticed(tmp_path):
    path = noise_clip(tmp_path / "clip.mkv")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + bytes(len(data) - len(data) // 2))
    source = open_video(path)
    count = len(list(source))
    assert 5 < count < 15
    assert [f"broken after frame {count - 1}" in text for text in source.warnings] == [True]


@pytest.mark.parametrize("codec", ["mjpeg", "libx264"])
def test_frames_after_a_damaged_one_keep_their_numbers(tmp_path, codec):
    """A lost frame takes its number with it: results would otherwise shift against the truth."""
    whole = noise_clip(tmp_path / "clip.mkv", codec=codec, key_every=1)
    good = contents(open_video(whole))
    with av.open(str(whole)) as container:
        packet = list(container.demux(video=0))[8]
        position, size = packet.pos, packet.size
    data = bytearray(whole.read_bytes())
    data[position + 40 : position + size - 40] = bytes(size - 80)
    whole.write_bytes(data)
    source = open_video(whole)
    got = contents(source)
    assert [row[0] for row in got] == [i for i in range(20) if i != 8]
    assert set(got) <= set(good)
    assert got[-1] == good[-1]
    [warning] = source.warnings
    assert "damaged after frame" in warning
    assert contents(open_video(whole)) == got


def test_file_without_a_decodable_frame_is_refused(tmp_path):
    path = noise_clip(tmp_path / "clip.mp4", 5, options={"movflags": "faststart"})
    data = path.read_bytes()
    start = data.index(b"mdat") + 4
    path.write_bytes(data[:start] + bytes(len(data) - start))
    with pytest.raises(VideoError, match="no frame could be decoded"):
        open_video(path)


@pytest.mark.data
@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("name", ["aicity17_teamuw_cam00.avi", "haarcascades_video2.avi"])
def test_real_clip_that_is_cut_gives_its_good_frames(tmp_path, name, share):
    path = DATA / "videos" / name
    if not path.exists():
        pytest.skip(f"needs {path}")
    source = open_video(cut(path, tmp_path / name, share))
    got = contents(source)
    assert got == contents(open_video(path, max_frames=len(got)))
    [warning] = source.warnings
    assert f"{os.sep}{name}: broken after frame {len(got) - 1} (" in warning
