"""Pictures: cut from local sources only, small, the right part of the right frame."""

from __future__ import annotations

import base64
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from datasets.making import write, write_pictures
from lookonce.evaluation.tracking.following import follow
from lookonce.report import scored_view
from lookonce.report.explained import Explanation
from lookonce.report.illustrating import choose_moments, illustrate
from lookonce.report.pictures import CROP_SIZE, MOST_CROP_BYTES, backdrop, cut, find_source, frames_of, heat
from lookonce.report.spans import Clock
from lookonce.video import VideoWriter
from report.scenes import lines_of, make_result, make_truth


def decoded(uri: str) -> np.ndarray:
    with Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))) as picture:
        return np.asarray(picture)


def test_crop_shows_the_object_in_the_middle():
    image = np.zeros((400, 600, 3), np.uint8)
    image[190:210, 290:310] = 255
    crop = cut(image, np.array([290, 190, 310, 210.0]))
    shown = decoded(crop.uri)
    assert shown.shape[:2] == CROP_SIZE
    left, top, right, bottom = crop.window
    assert (right - left) / (bottom - top) == pytest.approx(CROP_SIZE[1] / CROP_SIZE[0])
    assert ((left + right) / 2, (top + bottom) / 2) == (300, 200)
    height, width = CROP_SIZE
    assert shown[height // 2, width // 2].min() > 200
    assert shown[height // 2, width // 6].max() < 50


@pytest.mark.parametrize(
    "xyxy",
    [
        pytest.param([0, 0, 5, 5], id="corner"),
        pytest.param([590, 390, 640, 450], id="beyond-the-border"),
        pytest.param([-200, -200, -100, -100], id="outside"),
        pytest.param([0, 0, 600, 400], id="everything"),
        pytest.param([0, 0, 5000, 9000], id="larger-than-the-picture"),
        pytest.param([300, 200, 300, 200], id="nothing"),
    ],
)
def test_windows_stay_within_the_picture(xyxy):
    crop = cut(np.zeros((400, 600, 3), np.uint8), np.array(xyxy, np.float64))
    left, top, right, bottom = crop.window
    assert 0 <= left < right <= 600
    assert 0 <= top < bottom <= 400
    assert decoded(crop.uri).shape[:2] == CROP_SIZE


def test_bytes_are_bounded_also_for_noise():
    noise = np.random.default_rng(0).integers(0, 256, (700, 900, 3), dtype=np.uint8)
    data = base64.b64decode(cut(noise, np.array([300, 200, 400, 300.0])).uri.partition(",")[2])
    assert 1000 < len(data) <= MOST_CROP_BYTES
    assert len(backdrop(noise)) < 60_000
    assert cut(noise, np.array([0, 0, 9, 9.0])) == cut(noise, np.array([0, 0, 9, 9.0]))


def test_heat_is_opaque_where_there_is_most():
    counts = np.array([[0, 1], [4, 100]], np.int64)
    pixels = decoded(heat(counts, (230, 159, 0), 100))
    assert pixels.shape == (2, 2, 4)
    assert pixels[0, 0, 3] == 0
    assert 0 < pixels[0, 1, 3] < pixels[1, 0, 3] < pixels[1, 1, 3] == 255


@pytest.mark.parametrize(
    "source",
    ["", "0", "/dev/null", "/dev/video0", "http://example.org/a.mp4", "rtsp://a/b", "file:///etc/passwd", "x" * 5000],
)
def test_no_url_camera_or_device_is_a_source(source):
    assert find_source(source) is None


def test_the_first_source_that_is_there_is_taken(tmp_path: Path):
    folder = write_pictures(tmp_path / "seq" / "img1", ["000001.png"]).parent
    file = write(tmp_path / "a.mp4", "x")
    assert find_source(tmp_path / "no", folder, file) == folder
    assert find_source(str(file), folder) == file
    (tmp_path / "empty").mkdir()
    assert find_source(tmp_path / "empty") is None


def grey(index: int) -> np.ndarray:
    return np.full((48, 64, 3), 20 * index, np.uint8)


def write_grey(folder: Path, frames: int) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for index in range(frames):
        Image.fromarray(grey(index)).save(folder / f"{index + 1:06d}.png")
    return folder


def test_wanted_frames_come_from_folders_and_videos(tmp_path: Path):
    folder, video = write_grey(tmp_path / "img1", 8), tmp_path / "a.mp4"
    with VideoWriter(video, 10.0) as writer:
        for index in range(8):
            writer.write(grey(index), index / 10)
    for source in (folder, tmp_path, video):
        found = [(one.index, round(float(one.image.mean()) / 20)) for one in frames_of(source, {2, 5, 99})]
        assert found == [(2, 2), (5, 5)], source
    assert list(frames_of(folder, set())) == []
    single = [one.index for one in frames_of(folder / "000003.png", {0, 1})]
    assert single == [0]
    write(folder / "000003.png", "damaged")
    assert [one.index for one in frames_of(folder, {2, 5})] == [5]


def a_view(name: str, switches: int, size: tuple[int, int] | None = None):
    frames = 2 * (switches + 1)
    truth = make_truth({1: list(range(frames))}, frames, {1: 20.0})
    result = make_result([(frame, 5 + frame // 2, 0.5) for frame in range(frames)])
    view = scored_view(
        "run",
        name,
        Clock({}),
        truth,
        result,
        protocol="trackeval",
        classes=("car",),
        lines=lines_of(result, size),
        explanation=Explanation({}),
    )
    assert len(view.moments) == len(follow(truth, result).switches) == switches
    return view


def test_moments_are_shared_out_fairly_and_spread_over_time():
    views = [a_view("a", 2), a_view("b", 10), a_view("c", 0)]
    assert [len(one.places) for one in choose_moments(views, 100)] == [2, 10, 0]
    assert [one.places for one in choose_moments(views, 5)] == [(0, 1), (0, 4, 9), ()]
    assert [len(one.places) for one in choose_moments(views, 0)] == [0, 0, 0]
    assert [len(one.places) for one in choose_moments([views[1]] * 4, 3)] == [1, 1, 1, 0]


def test_tiles_show_both_frames_with_their_boxes(tmp_path: Path):
    source = write_grey(tmp_path / "img1", 8)
    done: list[tuple[int, int]] = []
    (view,), notes = illustrate(choose_moments([a_view("a", 3)], 2), source, lambda *step: done.append(step))
    assert notes == []
    assert done[-1] == (5, 5)  # two moments, and the first frame to lay colours over
    assert [len(one.tiles) for one in view.moments] == [2, 0, 2]
    first, last = view.moments[0].tiles, view.moments[2].tiles
    assert [one.frame for one in (*first, *last)] == [1, 2, 5, 6]
    assert [round(float(decoded(one.crop.uri).mean()) / 20) for one in (*first, *last)] == [1, 2, 5, 6]
    assert [(box.id, box.is_true) for box in first[1].boxes] == [(6, False), (-1, True)]
    assert view.places is not None
    assert view.places.backdrop.startswith("data:image/jpeg")


def test_pictures_of_another_size_are_not_shown(tmp_path: Path):
    source = write_grey(tmp_path / "img1", 8)
    (view,), (note,) = illustrate(choose_moments([a_view("a", 3, (1080, 1920))], 9), source, lambda *step: None)
    assert "another size" in note
    assert not any(one.tiles for one in view.moments)
    (view,), notes = illustrate(choose_moments([a_view("a", 3, (48, 64))], 9), source, lambda *step: None)
    assert notes == []
