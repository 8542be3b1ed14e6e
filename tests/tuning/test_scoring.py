"""Scores of settings on scenes whose result is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compare.moving import leaves_and_comes
from lookonce.errors import ConfigError
from lookonce.evaluation import combine
from lookonce.tracking import DefaultConfig, PaperConfig
from lookonce.tuning.scenes import TuningScene
from lookonce.tuning.scoring import Gain, Scorer, objective_value
from tuning.blinking import DISTANCE, make_scene

TOO_SMALL, LARGE_ENOUGH = PaperConfig(0.95 * DISTANCE), PaperConfig(1.05 * DISTANCE)


def test_objects_keep_their_ids_where_the_threshold_allows_it():
    scorer = Scorer([make_scene(frames=6)], [1])
    (good,), (bad,) = scorer.scores(LARGE_ENOUGH), scorer.scores(TOO_SMALL)
    assert (good.identity.idf1, good.clear.id_switches, good.counts.tracks) == (1.0, 0, 2)
    assert (bad.clear.id_switches, bad.counts.tracks) == (10, 12)
    assert objective_value("hota", [good]) == pytest.approx(1.0)
    assert objective_value("mota", [bad]) == pytest.approx(1 - 10 / 12)


def test_the_objective_is_the_mean_over_frame_rates():
    """Every second frame an object looks the same, and any threshold does."""
    scores = Scorer([make_scene()], [1, 2]).scores(TOO_SMALL)
    one, two = (objective_value("idf1", [rate]) for rate in scores)
    assert two == 1.0 > one
    assert objective_value("idf1", scores) == pytest.approx((one + two) / 2)


def test_scenes_are_combined_and_a_tracker_starts_anew_in_each():
    scenes = [make_scene("a"), make_scene("b", 10)]
    (both,) = Scorer(scenes, [1]).scores(LARGE_ENOUGH)
    apart = combine([Scorer([scene], [1]).scores(LARGE_ENOUGH)[0] for scene in scenes])
    assert (both.clear, both.identity, both.counts) == (apart.clear, apart.identity, apart.counts)
    assert (both.counts.frames, both.counts.tracks, both.clear.id_switches) == (30, 4, 0)


def test_rows_given_back_count_in_their_own_frames():
    """An object is real from its second frame on, and gets its first row back, also where only some frames are used."""
    (scores,) = Scorer([make_scene().cut(2)[1]], [2]).scores(DefaultConfig(match_threshold=1.5))
    assert (scores.clear.misses, scores.clear.false_positives, scores.counts.frames) == (0, 0, 5)


@pytest.mark.parametrize(("size", "tracks"), [((480, 640), 2), (None, 1)])
def test_who_leaves_the_picture_is_gone(size, tracks):
    """As in `lookonce track`, which knows the size as well."""
    found = replace(leaves_and_comes(), size=size)
    scene = TuningScene("a", make_scene(frames=30).truth, found)
    (scores,) = Scorer([scene], [1]).scores(DefaultConfig())
    assert scores.counts.tracks == tracks
    assert (scene.digest() == TuningScene("a", scene.truth, leaves_and_comes()).digest()) == (size is None)


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
    told = replace(moved, detections=replace(moved.detections, cameras={1: {10: camera}}))
    config = DefaultConfig(appearance=False, jolts=False)
    (without,), (with_camera,) = (Scorer([one], [1]).scores(config) for one in (moved, told))
    assert (without.counts.tracks, with_camera.counts.tracks) == (4, 2)
    assert with_camera.identity.idf1 == 1.0
    (second,) = Scorer([told.cut(2)[1]], [1]).scores(config)
    assert second.counts.tracks == 2
    assert moved.digest() != told.digest()
    other = replace(moved, detections=replace(moved.detections, cameras={2: {10: camera}}))
    assert told.digest() != other.digest()


def test_results_in_ignored_regions_are_left_out_at_every_frame_rate():
    """Of two objects that are seen only one has truth; the other one is where truth is not told."""
    scene = make_scene()
    truth = scene.truth
    kept = truth.ids == 1
    first_px = truth.xyxy[~kept, 0].min()
    alone = truth.of_rows(kept)
    told = replace(alone, ignored=np.array([[first_px, 0, 500, 100]]))
    wrong, right = (Scorer([replace(scene, truth=one)], [1, 2]).scores(LARGE_ENOUGH) for one in (alone, told))
    assert [one.clear.false_positives for one in wrong] == [20, 10]
    assert [one.clear.false_positives for one in right] == [0, 0]
    assert [one.left_out for one in right] == [{"result: in an ignored region": count} for count in (20, 10)]


def test_gain_is_the_mean_over_parts_and_its_error_tells_how_they_differ():
    scorer = Scorer([make_scene()], [1])
    gain = scorer.gain("mota", TOO_SMALL, LARGE_ENOUGH)
    # five parts of 4 frames: in each the ids of the worse change three times, from part to part nobody counts
    assert gain == Gain(pytest.approx(3 / 4), pytest.approx(0.0, abs=1e-12))
    assert gain.is_clear
    assert not scorer.gain("mota", LARGE_ENOUGH, TOO_SMALL).is_clear
    assert not scorer.gain("mota", TOO_SMALL, TOO_SMALL).is_clear


def test_a_single_part_tells_nothing_of_the_error():
    gain = Scorer([make_scene(frames=1)], [1]).gain("mota", TOO_SMALL, LARGE_ENOUGH)
    assert gain.error == np.inf
    assert not gain.is_clear


def test_nothing_to_find_is_one_line():
    scene = make_scene(frames=8).cut(4)[1]  # frames 2 and 3
    with pytest.raises(ConfigError, match="a: no object that counts in every 5th frame"):
        Scorer([scene], [5])
