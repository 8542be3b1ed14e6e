"""Misses and false boxes by size and place, and the curve of all detections."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lookonce.evaluation.tracking.following import follow
from lookonce.report.curves import Detected, detection_curve
from lookonce.report.mistakes import add_sizes, by_place, by_size
from report.scenes import boxes, lines_of, make_result, make_truth


def test_sizes_add_up():
    truth = make_truth({1: [0, 1], 2: [0, 1]}, 2)
    tall = truth.xyxy.copy()
    tall[truth.ids == 2, 3] += 190  # 200 px high
    truth = replace(truth, xyxy=tall)
    result = make_result([(0, 5, 1), (1, 6, 9)])
    sizes = by_size(truth, result, follow(truth, result))
    assert [(one.true, one.missed, one.wrong) for one in sizes] == [
        (2, 1, 1),
        (0, 0, 0),
        (0, 0, 0),
        (0, 0, 0),
        (2, 2, 0),
    ]
    assert (sizes[0].name, sizes[1].name, sizes[-1].name) == ("below 16 px", "16 to 32 px", "128 px and more")
    assert math.isinf(sizes[-1].most_px)
    both = add_sizes([sizes, sizes])
    assert (both[0].true, both[0].missed, both[0].wrong) == (4, 2, 2)


def test_places_are_cells_of_the_picture():
    xyxy = np.array([[0, 0, 2, 2], [958, 538, 960, 540], [958, 538, 962, 544], [-50, -50, -40, -40]], np.float64)
    grid = by_place(xyxy, (540, 960))
    assert grid.shape == (27, 48)
    assert (grid[0, 0], grid[26, 47], grid.sum()) == (2, 2, 4)
    assert by_place(np.zeros((0, 4)), (10, 10_000)).shape == (1, 48)
    assert by_place(np.zeros((0, 4)), (10_000, 10)).shape == (192, 48)


def detected(truth, result):
    lines = lines_of(result)
    return Detected(truth, lines, np.ones(len(lines.scores), np.bool_))


def test_curve_counts_hits_by_falling_score():
    truth = make_truth({1: [0, 1], 2: [0, 1]}, 2)
    result = make_result([(0, 5, 1), (0, 6, 9), (1, 5, 1), (1, 8, 2)])  # scores fall in this order
    curve = detection_curve([detected(truth, result)], "trackeval")
    assert curve.precision.tolist() == pytest.approx([1, 1 / 2, 2 / 3, 3 / 4])
    assert curve.recall.tolist() == pytest.approx([0.25, 0.25, 0.5, 0.75])
    assert curve.boxes == 4
    both = detection_curve([detected(truth, result)] * 2, "trackeval")
    assert both.boxes == 8


def test_detections_on_what_does_not_count_are_neither_right_nor_wrong():
    truth = make_truth({1: [0], 2: [0]}, 1)
    result = make_result([(0, 5, 1), (0, 6, 2)])
    distractor = replace(truth, is_counted=truth.ids == 1, is_distractor=truth.ids == 2)
    assert detection_curve([detected(distractor, result)], "trackeval").precision.tolist() == [1.0]
    ignored = replace(truth, is_counted=truth.ids == 1, ignored=np.array([[75.0, 0, 95, 20]]))
    for protocol in ("detrac", "trackeval"):
        assert detection_curve([detected(ignored, result)], protocol).precision.tolist() == [1.0]
    elsewhere = replace(ignored, ignored=ignored.ignored + 100)
    assert detection_curve([detected(elsewhere, result)], "trackeval").precision.tolist() == [1.0, 0.5]


def test_protocols_ask_for_different_overlaps():
    truth = make_truth({1: [0]}, 1)
    shifted = make_result([(0, 5, 1)])
    shifted = replace(shifted, xyxy=boxes([43.0]))  # IoU 7/13
    assert detection_curve([detected(truth, shifted)], "trackeval").recall.tolist() == [1.0]
    assert detection_curve([detected(truth, shifted)], "detrac").recall.tolist() == [0.0]


def test_no_truth_and_no_detections():
    truth, none = make_truth({1: [0]}, 1), make_result([])
    assert len(detection_curve([detected(truth, none)], "trackeval").scores) == 0
    assert detection_curve([detected(make_truth({}, 1), make_result([(0, 1, 1)]))], "trackeval").boxes == 0
