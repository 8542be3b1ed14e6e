"""How the camera moved is found as `lookonce track` finds it, and told to the trackers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compare.moving import ids_by_lane, lane, make_sequence
from compare.panning import PAN_PX, SIZE, write_pan
from lookonce.compare.cameras import camera_motions
from lookonce.compare.contenders.presets import associate_by
from lookonce.compare.detections import DetectedFrame, DetectedSequence
from lookonce.structures import Detections
from lookonce.tracking import DefaultConfig


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


def test_presets_are_told_how_the_camera_moved():
    """From frame 8 on the picture lies elsewhere, so far that both objects seem to be new ones."""
    sequence, owners = make_sequence([lane(0, step=1.0), lane(90, step=1.0)], 16)
    shift = np.where(sequence.row_frames >= 8, 300.0, 0.0)[:, None] * np.array([0, 1, 0, 1])
    moved = replace(sequence, xyxy=sequence.xyxy + shift.astype(np.float32), descriptors=None)
    told = replace(moved, cameras={1: {8: np.array([[1.0, 0, 0], [0, 1, 300.0]])}})
    config = DefaultConfig(appearance=False, jolts=False)
    assert ids_by_lane(associate_by(config, moved).ids, owners) == [{1, 3}, {2, 4}]
    assert ids_by_lane(associate_by(config, told).ids, owners) == [{1}, {2}]


def test_each_frame_rate_has_its_own_maps():
    one, two = np.array([[1.0, 0, 5], [0, 1, 0]]), np.array([[1.0, 0, 9], [0, 1, 0]])
    sequence = replace(make_sequence([lane(0)])[0], cameras={1: {4: one}, 2: {4: two}})
    assert [frame.index for frame in sequence if frame.camera is not None] == [4]
    assert next(frame.camera for frame in sequence.every(1) if frame.index == 4) is one
    assert next(frame.camera for frame in sequence.every(2) if frame.index == 4) is two
    assert all(frame.camera is None for frame in sequence.every(4))  # nobody looked


@pytest.mark.parametrize(
    "camera",
    [np.zeros((2, 3)), np.full((2, 3), np.nan), np.eye(3), np.eye(2, 3, dtype=np.float32)],
    ids=["singular", "nan", "shape", "dtype"],
)
def test_maps_that_are_none_are_refused(camera):
    with pytest.raises(ValueError, match="cameras"):
        replace(make_sequence([lane(0)])[0], cameras={1: {4: camera}})
