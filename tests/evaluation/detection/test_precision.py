import math

import numpy as np
import pytest

from evaluation.coco_oracle import boxes, coco_evaluation, make_found, make_truth, random_pictures
from lookonce.evaluation import DetectionTruth, average_precision

CASES = 400
FIGURES = (
    "ap ap50 ap75 ap_small ap_medium ap_large recall_1 recall_10 recall recall_small recall_medium recall_large"
).split()
A, B, C = (0, 0, 10, 10), (20, 0, 30, 10), (40, 0, 50, 10)
NOWHERE = (200, 200, 210, 210)


def _figures(row):
    return np.array([getattr(row, name) for name in FIGURES])


def _names(count):
    return [f"class {number}" for number in range(count)]


def _same(left, right):
    return all(
        np.array_equal(_figures(a), _figures(b), equal_nan=True) and a.boxes == b.boxes
        for a, b in zip((*left.classes, left.mean), (*right.classes, right.mean), strict=True)
    )


@pytest.mark.parametrize("first", range(0, CASES, 50))
def test_figures_are_those_of_cocos_program(first):
    for seed in range(first, first + 50):
        truths, detections, classes = random_pictures(seed)
        oracle = coco_evaluation(truths, detections, classes)
        scores = average_precision(truths, detections, _names(classes))
        np.testing.assert_allclose(
            np.nan_to_num(_figures(scores.mean), nan=-1), oracle.stats, rtol=0, atol=1e-12, err_msg=f"seed {seed}"
        )
        expected = oracle.eval["precision"][..., -1].transpose(2, 3, 0, 1)  # (T, R, K, A) -> (K, A, T, R)
        np.testing.assert_allclose(np.nan_to_num(scores.precision, nan=-1), expected, rtol=0, atol=1e-12)
        recalls = oracle.eval["recall"].mean(axis=0)  # (K, A, M)
        for row, expected in zip(scores.classes, recalls, strict=True):
            found = [row.recall_1, row.recall_10, row.recall, row.recall_small, row.recall_medium, row.recall_large]
            stated = [*expected[0], *expected[1:, 2]]
            np.testing.assert_allclose(np.nan_to_num(found, nan=-1), stated, rtol=0, atol=1e-12)


def test_the_random_pictures_have_every_hard_case():
    pictures = [random_pictures(seed) for seed in range(CASES)]
    flat = [
        (truth, found) for truths, detections, _ in pictures for truth, found in zip(truths, detections, strict=True)
    ]
    assert any(truth.is_crowd.any() for truth, _ in flat)
    assert any(not len(truth) and len(found) for truth, found in flat)
    assert any(len(truth) and not len(found) for truth, found in flat)
    assert any(not len(truth) and not len(found) for truth, found in flat)
    assert any(len(found) and np.bincount(found.labels).max() > 100 for _, found in flat)
    assert any(len(np.unique(found.scores)) < len(found) for _, found in flat)
    assert any(
        set(range(classes)) - {int(label) for truth in truths for label in truth.labels}
        for truths, _, classes in pictures
    )
    assert any(math.isnan(row.ap) for row in average_precision(*pictures[0][:2], _names(9)).classes)


def test_fewer_detections_may_be_asked_for():
    truths, detections, classes = random_pictures(1)
    scores = average_precision(truths, detections, _names(classes), max_detections=10)
    assert 0 < scores.mean.recall == scores.mean.recall_10
    assert average_precision(truths, detections, _names(classes), max_detections=1).mean.recall == scores.mean.recall_1


@pytest.mark.parametrize(
    ("found", "ap50", "recall"),
    [
        pytest.param([(A, 0.9), (B, 0.8)], 1, 1, id="perfect"),
        pytest.param([(A, 0.9)], 51 / 101, 0.5, id="half"),
        pytest.param([(A, 0.9), (A, 0.8)], 51 / 101, 0.5, id="twice"),
        pytest.param([(NOWHERE, 0.9), (A, 0.8), (B, 0.7)], 2 / 3, 1, id="a-wrong-one-first"),
        pytest.param([(A, 0.9), (NOWHERE, 0.8), (B, 0.7)], (51 + 50 * 2 / 3) / 101, 1, id="a-wrong-one-between"),
        pytest.param([(A, 0.9), (B, 0.8), (NOWHERE, 0.7)], 1, 1, id="a-wrong-one-last"),
        pytest.param([(NOWHERE, 0.9)], 0, 0, id="wrong"),
        pytest.param([], 0, 0, id="nothing-found"),
    ],
)
def test_precision_of_a_picture_of_two_boxes(found, ap50, recall):
    detections = make_found([box for box, _ in found], [score for _, score in found], [0] * len(found))
    scores = average_precision([make_truth([A, B], [0, 0])], [detections], ["car"])
    (row,) = scores.classes
    assert (row.name, row.boxes) == ("car", 2)
    assert (row.ap50, row.ap, row.ap_small, row.recall) == pytest.approx((ap50, ap50, ap50, recall))
    assert math.isnan(row.ap_medium)
    assert math.isnan(row.recall_large)


