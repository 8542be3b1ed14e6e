"""A camera that moves is told to the trackers of a search as `lookonce track` tells it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lookonce.compare.detections import DetectedFrame, DetectedSequence
from lookonce.structures import Detections
from lookonce.tracking import DefaultConfig
from lookonce.tuning.cameras import camera_motions
from lookonce.tuning.scoring import Scorer
from tuning.blinking import make_scene

SIZE = (240, 320)
PAN_PX = 3


def write_pan(folder: Path, frames: int, step: int) -> Path:
    """A camera that looks along a speckled wall, so many px further each frame."""
    speckles = np.random.default_rng(3).integers(0, 256, (SIZE[0] // 6, 120), dtype=np.uint8)
    wall = np.kron(speckles, np.ones((6, 6), np.uint8))
    folder.mkdir()
    for index in range(frames):
        view = wall[: SIZE[0], index * step : index * step + SIZE[1]]
        Image.fromarray(np.stack([view] * 3, axis=2)).save(folder / f"{index:03d}.png")
    return folder


def nothing_found(frames: int) -> DetectedSequence:
    return DetectedSequence.of_frames([DetectedFrame(index, index / 10, Detections.empty()) for index in range(frames)])


@pytest.mark.parametrize("every", [1, 2])
def test_motion_is_seen_at_each_frame_rate(tmp_path, every):
    told: list[tuple[int, int | None]] = []
    pictures = write_pan(tmp_path / "pan", 8, PAN_PX)
    found = camera_motions(pictures, 10.0, every, nothing_found(8), SIZE, lambda *one: told.append(one))
    assert sorted(found) == list(range(every, 8, every))
    for motion in found.values():
        np.testing.assert_allclose(motion, [[1, 0, -PAN_PX * every], [0, 1, 0]], atol=0.6)
    assert [done for done, _ in told] == list(range(1, 8 // every + 1))


def test_a_camera_at_rest_leaves_nothing(tmp_path):
    pictures = write_pan(tmp_path / "rest", 4, 0)
    assert camera_motions(pictures, 10.0, 1, nothing_found(4), SIZE, lambda *_: None) == {}


def test_objects_are_kept_through_a_jerk_of_the_camera_that_is_known():
    """From frame 10 on the picture lies elsewhere, so far that both objects seem to be new ones."""
    scene, jerk = make_scene(speed=1.0), 300.0
    truth, found = scene.truth, scene.detections
    shift = np.where(truth.row_frames >= 10, jerk, 0.0)[:, None] * np.array([0, 1, 0, 1])
    moved = replace(
        scene,
        truth=replace(truth, xyxy=truth.xyxy + shift),
        detections=replace(found, xyxy=found.xyxy + shift.astype(np.float32), descriptors=None),
    )
    camera = np.array([[1.0, 0, 0], [0, 1, jerk]])
    told = replace(moved, cameras={1: {10: camera}})
    config = DefaultConfig(appearance=False, jolts=False)
    (without,), (with_camera,) = (Scorer([one], [1]).scores(config) for one in (moved, told))
    assert (without.counts.tracks, with_camera.counts.tracks) == (4, 2)
    assert with_camera.identity.idf1 == 1.0
    (second,) = Scorer([told.cut(2)[1]], [1]).scores(config)
    assert second.counts.tracks == 2
    assert moved.digest() != told.digest()
    assert told.digest() != replace(moved, cameras={2: {10: camera}}).digest()
