"""The matches box by box: what they say adds up to the figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluation.tracking.trackeval_oracle import random_frames, values_of
from lookonce.evaluation import TrackingResult, TrackingTruth, evaluate_tracking
from lookonce.evaluation.tracking.following import follow

SIZE = 10.0


def make_truth(rows: list[tuple[int, int, float]], frames: int) -> TrackingTruth:
    """Rows of frame, id, left."""
    columns = np.array(rows, np.float64).reshape(-1, 3)
    every = np.ones(len(rows), np.bool_)
    frame, ids = (columns[:, column].astype(np.int64) for column in (0, 1))
    return TrackingTruth(np.arange(frames), frame, ids, boxes(columns[:, 2]), ids * 0, every, ~every)


def make_result(rows: list[tuple[int, int, float]]) -> TrackingResult:
    columns = np.array(rows, np.float64).reshape(-1, 3)
    frame, ids = (columns[:, column].astype(np.int64) for column in (0, 1))
    return TrackingResult(frame, ids, boxes(columns[:, 2]), ids * 0)


def boxes(left: np.ndarray) -> np.ndarray:
    return np.column_stack([left, left * 0 + 1, left + SIZE, left * 0 + 1 + SIZE])


def counts(truth, result, protocol):
    scores = evaluate_tracking(truth, result, protocol)
    clear = scores if protocol == "detrac" else scores.clear
    return clear.true_positives, clear.misses, clear.false_positives, clear.id_switches


@pytest.mark.parametrize("protocol", ["trackeval", "detrac"])
@pytest.mark.parametrize("with_distractors", [False, True])
def test_counts_are_those_of_the_figures(protocol, with_distractors):
    switches = 0
    for seed in range(150):
        truth, result = values_of(random_frames(seed))
        if with_distractors:
            chosen = np.random.default_rng(seed).random(len(truth)) < 0.3
            truth = replace(truth, is_counted=truth.is_counted & ~chosen, is_distractor=truth.is_distractor | chosen)
            truth = replace(truth, ignored=np.array([[0, 0, 40, 40.0]]))
        found = follow(truth, result, protocol)
        hits = int((found.partners >= 0).sum())
        assert (hits, len(found.missed), len(found.wrong), len(found.switches)) == counts(truth, result, protocol)
        switches += len(found.switches)
    assert switches > 20


@pytest.mark.parametrize("protocol", ["trackeval", "detrac"])
def test_partners_lie_in_the_same_frame_and_on_the_object(protocol):
    for seed in range(50):
        truth, result = values_of(random_frames(seed))
        found = follow(truth, result, protocol)
        hit = found.partners >= 0
        mine, theirs = found.truth_rows[hit], found.partners[hit]
        assert (truth.row_frames[mine] == result.row_frames[theirs]).all()
        distance = np.abs(truth.xyxy[mine, :2] - result.xyxy[theirs, :2]).max(axis=1, initial=0)
        size = np.maximum(truth.xyxy[mine, 2:] - truth.xyxy[mine, :2], 1).max(axis=1, initial=0)
        assert (distance <= size + 1).all()


@pytest.mark.parametrize("protocol", ["trackeval", "detrac"])
def test_switch_names_the_last_match_before_and_the_match_after(protocol):
    truth = make_truth([(frame, 4, 1.0) for frame in range(6)], 6)
    result = make_result([(0, 70, 1.0), (1, 70, 1.0), (4, 9, 1.0), (5, 9, 1.0)])
    found = follow(truth, result, protocol)
    ((before, after),) = found.switches.tolist()
    assert truth.row_frames[found.truth_rows[[before, after]]].tolist() == [1, 4]
    assert result.ids[found.partners[[before, after]]].tolist() == [70, 9]
    assert truth.row_frames[found.missed].tolist() == [2, 3]


def test_ids_are_those_of_rows_that_take_part_where_others_are_left_out():
    """The row on the distractor comes first, so that rows move up."""
    truth = make_truth([(0, 1, 1.0), (0, 2, 50.0)], 1)
    truth = replace(truth, is_counted=np.array([False, True]), is_distractor=np.array([True, False]))
    found = follow(truth, make_result([(0, 5, 1.0), (0, 6, 50.0), (0, 8, 90.0)]))
    assert found.truth_rows.tolist() == [1]
    assert found.partners.tolist() == [1]
    assert found.result_rows.tolist() == [1, 2]
    assert found.wrong.tolist() == [2]


def test_boxes_in_ignored_regions_take_no_part_under_detrac():
    truth = make_truth([(0, 1, 1.0), (0, 2, 50.0)], 1)
    truth = replace(truth, ignored=np.array([[0, 0, 30, 30.0]]))
    found = follow(truth, make_result([(0, 5, 1.0), (0, 6, 50.0)]), "detrac")
    assert (found.truth_rows.tolist(), found.result_rows.tolist(), found.partners.tolist()) == ([1], [1], [1])


def test_results_in_ignored_regions_take_no_part_under_trackeval_unless_they_are_matched():
    truth = make_truth([(0, 1, 1.0), (0, 2, 50.0)], 1)
    truth = replace(truth, ignored=np.array([[0, 0, 30, 30.0]]))
    found = follow(truth, make_result([(0, 4, 15.0), (0, 5, 1.0), (0, 6, 50.0), (0, 7, 90.0)]))
    assert (found.truth_rows.tolist(), found.partners.tolist()) == ([0, 1], [1, 2])
    assert (found.result_rows.tolist(), found.wrong.tolist()) == ([1, 2, 3], [3])


def test_nothing_and_no_protocol():
    empty = follow(make_truth([], 3), make_result([]))
    assert [len(part) for part in (empty.truth_rows, empty.result_rows, empty.partners, empty.switches)] == [0] * 4
    assert follow(make_truth([], 3), make_result([(0, 1, 5.0)])).wrong.tolist() == [0]
    assert follow(make_truth([(0, 1, 5.0)], 3), make_result([])).missed.tolist() == [0]
    with pytest.raises(ValueError, match="protocol"):
        follow(make_truth([], 3), make_result([]), "mine")
