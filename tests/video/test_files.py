"""Video files: frames, numbers, times and turns."""

from __future__ import annotations

import itertools

import av
import numpy as np
import pytest

from lookonce.errors import ConfigError, VideoError
from lookonce.video import open_video
from lookonce.video import seeking as seeking_module
from video.clips import DATA, grey, number_in, numbers_in, write_clip, write_sound


def test_every_frame_comes_once_in_order_with_its_number_and_time(tmp_path):
    source = open_video(write_clip(tmp_path / "clip.mp4", 20, b_frames=2))
    frames = list(source)
    assert [f.index for f in frames] == list(range(20)) == [number_in(f) for f in frames]
    assert [f.time_s for f in frames] == pytest.approx([i / 10 for i in range(20)])
    assert (source.name, source.frame_count, source.rate, source.size) == ("clip", 20, 10.0, (48, 64))
    assert (source.is_live, source.warnings) == (False, [])


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi", "ts"])
def test_start_gives_the_frames_that_a_full_pass_gives(tmp_path, suffix):
    codec, b_frames = ("mpeg4", 0) if suffix == "avi" else ("libx264", 2)
    path = write_clip(tmp_path / f"clip.{suffix}", 30, codec=codec, b_frames=b_frames)
    full = [(f.index, f.time_s, number_in(f)) for f in open_video(path)]
    for start_s in [0.05, 0.1, 0.5, 1.0, 1.45, 2.89, 2.9]:
        part = [(f.index, f.time_s, number_in(f)) for f in open_video(path, start_s=start_s)]
        assert part == [row for row in full if row[1] >= start_s]


def test_start_seeks_to_the_key_frame_before_it(tmp_path, monkeypatch):
    path = write_clip(tmp_path / "clip.mp4", 30, key_every=10)
    places = []
    seek = seeking_module.seek_to_start
    monkeypatch.setattr("lookonce.video.container.seek_to_start", lambda *a: places.append(seek(*a)) or places[-1])
    assert numbers_in(open_video(path, start_s=2.5)) == [25, 26, 27, 28, 29]
    assert places[0].index == 25


@pytest.mark.parametrize("codec", ["mpeg4", "libx264"])
def test_b_frames_in_avi_without_presentation_stamps_are_placed_right(tmp_path, codec):
    """FFmpeg guesses stamps for H.264 in AVI, out of order: the second frame came at 0.2 s, not 0.1 s."""
    path = write_clip(tmp_path / "clip.avi", 20, codec=codec, b_frames=2)
    source = open_video(path)
    frames = list(source)
    assert [number_in(f) for f in frames] == list(range(20))
    assert [f.time_s for f in frames] == pytest.approx([i / 10 for i in range(20)])
    assert source.warnings == []
    part = list(open_video(path, start_s=1.0))
    assert [f.index for f in part] == [number_in(f) for f in part]
    assert part[-1].index == 19


def test_end_every_and_max_frames_choose_frames(tmp_path):
    path = write_clip(tmp_path / "clip.mp4", 20)
    source = open_video(path, start_s=0.3, end_s=1.2, every=3)
    assert (numbers_in(source), source.frame_count) == ([3, 6, 9], 3)
    source = open_video(path, every=4, max_frames=2)
    assert (numbers_in(source), source.frame_count) == ([0, 4], 2)


def test_variable_frame_rate_keeps_the_true_times(tmp_path):
    times = [0.0, 0.04, 0.5, 0.52, 3.0, 3.033]
    source = open_video(write_clip(tmp_path / "clip.mkv", 6, times_s=times))
    assert [f.time_s for f in source] == pytest.approx(times)
    assert source.warnings == []


def test_time_starts_at_zero_where_the_container_starts_later(tmp_path):
    path = write_clip(tmp_path / "clip.ts", 5, times_s=[7 + i / 10 for i in range(5)])
    assert [f.time_s for f in open_video(path)] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])


QUARTER = 1 << 16


