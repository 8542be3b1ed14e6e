"""A result from a tracker's answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lookonce.evaluation.tracking.collecting import ResultCollector
from lookonce.structures import Filled, GivenBack, Tracks

NOBODY, NOTHING = np.zeros(0, np.int64), np.zeros((0, 4), np.float32)


def tracks(ids, labels=None, back=()):
    """Rows at their place times ten; ``back``: frame, id and label of each row that is given back, at 100."""
    count = len(ids)
    left = np.arange(count, dtype=np.float32) * 10
    xyxy = np.stack([left, left, left + 5, left + 8], axis=1)
    columns = np.array(back, np.int64).reshape(-1, 3)
    given = GivenBack(
        columns[:, 0],
        np.arange(len(columns)),
        columns[:, 1],
        np.tile(np.array([[100, 100, 110, 120]], np.float32), (len(columns), 1)),
        np.full(len(columns), 0.5, np.float32),
        columns[:, 2],
    )
    scores = np.full(count, 0.5, np.float32)
    kinds = np.array(labels or [0] * count, np.int64)
    return Tracks(np.array(ids, np.int64), xyxy, scores, kinds, NOBODY, NOTHING, given_back=given)


def test_nothing_added_is_a_result_without_rows():
    result = ResultCollector().result()
    assert (len(result.row_frames), result.xyxy.shape, result.left_out) == (0, (0, 4), {})


def test_rows_with_an_id_are_taken_and_the_others_counted():
    collector = ResultCollector()
    collector.add(3, tracks([1, -1, 7], [4, 5, 6]))
    collector.add(9, tracks([-1]))
    collector.add(12, tracks([]))
    result = collector.result()
    assert (result.row_frames.tolist(), result.ids.tolist(), result.labels.tolist()) == ([3, 3], [1, 7], [4, 6])
    assert result.xyxy.tolist() == [[0, 0, 5, 8], [20, 20, 25, 28]]
    assert result.xyxy.dtype == np.float64
    assert result.left_out == {"no identity (yet)": 2}


def test_rows_given_back_belong_to_their_own_frames_and_are_not_left_out_any_more():
    collector = ResultCollector()
    collector.add(0, tracks([-1, -1]))
    collector.add(3, tracks([-1]))
    collector.add(6, tracks([1], [2], back=[(0, 1, 2), (3, 1, 2)]))
    result = collector.result()
    assert sorted(zip(result.row_frames.tolist(), result.ids.tolist(), strict=True)) == [(0, 1), (3, 1), (6, 1)]
    assert result.labels.tolist() == [2, 2, 2]
    assert result.xyxy[result.row_frames < 6].tolist() == [[100, 100, 110, 120]] * 2
    assert result.left_out == {"no identity (yet)": 1}


def test_all_given_back_leaves_nothing_out():
    collector = ResultCollector()
    collector.add(0, tracks([-1]))
    collector.add(1, tracks([5], back=[(0, 5, 0)]))
    assert collector.result().left_out == {}


def test_one_class_for_all():
    collector = ResultCollector()
    collector.add(0, tracks([1], [3], back=[(0, 2, 9)]))
    assert collector.result(one_class=True).labels.tolist() == [0, 0]
    assert collector.result().labels.tolist() == [3, 9]


def test_what_is_filled_in_is_part_of_the_result():
    collector = ResultCollector()
    filled = Filled(np.array([4]), np.array([1]), np.array([[1, 2, 3, 4]], np.float32), np.array([7]))
    collector.add(5, replace(tracks([1], [7]), filled=filled))
    result = collector.result()
    assert (result.row_frames.tolist(), result.ids.tolist(), result.labels.tolist()) == ([5, 4], [1, 1], [7, 7])
    assert result.xyxy[1].tolist() == [1, 2, 3, 4]
    assert result.left_out == {}
