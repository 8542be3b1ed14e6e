"""What a camera's follower remembers, in a file and back: it goes on to the byte, and damaged files are refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from camera.test_camera_motion import NO_BOXES, SIZE, pose, textured, view
from lookonce.camera import CameraMotion
from lookonce.errors import FormatError, OutputError

BOX = np.array([[100, 60, 180, 150]], np.float32)


def journey() -> list[tuple[np.ndarray, np.ndarray, tuple[int, int], float]]:
    """Rest, sleep, a slow start, a quick pan, a cut to somewhere else, rest again, another size: 150 frames."""
    world, elsewhere = textured(), textured(seed=9)
    frames = []
    for t in range(150):
        moved = max(0, t - 63)
        motion = pose(1.3 * moved + 9 * math.sin(moved / 4), 2 * math.sin(moved / 7), 0.001 * moved)
        picture = view(world if t < 100 else elsewhere, motion if t < 120 else pose(), seed=t)
        size = SIZE if t < 140 else (540, 960)
        frames.append((picture, BOX if t % 3 else NO_BOXES, size, t / 25))
    return frames


def follow(camera: CameraMotion, frames: list) -> list[bytes]:
    return [camera.update(*frame).tobytes() for frame in frames]


@pytest.fixture(scope="module")
def travelled() -> tuple[list, list[bytes]]:
    frames = journey()
    return frames, follow(CameraMotion(), frames)


def test_from_any_frame_it_goes_on_to_the_byte(travelled, tmp_path: Path) -> None:
    frames, unbroken = travelled
    assert len(set(unbroken)) > 30  # it does move
    camera = CameraMotion()
    for number, frame in enumerate(frames):
        camera.save(tmp_path / "camera")
        camera = CameraMotion.load(tmp_path / "camera")
        assert camera.update(*frame).tobytes() == unbroken[number], number


@pytest.mark.parametrize("stop", [30, 57, 64, 66, 80, 101, 125])
def test_after_one_stop_the_rest_is_the_same(travelled, tmp_path: Path, stop: int) -> None:
    frames, unbroken = travelled
    camera = CameraMotion()
    follow(camera, frames[:stop])
    camera.save(tmp_path / "camera")
    assert follow(CameraMotion.load(tmp_path / "camera"), frames[stop:]) == unbroken[stop:]
    assert follow(camera, frames[stop:]) == unbroken[stop:]  # to save changes nothing


def test_a_state_is_no_larger_than_its_pictures(travelled, tmp_path: Path) -> None:
    camera = CameraMotion()
    follow(camera, travelled[0][:80])
    camera.save(tmp_path / "camera")
    assert (tmp_path / "camera").stat().st_size < 480 * 270 + 2 * 240 * 135 + 10_000


@pytest.fixture(scope="module")
def saved(travelled, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a camera that moves."""
    path, camera = tmp_path_factory.mktemp("camera") / "camera", CameraMotion()
    follow(camera, travelled[0][:75])
    camera.save(path)
    return path


def test_a_file_cut_short_is_refused_wherever_it_is_cut(saved: Path, tmp_path: Path) -> None:
    data = saved.read_bytes()
    for length in range(0, len(data) - 1, len(data) // 60):
        (tmp_path / "cut").write_bytes(data[:length])
        with pytest.raises(FormatError, match="cut"):
            CameraMotion.load(tmp_path / "cut")


def test_a_damaged_file_is_refused_or_harmless(saved: Path, travelled, tmp_path: Path) -> None:
    data, rng, refused = saved.read_bytes(), np.random.default_rng(0), 0
    for _ in range(100):
        damaged = bytearray(data)
        damaged[rng.integers(len(data))] ^= 1 << rng.integers(8)
        (tmp_path / "damaged").write_bytes(damaged)
        try:
            follow(CameraMotion.load(tmp_path / "damaged"), travelled[0][75:77])
        except FormatError:
            refused += 1
    assert refused > 90


def _rewritten(saved: Path, path: Path, **changes) -> Path:
    """The file with other arrays; the checksums are right."""
    with np.load(saved) as archive:
        arrays = dict(archive) | changes
    np.savez(path, allow_pickle=True, **{name: values for name, values in arrays.items() if values is not None})
    return path.with_suffix(".npz")


MOTIONS = np.stack([np.eye(2, 3)] * 3)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"luma": None}, id="an array is missing"),
        pytest.param({"more": np.zeros(1)}, id="an unknown array"),
        pytest.param({"luma": np.zeros((270, 480), np.float64)}, id="another dtype"),
        pytest.param({"luma": np.zeros((100, 480), np.uint8)}, id="a picture of another size"),
        pytest.param({"luma": np.array([{}], object)}, id="a pickle"),
        pytest.param({"reference": np.zeros((0, 0), np.int16)}, id="moving without a reference"),
        pytest.param({"reference": np.full((135, 240), 30_000, np.int16)}, id="too bright"),
        pytest.param({"reference_boxes": np.full((1, 4), np.nan)}, id="no numbers"),
        pytest.param({"reference_boxes": np.zeros((200_000, 4))}, id="too many boxes"),
        pytest.param({"xyxy": np.zeros((3, 5), np.float32)}, id="boxes of five"),
        pytest.param({"motions": np.zeros((3, 2, 3))}, id="a motion that cannot be undone"),
        pytest.param({"motions": MOTIONS * 1e9}, id="a motion too far"),
        pytest.param({"motions": MOTIONS * np.nan}, id="a motion that is no number"),
        pytest.param({"motions": MOTIONS[:2]}, id="too few motions"),
        pytest.param({"times": np.full(4, np.inf)}, id="an infinite time"),
        pytest.param({"times": np.array([0, 0, 0, np.nan])}, id="no time"),
        pytest.param({"times": np.zeros(3)}, id="too few times"),
        pytest.param({"about": np.frombuffer(b"{}", np.uint8)}, id="not ours"),
        pytest.param({"about": np.frombuffer(b"[" * 5000, np.uint8)}, id="no JSON"),
        pytest.param({"about": np.zeros(1 << 20, np.uint8)}, id="a huge text"),
    ],
)
def test_what_is_no_state_is_one_line(saved: Path, tmp_path: Path, changes) -> None:
    with pytest.raises(FormatError, match=r"CameraMotion\.save") as caught:
        CameraMotion.load(_rewritten(saved, tmp_path / "bad", **changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param({"version": 99}, "version 99", id="version"),
        pytest.param({"format": "lookonce-tracker"}, "no camera's state", id="a tracker's"),
        pytest.param({"size": [270]}, "size", id="one side"),
        pytest.param({"size": [270, -1]}, "size", id="negative side"),
        pytest.param({"size": 3}, "state", id="a number for a size"),
        pytest.param({"is_still": 1}, "is_still", id="no truth value"),
    ],
)
def test_what_the_text_says_is_checked(saved: Path, tmp_path: Path, change, message) -> None:
    with np.load(saved) as archive:
        about = json.loads(archive["about"].tobytes())
    text = json.dumps(about | change).encode()
    with pytest.raises(FormatError, match=message):
        CameraMotion.load(_rewritten(saved, tmp_path / "bad", about=np.frombuffer(text, np.uint8)))


def test_a_bomb_is_refused_before_it_is_unpacked(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookonce.camera.state._MOST_BYTES", 1000)
    monkeypatch.setattr("zipfile.ZipFile.read", None)  # nothing is unpacked
    with pytest.raises(FormatError, match="larger than"):
        CameraMotion.load(saved)


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="nothing"):
        CameraMotion.load(tmp_path / "nothing")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        CameraMotion().save(tmp_path / "file" / "camera")