@pytest.mark.parametrize(
    ("matrix", "red_side"),
    [
        pytest.param([QUARTER, 0, 0, 0, QUARTER, 0, 0, 0, 1 << 30], "left", id="upright"),
        pytest.param([0, QUARTER, 0, -QUARTER, 0, 0, 0, 0, 1 << 30], "top", id="clockwise"),
        pytest.param([-QUARTER, 0, 0, 0, -QUARTER, 0, 0, 0, 1 << 30], "right", id="half-turn"),
        pytest.param([0, -QUARTER, 0, QUARTER, 0, 0, 0, 0, 1 << 30], "bottom", id="counter-clockwise"),
        pytest.param([-QUARTER, 0, 0, 0, QUARTER, 0, 0, 0, 1 << 30], "right", id="mirrored"),
    ],
)
def test_display_matrix_brings_the_picture_upright(tmp_path, matrix, red_side):
    """ISO 14496-12: x' = a x + c y, y' = b x + d y with y downwards; the stored picture is red on its left."""
    image = np.full((48, 96, 3), 128, np.uint8)
    image[:, :24] = (255, 0, 0)
    source = open_video(write_clip(tmp_path / "clip.mp4", images=[image] * 3, matrix=matrix))
    frame = next(iter(source))
    upright = frame.image.astype(int)
    assert upright.shape[:2] == frame.size == source.size
    assert frame.size == ((96, 48) if red_side in ("top", "bottom") else (48, 96))
    edges = {"left": upright[:, 4], "right": upright[:, -5], "top": upright[4], "bottom": upright[-5]}
    redness = {side: (edge[:, 0] - edge[:, 1]).min() for side, edge in edges.items()}
    assert max(redness, key=redness.get) == red_side
    assert redness[red_side] > 100


def test_frames_keep_their_own_sizes_and_times_go_on_where_clips_were_joined(tmp_path):
    first = write_clip(tmp_path / "a.ts", images=[grey(i, (48, 64)) for i in range(5)])
    second = write_clip(tmp_path / "b.ts", images=[grey(i, (96, 128)) for i in range(5)])
    (tmp_path / "c.ts").write_bytes(first.read_bytes() + second.read_bytes())
    frames = list(open_video(tmp_path / "c.ts"))
    assert {f.size for f in frames} == {(48, 64), (96, 128)}
    assert all(f.image.shape[:2] == f.size for f in frames)
    assert all(a.time_s < b.time_s for a, b in itertools.pairwise(frames))


def test_leaving_the_loop_early_closes_the_container(tmp_path, monkeypatch):
    closed = []
    path = write_clip(tmp_path / "clip.mp4", 20)
    opened = av.open

    class Watched:
        def __init__(self, *args, **kwargs):
            self._container = opened(*args, **kwargs)

        def __getattr__(self, name):
            return getattr(self._container, name)

        def close(self):
            closed.append(self)
            self._container.close()

    monkeypatch.setattr("lookonce.video.opening.av.open", Watched)
    for frame in open_video(path):
        if frame.index == 3:
            break
    assert len(closed) == 1
    with open_video(path) as source:
        next(iter(source))
    assert len(closed) == 2
    with open_video(path):
        pass
    assert len(closed) == 3


def test_file_can_be_read_twice_and_not_after_close(tmp_path):
    with open_video(write_clip(tmp_path / "clip.mp4", 5)) as source:
        assert numbers_in(source) == numbers_in(source) == [0, 1, 2, 3, 4]
    with pytest.raises(ValueError, match="closed"):
        iter(source)


def test_names_that_look_like_protocols_are_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (write_clip(tmp_path / "clip.mp4", 3)).rename(tmp_path / "concat:12.30.mp4")
    assert numbers_in(open_video("concat:12.30.mp4")) == [0, 1, 2]


def assert_refused(source, *words, **settings):
    with pytest.raises(VideoError) as caught:
        open_video(source, **settings)
    message = str(caught.value)
    assert "\n" not in message
    assert all(word in message for word in words), message
    return message


