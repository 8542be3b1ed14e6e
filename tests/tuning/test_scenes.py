"""Parts of sequences: by frame rate and by time, truth and detections alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tuning.blinking import make_scene


def frames_of(scene):
    return scene.truth.frames.tolist(), scene.detections.frames.tolist()


def test_halves_hold_each_frame_once():
    first, second = make_scene(frames=9).cut(2)
    assert frames_of(first) == ([0, 1, 2, 3], [0, 1, 2, 3])
    assert frames_of(second) == ([4, 5, 6, 7, 8], [4, 5, 6, 7, 8])
    assert [frame.detections.xyxy[0, 0] for frame in second.detections] == [18, 20, 22, 24, 26]
    assert second.truth.xyxy[::2, 0].tolist() == [18, 20, 22, 24, 26]
    assert second.detections.times.tolist() == [0.4, 0.5, 0.6, 0.7, 0.8]


def test_there_are_never_more_parts_than_frames():
    assert [frames_of(part)[0] for part in make_scene(frames=2).cut(5)] == [[0], [1]]
    assert len(make_scene(frames=3).cut(1)) == 1


def test_every_third_frame_counts_from_the_sequences_start():
    second = make_scene(frames=12).cut(2)[1].every(3)
    assert frames_of(second) == ([6, 9], [6, 9])
    assert second.truth.row_frames.tolist() == [6, 6, 9, 9]


def test_frames_without_detections_stay():
    scene = make_scene(frames=6, missing=(2, 3)).cut(2)[1]
    assert [len(frame.detections) for frame in scene.detections] == [0, 2, 2]


@pytest.mark.parametrize("field", ["xyxy", "ids", "is_counted"])
def test_digest_tells_other_truth(field):
    scene = make_scene()
    values = getattr(scene.truth, field).copy()
    values[0] = ~values[0] if values.dtype == np.bool_ else values[0] - 0.5 if field == "xyxy" else 77
    other = replace(scene, truth=replace(scene.truth, **{field: values}))
    assert scene.digest() == make_scene().digest() != other.digest()


def test_digest_tells_other_ignored_regions():
    """Once it did not, and trials scored with other regions would have been resumed."""
    scene = make_scene()
    regions = [np.array([[0, 0, size, size]], np.float64) for size in (10, 20)]
    others = [replace(scene, truth=replace(scene.truth, ignored=one)).digest() for one in regions]
    assert len({scene.digest(), *others}) == 3


def test_digest_tells_other_detections_and_names():
    assert len({make_scene().digest(), make_scene(missing=(3,)).digest(), make_scene("b").digest()}) == 3
