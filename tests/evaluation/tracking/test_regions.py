"""Ignored regions under the usual protocol: TrackEval's rule for KITTI."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluation.tracking.trackeval_oracle import KITTI_CLASSES, differences, kitti_figures, random_frames, values_of
from lookonce.evaluation import TrackingResult, TrackingScores, TrackingTruth, combine, evaluate_tracking

REGION = (0, 0, 10, 10)
INSIDE = (1, 1, 9, 9)
LEFT_OUT = "result: in an ignored region"

Box = tuple[float, float, float, float]


def scores_of(truth: list[Box], result: list[Box], regions: list[Box], frames: int = 1) -> TrackingScores:
    """Figures of ``frames`` equal frames, boxes as corners."""
    return evaluate_tracking(truth_of(truth, regions, frames), result_of(result, frames))


def truth_of(boxes: list[Box], regions: list[Box], frames: int = 1) -> TrackingTruth:
    made = result_of(boxes, frames)
    every = np.ones(len(made), np.bool_)
    ignored = np.array(regions, np.float64).reshape(-1, 4)
    return TrackingTruth(np.arange(frames), made.row_frames, made.ids, made.xyxy, made.labels, every, ~every, ignored)


def result_of(boxes: list[Box], frames: int = 1) -> TrackingResult:
    ids = np.tile(np.arange(len(boxes)), frames)
    xyxy = np.tile(np.array(boxes, np.float64).reshape(-1, 4), (frames, 1))
    return TrackingResult(np.repeat(np.arange(frames), len(boxes)), ids, xyxy, ids * 0)


@pytest.mark.parametrize(
    ("box", "regions", "is_left_out"),
    [
        pytest.param(INSIDE, [REGION], True, id="inside"),
        pytest.param((20, 20, 28, 28), [REGION], False, id="elsewhere"),
        pytest.param((5, 0, 15, 10), [REGION], False, id="exactly-half"),
        pytest.param((4.9, 0, 14.9, 10), [REGION], True, id="more-than-half"),
        pytest.param((5, 0, 15, 10), [REGION, (10, 0, 20, 10)], False, id="half-in-each-of-two"),
        pytest.param((4, 0, 14, 10), [(50, 0, 60, 10), REGION], True, id="in-the-second-of-two"),
        pytest.param((0, 0, 30, 10), [REGION], False, id="region-covered-but-not-the-box"),
        pytest.param((-10, 0, 10, 10), [REGION], False, id="area-outside-the-picture-counts-to-the-box"),
        pytest.param((8, 2, 3, 9), [REGION], False, id="negative-width"),
        pytest.param((8, 9, 3, 2), [REGION], False, id="negative-width-and-height"),
        pytest.param((3, 3, 3, 9), [REGION], False, id="no-width"),
    ],
)
def test_result_without_match_is_left_out_if_more_than_half_of_it_lies_in_one_region(box, regions, is_left_out):
    for truth in ([], [(40.0, 40.0, 50.0, 50.0)]):
        scores = scores_of(truth, [box], regions, frames=2)
        assert scores.clear.false_positives == scores.counts.result_boxes == 2 * (not is_left_out)
        assert scores.identity.idfp == 2 * (not is_left_out)
        assert scores.left_out == ({LEFT_OUT: 2} if is_left_out else {})
        assert scores.clear.misses == 2 * len(truth)


def test_result_with_a_match_counts_wherever_it_is():
    scores = scores_of([INSIDE], [INSIDE], [REGION])
    assert (scores.clear.true_positives, scores.clear.misses, scores.clear.false_positives) == (1, 0, 0)
    assert scores.left_out == {}


@pytest.mark.parametrize(("bottom", "is_matched"), [(5.0, True), (4.9, False)], ids=["half", "less"])
def test_match_is_an_overlap_of_half(bottom, is_matched):
    scores = scores_of([(0, 0, 8, 10)], [(0, 0, 8, bottom)], [REGION])
    assert scores.clear.true_positives == scores.counts.result_boxes == is_matched
    assert scores.clear.misses == (not is_matched)
    assert scores.left_out == ({} if is_matched else {LEFT_OUT: 1})


def test_second_result_on_an_object_is_left_out_and_the_better_one_counts():
    scores = scores_of([INSIDE], [(1, 1, 9, 8), INSIDE], [REGION])
    assert (scores.clear.true_positives, scores.clear.false_positives) == (1, 0)
    assert scores.clear.overlap_sum == 1.0
    assert scores.left_out == {LEFT_OUT: 1}


def test_true_box_in_a_region_is_to_be_found():
    assert scores_of([INSIDE], [], [REGION]).clear.misses == 1


def test_result_on_a_distractor_in_a_region_is_left_out_once():
    truth = truth_of([INSIDE, (50, 50, 60, 60)], [REGION])
    truth = replace(truth, is_counted=np.array([False, True]), is_distractor=np.array([True, False]))
    scores = evaluate_tracking(truth, result_of([INSIDE, INSIDE, (50, 50, 60, 60)]))
    assert scores.left_out.pop("truth: not to be found (ignored, a distractor or another class)") == 1
    assert scores.left_out == {"result: on a distractor": 1, LEFT_OUT: 1}
    assert (scores.clear.true_positives, scores.clear.false_positives) == (1, 0)


def test_true_box_of_another_class_is_no_match():
    """As in KITTI, where it is not there; outside of regions a result on it is wrong."""
    other = (50, 50, 60, 60)
    truth = truth_of([INSIDE, other, (80, 80, 90, 90)], [REGION])
    truth = replace(truth, labels=np.array([1, 1, 0])).of_class(0)
    scores = evaluate_tracking(truth, result_of([INSIDE, other]))
    assert scores.left_out[LEFT_OUT] == 1
    assert (scores.clear.false_positives, scores.clear.misses) == (1, 1)


def test_result_in_a_frame_without_truth_is_left_out_once():
    truth = truth_of([(50, 50, 60, 60)], [REGION])
    scores = evaluate_tracking(truth, result_of([INSIDE], frames=2))
    assert scores.left_out == {LEFT_OUT: 1, "result: in a frame without truth": 1}


def random_case(seed: int) -> tuple[TrackingTruth, TrackingResult, np.ndarray]:
    """Random tracks, up to three regions, and of each true row its kind: counted, distractor or of another class."""
    rng = np.random.default_rng(seed)
    truth, result = values_of(random_frames(seed))
    kinds = rng.choice([*KITTI_CLASSES], 20, p=[0.7, 0.15, 0.15])[truth.ids]
    corner = np.rint(rng.uniform(-10, 60, (int(rng.integers(1, 4)), 2)) / 5) * 5  # on the grid of coarse boxes
    regions = np.hstack([corner, corner + np.rint(rng.uniform(1, 8, corner.shape)) * 5])
    truth = replace(truth, is_counted=kinds == "car", is_distractor=kinds == "van", ignored=regions)
    return truth, result, kinds


def test_figures_equal_trackevals_for_kitti_on_500_random_sequences():
    faults: list[str] = []
    left_out = 0
    for seed in range(500):
        truth, result, kinds = random_case(seed)
        scores = evaluate_tracking(truth, result)
        faults += [f"seed {seed}: {fault}" for fault in differences(kitti_figures(truth, result, kinds), scores)]
        boxes = scores.counts.truth_boxes + scores.counts.result_boxes
        assert boxes + sum(scores.left_out.values()) == len(truth) + len(result)
        left_out += scores.left_out.get(LEFT_OUT, 0)
    assert faults == []
    assert left_out > 1000


def test_regions_without_results_change_nothing():
    for seed in range(40):
        truth, result = values_of(random_frames(seed))
        truth = replace(truth, is_counted=truth.ids % 3 > 0, is_distractor=truth.ids % 3 == 0)
        plain = evaluate_tracking(truth, result)
        far = evaluate_tracking(replace(truth, ignored=np.array([[9000, 0, 9100, 100.0]])), result)
        assert (far.clear, far.identity, far.counts, far.left_out) == (
            plain.clear,
            plain.identity,
            plain.counts,
            plain.left_out,
        )
        assert far.hota.hota_by_alpha.tobytes() == plain.hota.hota_by_alpha.tobytes()


def test_what_is_left_out_adds_up_over_sequences():
    one = scores_of([], [INSIDE], [REGION], frames=3)
    assert combine([one, one]).left_out == {LEFT_OUT: 6}
