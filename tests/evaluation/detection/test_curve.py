import math

import numpy as np
import pytest

from evaluation.coco_oracle import make_found, make_truth, random_pictures
from lookonce.boxes import iou
from lookonce.evaluation import average_precision, precision_recall

A, B, C = (0, 0, 10, 10), (20, 0, 30, 10), (40, 0, 50, 10)
NOWHERE = (200, 200, 210, 210)


def _curve(found, truth=(A, B), **settings):
    detections = make_found([box for box, _ in found], [score for _, score in found], [0] * len(found))
    return precision_recall([make_truth(truth, [0] * len(truth))], [detections], [0], **settings)


def test_curve_has_a_point_for_each_detection():
    curve = _curve([(B, 0.5), (A, 0.9), (NOWHERE, 0.7)])
    assert curve.scores.tolist() == pytest.approx([0.9, 0.7, 0.5])
    assert curve.recall.tolist() == [0.5, 0.5, 1]
    assert curve.precision.tolist() == pytest.approx([1, 0.5, 2 / 3])
    assert curve.boxes == 2
    assert curve.area() == pytest.approx(0.5 + 0.5 * 2 / 3)


def test_curve_of_nothing_is_empty():
    curve = precision_recall([], [], [0])
    assert len(curve.recall) == len(curve.precision) == len(curve.scores) == curve.boxes == 0
    assert math.isnan(curve.area())
    assert curve.best_f1().f1 == 0
    assert math.isnan(_curve([(A, 0.5)], truth=()).area())
    missed = _curve([])
    assert (missed.boxes, missed.area(), missed.best_f1().threshold) == (2, 0, math.inf)
    assert _curve([(NOWHERE, 0.5)]).area() == 0
    assert _curve([(NOWHERE, 0.5)]).best_f1().threshold == math.inf


def test_best_threshold_keeps_the_right_rows():
    point = _curve([(A, 0.9), (B, 0.8), (NOWHERE, 0.4), (C, 0.3)]).best_f1()
    assert (point.precision, point.recall, point.f1) == (1, 1, 1)
    assert point.threshold == pytest.approx(0.6)
    last = _curve([(NOWHERE, 0.9), (A, 0.8), (B, 0.4)]).best_f1()
    assert (last.threshold, last.precision, last.f1) == pytest.approx((0.2, 2 / 3, 0.8))


def test_best_threshold_does_not_part_equal_scores():
    point = _curve([(A, 0.9), (B, 0.5), (NOWHERE, 0.5), (C, 0.5)]).best_f1()
    assert point.threshold == pytest.approx(0.7)
    assert (point.precision, point.recall) == (1, 0.5)


def test_least_overlap_can_be_chosen():
    nearly = [((0, 0, 10, 6), 0.9)]  # overlap 0.6
    assert _curve(nearly, truth=[A]).area() == 1
    assert _curve(nearly, truth=[A], min_iou=0.7).area() == 0
    assert _curve(nearly, truth=[A], min_iou=0.59).area() == 1


def test_only_the_surest_detections_count_where_few_are_asked_for():
    found = [(NOWHERE, 0.9), (A, 0.8), (B, 0.7)]
    assert _curve(found, max_detections=2).recall.tolist() == [0, 0.5]


def test_detections_that_do_not_count_are_not_on_the_curve():
    truth = make_truth([A, (100, 100, 200, 200)], [0, 0], is_crowd=np.array([False, True]))
    found = make_found([(110, 110, 120, 120), A, B], [0.9, 0.8, 0.7], [0, 0, 1])
    curve = precision_recall([truth], [found], [0])
    assert curve.scores.tolist() == pytest.approx([0.8])
    assert curve.boxes == 1
    cars_only = make_truth([A], [0], labelled_classes=frozenset({0}))
    assert len(precision_recall([cars_only], [make_found([A, B], [0.9, 0.8], [0, 1])], [0, 1]).scores) == 1


@pytest.mark.parametrize("seed", range(30))
def test_curve_and_figures_agree(seed):
    truths, detections, classes = random_pictures(seed)
    scores = average_precision(truths, detections, [str(label) for label in range(classes)])
    for label, row in enumerate(scores.classes):
        curve = precision_recall(truths, detections, [label], max_detections=100)
        assert curve.boxes == row.boxes
        if row.boxes:
            assert curve.area() == pytest.approx(row.ap50, abs=0.02 + 0.5 / row.boxes)
            assert curve.recall.max(initial=0) >= row.recall


def _plain_area(truths, detections, least):
    """All rows as one class, each true box taken once: the definition, one detection at a time."""
    hits, scores, total = [], [], sum(map(len, truths))
    for truth, found in zip(truths, detections, strict=True):
        overlap = iou(found.xyxy.astype(np.float64), truth.xyxy.astype(np.float64))
        for row in np.argsort(-found.scores, kind="stable"):
            best = int(np.argmax(overlap[row])) if len(truth) else -1
            hits.append(best >= 0 and overlap[row, best] >= least)
            scores.append(found.scores[row])
            if hits[-1]:
                overlap[:, best] = -1
    ordered = np.array(hits, bool)[np.argsort(-np.array(scores), kind="stable")]
    recall, precision = np.cumsum(ordered) / total, np.cumsum(ordered) / np.arange(1, len(ordered) + 1)
    steps = [(recall[n] - (recall[n - 1] if n else 0)) * precision[n:].max() for n in range(len(ordered))]
    return sum(steps)


@pytest.mark.parametrize("min_iou", [0.3, 0.5, 0.75])
@pytest.mark.parametrize("seed", range(10))
def test_area_matches_its_definition(seed, min_iou):
    truths, detections, classes = random_pictures(seed)
    truths = [*(make_truth(t.xyxy, t.labels) for t in truths), make_truth([A], [0])]
    detections = [*detections, make_found([A], [0.5], [0])]
    curve = precision_recall(truths, detections, range(classes), min_iou=min_iou)
    assert curve.area() == pytest.approx(_plain_area(truths, detections, min_iou), abs=1e-12)


@pytest.mark.parametrize(
    ("labels", "settings", "message"),
    [
        pytest.param([], {}, "labels", id="no-class"),
        pytest.param([-1], {}, "labels", id="negative-class"),
        pytest.param([0], {"min_iou": 0}, "min_iou", id="no-overlap"),
        pytest.param([0], {"min_iou": 1.0}, "min_iou", id="whole-overlap"),
        pytest.param([0], {"min_iou": math.nan}, "min_iou", id="nan"),
        pytest.param([0], {"max_detections": 0}, "max_detections", id="no-detections"),
    ],
)
def test_bad_calls_are_refused(labels, settings, message):
    with pytest.raises(ValueError, match=message):
        precision_recall([make_truth([A], [0])], [make_found([A], [0.5], [0])], labels, **settings)


def test_lengths_that_differ_are_refused():
    with pytest.raises(ValueError, match="detections: expected 1"):
        precision_recall([make_truth([A], [0])], [], [0])