def test_overlap_decides_at_which_thresholds_a_detection_is_right():
    found = make_found([(0, 0, 10, 7)], [0.9], [0])  # overlap 0.7: right at 0.50, 0.55, 0.60, 0.65, 0.70
    (row,) = average_precision([make_truth([A], [0])], [found], ["car"]).classes
    assert (row.ap50, row.ap75, row.ap, row.recall) == pytest.approx((1, 0, 0.5, 0.5))


def test_of_two_true_boxes_overlapped_equally_the_later_one_is_taken():
    """As COCO's program has it, so that here the second detection is left without a box."""
    truths = [make_truth([(0, 0, 10, 10), (4, 0, 14, 10)], [0, 0])]
    detections = [make_found([(2, 0, 12, 10), (4, 0, 14, 10)], [0.9, 0.8], [0, 0])]
    (row,) = average_precision(truths, detections, ["car"]).classes
    assert row.ap50 == pytest.approx(51 / 101)
    assert row.ap50 == pytest.approx(coco_evaluation(truths, detections, 1).stats[1])


def test_nothing_at_all_gives_no_figures():
    for truths, detections, names in (
        ([], [], []),
        ([], [], ["car"]),
        ([make_truth([], [])], [make_found([], [], [])], ["car"]),
        ([make_truth([], [])], [make_found([A], [0.5], [0])], ["car"]),
    ):
        scores = average_precision(truths, detections, names)
        assert np.isnan(_figures(scores.mean)).all()
        assert scores.mean.boxes == 0
        assert np.isnan(scores.precision).all()


def test_detections_in_a_crowd_are_neither_right_nor_wrong():
    truth = make_truth([A, (100, 100, 200, 200)], [0, 0], is_crowd=np.array([False, True]))
    inside = [(110, 110, 120, 120), (112, 110, 122, 120), (95, 150, 105, 160)]  # the last one by half
    (row,) = average_precision([truth], [make_found([*inside, A], [0.9, 0.8, 0.7, 0.6], [0] * 4)], ["car"]).classes
    assert (row.boxes, row.ap50) == (1, 1.0)
    other = make_found([*inside, A], [0.9, 0.8, 0.7, 0.6], [1, 0, 0, 0])
    scores = average_precision([truth, make_truth([A], [1])], [other, make_found([A], [0.5], [1])], ["car", "bus"])
    assert [row.ap50 for row in scores.classes] == pytest.approx([1.0, 0.5])


def test_classes_that_a_picture_does_not_label_do_not_count_there():
    found = make_found([A, B, C], [0.9, 0.8, 0.7], [0, 1, 1])
    cars_only = make_truth([A], [0], labelled_classes=frozenset({0}))
    both = make_truth([A, B], [0, 1])
    scores = average_precision([cars_only, both], [found, found], ["car", "person"])
    assert [row.ap50 for row in scores.classes] == pytest.approx([1, 1])
    everything = average_precision([make_truth([A], [0]), both], [found, found], ["car", "person"])
    assert everything.classes[1].ap50 == pytest.approx(0.5)
    nothing = make_truth([], [], labelled_classes=frozenset())
    assert _same(average_precision([nothing, both], [found, found], ["car", "person"]), scores) is False
    assert math.isnan(average_precision([nothing], [found], ["car", "person"]).mean.ap)


def test_classes_may_count_as_one():
    truth = make_truth([A, B, C], [1, 3, 0])
    found = make_found([A, A, B, C], [0.9, 0.8, 0.7, 0.6], [3, 1, 2, 0])
    scores = average_precision([truth], [found], ["person", "car", "bus", "truck"], as_one_class=[3, 1, 2])
    assert [(row.name, row.boxes) for row in scores.classes] == [("person", 1), ("car+bus+truck", 2)]
    assert scores.classes[0].ap50 == 1
    assert scores.classes[1].ap50 == pytest.approx((51 + 50 * 2 / 3) / 101)  # the car found twice is wrong once