def test_missing_and_empty_files_are_named(tmp_path):
    assert_refused(tmp_path / "no.mp4", "no such file", "no.mp4")
    (tmp_path / "empty.mp4").touch()
    assert_refused(tmp_path / "empty.mp4", "empty.mp4", "0 bytes")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        pytest.param("notes.mp4", "hello world\n" * 200, id="text"),
        pytest.param("notes.txt", "hello world\n" * 200, id="text-art"),
        pytest.param("list.mp4", "#EXTM3U\n#EXTINF:5,\nhttp://127.0.0.1:9/x.ts\n#EXT-X-ENDLIST\n", id="playlist"),
        pytest.param("list.m3u8", "#EXTM3U\n#EXTINF:5,\nclip.ts\n#EXT-X-ENDLIST\n", id="local-playlist"),
        pytest.param("join.mp4", "ffconcat version 1.0\nfile clip.ts\n", id="ffconcat"),
        pytest.param("a.sdp", "v=0\no=- 0 0 IN IP4 127.0.0.1\nc=IN IP4 127.0.0.1\nm=video 5000 RTP/AVP 96\n", id="sdp"),
    ],
)
def test_text_is_no_video_and_leads_to_no_other_file(tmp_path, name, text):
    write_clip(tmp_path / "clip.ts", 3)
    (tmp_path / name).write_text(text)
    assert_refused(tmp_path / name, name, "not a video")


def test_sound_without_pictures_is_called_so(tmp_path):
    assert_refused(write_sound(tmp_path / "a.mp3", "libmp3lame"), "no video", "only sound")
    assert_refused(write_sound(tmp_path / "a.m4a", "aac"), "no video", "only sound")


def test_cover_picture_is_no_video(tmp_path):
    path = tmp_path / "song.m4a"
    sound = write_sound(tmp_path / "a.m4a", "aac")
    with av.open(str(sound)) as old, av.open(str(path), "w", format="mp4") as new:
        track = new.add_stream_from_template(old.streams.audio[0])
        cover = new.add_stream("png", rate=1)
        cover.height, cover.width, cover.pix_fmt = 48, 64, "rgb24"
        cover.disposition = av.stream.Disposition.attached_pic
        new.mux(cover.encode(av.VideoFrame.from_ndarray(grey(1), format="rgb24")))
        for packet in old.demux(audio=0):
            if packet.dts is not None:
                packet.stream = track
                new.mux(packet)
    with av.open(str(path)) as written:
        assert len(written.streams.video) == 1
    assert_refused(path, "no video", "only sound")


def test_start_behind_the_end_says_how_long_the_file_is(tmp_path):
    assert_refused(write_clip(tmp_path / "clip.mp4", 20), "2.00 s long", start_s=5.0)


@pytest.mark.parametrize(
    "settings",
    [
        {"start_s": -1.0},
        {"start_s": float("nan")},
        {"start_s": float("inf")},
        {"end_s": 0.0},
        {"end_s": float("nan")},
        {"start_s": 2.0, "end_s": 2.0},
        {"every": 0},
        {"max_frames": 0},
        {"fps": 10.0},
    ],
    ids=str,
)
def test_settings_that_cannot_work_are_refused(tmp_path, settings):
    path = write_clip(tmp_path / "clip.mp4", 3)
    with pytest.raises(ConfigError):
        open_video(path, **settings)


CLIPS = {
    "ahmetozlu_vehicle_counting.mp4": 905,
    "aicity17_teamuw_cam00.avi": 96,
    "haarcascades_video2.avi": 750,
    "intel_car-detection.mp4": 377,
    "intel_one-by-one-person-detection.mp4": 1394,
    "simple_vehicle_counting_video.avi": 374,
    "udacity_carnd_test_video.mp4": 38,
}


@pytest.mark.data
@pytest.mark.parametrize("name", CLIPS)
def test_real_clip_gives_all_frames_without_a_warning(name):
    path = DATA / "videos" / name
    if not path.exists():
        pytest.skip(f"needs {path}")
    source = open_video(path)
    full = [(f.index, f.time_s) for f in source]
    assert (len(full), source.frame_count, source.warnings) == (CLIPS[name], CLIPS[name], [])
    start_s = full[len(full) // 2][1]
    assert [(f.index, f.time_s) for f in open_video(path, start_s=start_s)] == full[len(full) // 2 :]
