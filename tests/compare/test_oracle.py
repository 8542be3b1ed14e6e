"""The ceiling of association."""

from __future__ import annotations

import numpy as np

from compare.moving import lane, make_sequence, nothing
from lookonce.compare.oracle import oracle_ids
from lookonce.evaluation import TrackingResult, TrackingTruth, evaluate_tracking


def truth_of(frames, ids, boxes, counted=None):
    count = len(ids)
    every = np.ones(count, bool) if counted is None else np.array(counted)
    return TrackingTruth(
        np.arange(12), np.array(frames), np.array(ids), np.array(boxes, float).reshape(-1, 4),
        np.zeros(count, np.int64), every, np.zeros(count, bool),
    )  # fmt: skip


def test_oracle_makes_no_mistake_of_association():
    sequence, owners = make_sequence([lane(0), lane(100)], mixed=True)
    truth = truth_of(sequence.row_frames, owners + 5, sequence.xyxy + 2)
    ids = oracle_ids(sequence, truth)
    assert np.array_equal(ids, owners + 6)
    scores = evaluate_tracking(
        truth, TrackingResult(sequence.row_frames, ids, sequence.xyxy.astype(float), sequence.labels)
    )
    assert scores.identity.idf1 == 1


def test_most_pairs_come_before_the_largest_overlap():
    """One detection overlaps both objects: it goes to the one that no other detection finds."""
    sequence, _ = make_sequence([lane(0, 0), lane(0, 6)], frames=1)  # boxes 0..20 and 6..26
    truth = truth_of([0, 0], [1, 2], [[5, 0, 25, 40], [12, 0, 32, 40]])
    assert oracle_ids(sequence, truth).tolist() == [2, 3]


def test_half_is_enough_and_less_is_not():
    sequence, _ = make_sequence([lane(0)], frames=1)
    assert oracle_ids(sequence, truth_of([0], [1], [[0, 0, 20, 80]])).tolist() == [2]
    assert oracle_ids(sequence, truth_of([0], [1], [[0, 0, 20, 81]])).tolist() == [-1]


def test_rows_that_do_not_count_give_no_identity():
    sequence, _ = make_sequence([lane(0)], frames=1)
    other = [[0, 0, 20, 40], [500, 0, 520, 40]]
    assert oracle_ids(sequence, truth_of([0, 0], [1, 2], other, [False, True])).tolist() == [-1]


def test_no_detections_and_no_truth():
    assert oracle_ids(nothing(), truth_of([0], [1], [[0, 0, 9, 9]])).tolist() == []
    sequence, _ = make_sequence([lane(0)], frames=2)
    assert oracle_ids(sequence, truth_of([5], [1], [[0, 0, 9, 9]])).tolist() == [-1, -1]