@pytest.mark.parametrize("seed", range(5))
def test_one_class_of_several_equals_labels_that_were_equal_from_the_start(seed):
    truths, detections, classes = random_pictures(seed)
    merged = average_precision(truths, detections, _names(classes), as_one_class=range(classes))
    truths = [make_truth(t.xyxy, 0 * t.labels, is_crowd=t.is_crowd) for t in truths]
    detections = [make_found(d.xyxy, d.scores, 0 * d.labels) for d in detections]
    assert _same(merged, average_precision(truths, detections, ["any"]))


def test_unlabelled_classes_are_left_out_before_classes_become_one():
    truth = make_truth([A], [0], labelled_classes=frozenset({0, 2}))
    found = make_found([B, A], [0.9, 0.8], [1, 0])
    scores = average_precision([truth], [found], ["car", "bus", "person"], as_one_class=[0, 1])
    assert scores.classes[0].ap50 == 1


@pytest.mark.parametrize("seed", range(20, 40))
def test_order_of_pictures_does_not_matter(seed):
    truths, detections, classes = random_pictures(seed)
    rng = np.random.default_rng(seed)
    distinct = iter(rng.permutation(sum(map(len, detections))))
    detections = [make_found(d.xyxy, [next(distinct) / 1e4 for _ in d.labels], d.labels) for d in detections]
    order = rng.permutation(len(truths))
    shuffled = average_precision([truths[n] for n in order], [detections[n] for n in order], _names(classes))
    assert _same(shuffled, average_precision(truths, detections, _names(classes)))


@pytest.mark.parametrize("seed", range(40, 60))
def test_order_of_rows_does_not_matter_without_ties(seed):
    truths, detections, classes = random_pictures(seed)
    rng = np.random.default_rng(seed)
    detections = [make_found(d.xyxy, rng.permutation(len(d)) / 1e4, d.labels) for d in detections]
    shuffled = [d[rng.permutation(len(d))] for d in detections]
    names = _names(classes)
    assert _same(average_precision(truths, shuffled, names), average_precision(truths, detections, names))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        pytest.param({"xyxy": np.zeros((1, 3), np.float32)}, "xyxy: expected", id="shape"),
        pytest.param({"xyxy": np.array([[0, 0, np.nan, 1]], np.float32)}, "xyxy: expected finite", id="nan"),
        pytest.param({"xyxy": np.zeros((1, 4), np.float32)}, "negative size", id="empty-box"),
        pytest.param({"labels": np.array([0, 1])}, r"labels: expected \(1,\)", id="rows"),
        pytest.param({"labels": np.array([0.0])}, "labels: expected", id="dtype"),
        pytest.param({"labels": np.array([-1])}, "labels: expected 0 or more", id="negative"),
        pytest.param({"is_crowd": np.array([1])}, "is_crowd: expected", id="crowd-dtype"),
        pytest.param({"is_crowd": np.array([True, False])}, "is_crowd: expected", id="crowd-rows"),
        pytest.param({"is_crowd": None}, "is_crowd: expected", id="crowd-none"),
        pytest.param({"labelled_classes": frozenset({1})}, "expected labelled classes", id="unlabelled"),
    ],
)
def test_bad_truth_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        DetectionTruth(**({"xyxy": boxes(A), "labels": np.array([0])} | fields))


@pytest.mark.parametrize(
    ("pictures", "classes", "settings", "message"),
    [
        pytest.param(2, ["car"], {}, "detections: expected 1", id="lengths"),
        pytest.param(1, [], {}, "classes: expected names of labels 0 to 0, got 0", id="no-names"),
        pytest.param(1, ["car"], {"max_detections": 0}, "max_detections", id="no-detections"),
        pytest.param(1, ["car"], {"as_one_class": [0, 1]}, "as_one_class", id="unknown-class"),
        pytest.param(1, ["car"], {"as_one_class": [-1]}, "as_one_class", id="negative-class"),
    ],
)
def test_bad_calls_are_refused(pictures, classes, settings, message):
    found = make_found([A], [0.5], [0])
    with pytest.raises(ValueError, match=message):
        average_precision([make_truth([A], [0])], [found] * pictures, classes, **settings)


def test_detections_with_negative_labels_are_refused():
    with pytest.raises(ValueError, match="labels of 0 or more"):
        average_precision([make_truth([A], [0])], [make_found([A], [0.5], [-1])], ["car"])
