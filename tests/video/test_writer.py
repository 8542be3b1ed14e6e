"""Written videos: times, sizes, and what survives a crash."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest

from lookonce.errors import OutputError
from lookonce.video import VideoWriter, open_video
from video.clips import grey, number_in

SUFFIXES = pytest.mark.parametrize("suffix", ["mp4", "mkv"])


@SUFFIXES
def test_frames_and_true_times_come_back(tmp_path, suffix):
    times = [3.0, 3.04, 3.5, 3.52, 6.0, 6.033]
    with VideoWriter(tmp_path / f"out.{suffix}", 25) as writer:
        for i, time_s in enumerate(times):
            writer.write(grey(i), time_s)
    source = open_video(tmp_path / f"out.{suffix}")
    frames = list(source)
    assert [number_in(f) for f in frames] == list(range(6))
    assert [f.time_s for f in frames] == pytest.approx([t - 3.0 for t in times], abs=0.0006)
    assert source.warnings == []
    with av.open(str(source_path := tmp_path / f"out.{suffix}")) as container:
        assert container.streams.video[0].codec_context.name in ("h264", "mpeg4"), source_path
        assert container.start_time in (0, None)


def test_times_that_do_not_go_forward_are_moved_on(tmp_path):
    with VideoWriter(tmp_path / "out.mp4", 25) as writer:
        for i, time_s in enumerate([0.0, 0.0, 0.5, 0.2, 1.0]):
            writer.write(grey(i), time_s)
    times = [f.time_s for f in open_video(tmp_path / "out.mp4")]
    assert times == pytest.approx([0, 0, 0.5, 0.5, 1.0], abs=1e-3)
    assert sorted(set(times)) == times


def test_odd_sizes_grow_by_their_edge_and_other_sizes_are_scaled(tmp_path):
    image = np.full((47, 63, 3), 200, np.uint8)
    with VideoWriter(tmp_path / "out.mp4", 25) as writer:
        writer.write(image, 0.0)
        writer.write(np.full((100, 30, 3), 200, np.uint8), 0.1)
    frames = list(open_video(tmp_path / "out.mp4"))
    assert [f.size for f in frames] == [(48, 64), (48, 64)]
    assert all(abs(f.image.astype(int) - 200).max() < 8 for f in frames)


def test_colours_survive(tmp_path):
    image = np.zeros((720, 1280, 3), np.uint8)
    image[:, :640], image[:, 640:] = (200, 30, 60), (20, 180, 90)
    with VideoWriter(tmp_path / "out.mp4", 25) as writer:
        writer.write(image, 0.0)
    [frame] = open_video(tmp_path / "out.mp4")
    assert np.abs(frame.image[:, 100:500].astype(int) - image[:, 100:500]).max() < 8
    assert np.abs(frame.image[:, 700:1200].astype(int) - image[:, 700:1200]).max() < 8
    with av.open(str(tmp_path / "out.mp4")) as container:
        assert container.streams.video[0].codec_context.colorspace == 6  # named, so that players need not guess


@SUFFIXES
def test_what_was_written_before_a_kill_plays(tmp_path, suffix):
    path = tmp_path / f"out.{suffix}"
    script = f"""
import os, signal, sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from lookonce.video import VideoWriter
from video.clips import grey
writer = VideoWriter({str(path)!r}, 10)
for i in range(45):
    writer.write(grey(i), i / 10)
os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", script], check=False, env={**os.environ, "PYTHONWARNINGS": "ignore"})
    frames = list(open_video(path))
    assert len(frames) >= 20
    assert [number_in(f) for f in frames] == list(range(len(frames)))


def test_next_encoder_is_used_where_one_is_missing(tmp_path, caplog):
    with VideoWriter(tmp_path / "out.mp4", 25, encoders=("no_such_encoder", "mpeg4")) as writer:
        writer.write(grey(3), 0.0)
    assert "encoded with mpeg4; no_such_encoder" in caplog.text
    assert [number_in(f) for f in open_video(tmp_path / "out.mp4")] == [3]
    with VideoWriter(tmp_path / "none.mp4", 25, encoders=("no_such_encoder",)) as writer:
        with pytest.raises(OutputError, match="no encoder works"):
            writer.write(grey(3), 0.0)


def test_file_that_cannot_be_created_is_named(tmp_path):
    with pytest.raises(OutputError, match=r"out\.mp4: cannot be written"):
        VideoWriter(tmp_path / "missing" / "out.mp4", 25)
    with pytest.raises(OutputError, match=r"\.mp4 or \.mkv"):
        VideoWriter(tmp_path / "out.gif", 25)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a disk that is always full")
def test_full_disk_is_an_output_error(tmp_path):
    (tmp_path / "out.mp4").symlink_to("/dev/full")

    def write():
        with VideoWriter(tmp_path / "out.mp4", 10) as writer:
            for i in range(40):
                writer.write(grey(i), i / 10)

    with pytest.raises(OutputError, match="cannot be written"):
        write()


def test_nothing_written_leaves_no_file(tmp_path):
    with VideoWriter(tmp_path / "out.mp4", 25):
        assert (tmp_path / "out.mp4").exists()
    assert not (tmp_path / "out.mp4").exists()


@pytest.mark.parametrize(
    ("rgb", "time_s"),
    [
        (np.zeros((4, 4), np.uint8), 0.0),
        (np.zeros((4, 4, 3), np.float32), 0.0),
        (np.zeros((0, 4, 3), np.uint8), 0.0),
        (np.zeros((4, 4, 3), np.uint8), float("nan")),
    ],
    ids=["grey", "float", "empty", "no-time"],
)
def test_wrong_calls_are_refused(tmp_path, rgb, time_s):
    with VideoWriter(tmp_path / "out.mp4", 25) as writer, pytest.raises(ValueError, match=r"rgb|time_s"):
        writer.write(rgb, time_s)
