"""UA-DETRAC's protocol, rule by rule; where it differs from the usual one, both are asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluation.tracking.plain_detrac import plain_figures
from evaluation.tracking.trackeval_oracle import random_frames, values_of
from lookonce.errors import FormatError
from lookonce.evaluation import (
    TrackingResult,
    TrackingTruth,
    combine,
    evaluate_tracking,
    pr_average,
    pr_scores,
    read_detrac_truth,
)

Rows = dict[int, dict[int, tuple[float, float, float, float]]]
"""id -> frame -> ltwh."""

HERE = (100.0, 100.0, 100.0, 100.0)
FAR = (700.0, 300.0, 50.0, 50.0)


def shifted(iou: float) -> tuple[float, float, float, float]:
    """A box whose overlap with ``HERE`` is that, but for rounding."""
    return (100 + 100 * (1 - iou) / (1 + iou), 100.0, 100.0, 100.0)


def truth_of(rows: Rows, frames: int, ignored: object = ()) -> TrackingTruth:
    made = result_of(rows)
    every = np.ones(len(made), np.bool_)
    regions = np.array(ignored, np.float64).reshape(-1, 4)
    return TrackingTruth(np.arange(frames), made.row_frames, made.ids, made.xyxy, made.labels, every, ~every, regions)


def result_of(rows: Rows) -> TrackingResult:
    flat = [(frame, number, *box) for number, boxes in rows.items() for frame, box in boxes.items()]
    table = np.array(flat, np.float64).reshape(-1, 6)
    xyxy = np.hstack([table[:, 2:4], table[:, 2:4] + table[:, 4:]])
    whole = table[:, :2].astype(np.int64)
    return TrackingResult(whole[:, 0].copy(), whole[:, 1].copy(), xyxy, np.zeros(len(table), np.int64))


def both(truth: Rows, result: Rows, frames: int, ignored: object = ()):
    sides = truth_of(truth, frames, ignored), result_of(result)
    return evaluate_tracking(*sides, protocol="detrac"), evaluate_tracking(*sides, protocol="trackeval").clear


def always(box: tuple[float, float, float, float], *frames: int) -> dict[int, tuple[float, float, float, float]]:
    return dict.fromkeys(frames, box)


def test_figures_equal_those_of_the_plain_form_on_random_sequences():
    for seed in range(250):
        truth, result = values_of(random_frames(seed))
        rng = np.random.default_rng(seed)
        corner = rng.uniform(0, 60, (int(rng.integers(0, 4)), 2))
        regions = np.hstack([corner, corner + rng.uniform(2, 40, corner.shape)])
        truth = replace(truth, xyxy=truth.xyxy * 3, ignored=regions)
        result = replace(result, xyxy=result.xyxy * 3)
        ours, plain = evaluate_tracking(truth, result, "detrac"), plain_figures(truth, result, (400, 400))
        got = {
            **{"fp": ours.false_positives, "fn": ours.misses, "switches": ours.id_switches},
            **{"overlap": pytest.approx(ours.overlap_sum, abs=1e-9), "matches": ours.true_positives},
            **{"mt": ours.mostly_tracked, "pt": ours.partly_tracked, "ml": ours.mostly_lost},
            "frag": ours.fragmentations,
        }
        assert plain == got, seed
        boxes = ours.true_positives + ours.misses + ours.true_positives + ours.false_positives
        assert boxes + sum(ours.left_out.values()) == len(truth) + len(result)


@pytest.mark.parametrize(
    ("first", "second", "matches"),
    [
        pytest.param(0.71, 0.57, 2, id="new-and-held"),
        pytest.param(0.69, 0.69, 0, id="too-little-for-a-new-one"),
        pytest.param(0.71, 0.55, 1, id="too-little-to-hold"),
    ],
)
def test_new_match_needs_0_7_and_held_one_0_56(first, second, matches):
    scores, usual = both({1: always(HERE, 0, 1)}, {5: {0: shifted(first), 1: shifted(second)}}, 2)
    assert scores.true_positives == matches
    assert usual.true_positives == 2


def test_match_is_held_from_the_frame_before_only():
    scores, _ = both({1: always(HERE, 0, 1, 2)}, {5: {0: HERE, 2: shifted(0.6)}}, 3)
    assert scores.true_positives == 1


def test_largest_overlap_is_matched_first_though_two_matches_could_be_had():
    """5 lies best on 2; then nothing is left for 6, which could have had 2 if 5 had taken 1."""
    truth = {1: always(HERE, 0), 2: always((110.0, 100.0, 100.0, 100.0), 0)}
    found = {5: always((108.0, 100.0, 100.0, 100.0), 0), 6: always((127.0, 100.0, 100.0, 100.0), 0)}
    scores, usual = both(truth, found, 1)
    assert (scores.true_positives, usual.true_positives) == (1, 2)
    assert scores.motp > 0.95


def test_precision_counts_the_overlap_of_0_7_or_more_over_all_matches():
    scores, usual = both({1: always(HERE, 0, 1)}, {5: {0: HERE, 1: shifted(0.6)}}, 2)
    assert scores.motp == pytest.approx(0.5)
    assert usual.motp == pytest.approx(0.8, abs=0.01)


def test_accuracy_counts_misses_false_positives_and_switches():
    truth = {1: always(HERE, 0, 1, 2, 3)}
    found = {5: always(HERE, 0, 1), 6: always(HERE, 2), 7: always(FAR, 0)}
    scores, _ = both(truth, found, 4)
    assert (scores.misses, scores.false_positives, scores.id_switches) == (1, 1, 1)
    assert scores.mota == pytest.approx(1 - 3 / 4)
    assert scores.motal == pytest.approx(1 - (2 + np.log10(2)) / 4)
    assert (scores.recall, scores.precision, scores.false_positives_per_frame) == (0.75, 0.75, 0.25)


def test_switch_counts_only_if_the_object_was_there_in_the_frame_before():
    found = {5: always(HERE, 0, 1), 6: always(HERE, 3, 4)}
    absent, usual = both({1: always(HERE, 0, 1, 3, 4)}, found, 5)
    assert (absent.id_switches, usual.id_switches) == (0, 1)
    present, usual = both({1: always(HERE, 0, 1, 2, 3, 4)}, found, 5)
    assert (present.id_switches, usual.id_switches) == (1, 1)


def test_object_comes_back_after_a_gap_of_the_tracker_with_the_best_overlap():
    """Track 5 is lost in frame 1. In frame 2 it is back, and another box overlaps more."""
    found = {5: {0: HERE, 2: shifted(0.75)}, 6: {2: shifted(0.9)}}
    gap_is_empty, usual = both({1: always(HERE, 0, 1, 2)}, found, 3)
    assert (gap_is_empty.id_switches, usual.id_switches) == (1, 0)
    others = found | {7: always(FAR, 0, 1, 2)}
    gap_has_boxes, usual = both({1: always(HERE, 0, 1, 2)}, others, 3)
    assert (gap_has_boxes.id_switches, usual.id_switches) == (1, 1)


def test_frame_without_any_box_of_the_tracker_is_a_fragmentation():
    scores, usual = both({1: always(HERE, 0, 1, 2)}, {5: always(HERE, 0, 2)}, 3)
    assert (scores.fragmentations, usual.fragmentations) == (1, 0)


def test_frame_in_which_the_object_is_not_annotated_is_a_fragmentation():
    """Nobody is there to be found in frame 1, nor is there a box."""
    scores, usual = both({1: always(HERE, 0, 2)}, {5: always(HERE, 0, 2)}, 3)
    assert (scores.fragmentations, usual.fragmentations) == (1, 0)


def test_being_lost_for_good_is_no_fragmentation():
    scores, _ = both({1: always(HERE, 0, 1, 2, 3)}, {5: always(HERE, 1, 2)}, 4)
    assert scores.fragmentations == 0


def test_box_of_negative_width_is_left_out():
    scores, usual = both({1: always(HERE, 0)}, {5: always(HERE, 0), 6: always((300.0, 50.0, -20.0, 30.0), 0)}, 1)
    assert (scores.false_positives, usual.false_positives) == (0, 1)
    assert scores.left_out == {"result: zero or negative size": 1}


@pytest.mark.parametrize(
    ("tracked", "expected"),
    [
        pytest.param(8, (0, 1, 0), id="80-percent-is-partly"),
        pytest.param(9, (1, 0, 0), id="more-is-mostly"),
        pytest.param(2, (0, 1, 0), id="20-percent-is-partly"),
        pytest.param(1, (0, 0, 1), id="less-is-lost"),
    ],
)
def test_shares_of_mostly_tracked_and_lost(tracked, expected):
    scores, _ = both({1: always(HERE, *range(10))}, {5: always(HERE, *range(tracked))}, 10)
    assert (scores.mostly_tracked, scores.partly_tracked, scores.mostly_lost) == expected


def test_result_half_in_an_ignored_region_is_left_out_one_by_one():
    """Pixels 101 to 200 are the box's, and the region holds those from 151: exactly half of them."""
    region = (151.0, 50.0, 400.0, 400.0)
    scores, usual = both({}, {5: {0: HERE, 1: (99.0, 100.0, 100.0, 100.0)}}, 2, [region])
    assert scores.left_out == {"result: in an ignored region": 1}
    assert (scores.false_positives, usual.false_positives) == (1, 2)


def test_area_outside_the_picture_counts_to_the_box():
    """Of the box that leaves the picture less than half is in the region, though all of it that can be seen is."""
    scores, _ = both({}, {5: always((-150.0, 100.0, 200.0, 50.0), 0)}, 1, [(1.0, 1.0, 300.0, 300.0)])
    assert scores.false_positives == 1


def test_regions_that_overlap_cover_an_area_once():
    regions = [(160.0, 100.0, 200.0, 200.0)] * 2
    scores, _ = both({}, {5: always(HERE, 0)}, 1, regions)
    assert scores.false_positives == 1


def test_truth_in_an_ignored_region_stays_between_the_first_and_the_last_box_that_is_clear():
    region = (90.0, 90.0, 220.0, 220.0)
    boxes = {0: HERE, 1: FAR, 2: HERE, 3: FAR, 4: HERE}
    scores, _ = both({1: boxes, 2: always(HERE, 0, 1)}, {}, 5, [region])
    assert scores.misses == 3  # frames 1 to 3 of the first
    assert scores.left_out == {"truth: in an ignored region": 4}
    assert scores.mostly_lost == 1


def test_true_boxes_are_rounded_and_results_are_not():
    scores, _ = both({1: always((99.5, 100.49, 99.5, 100.2), 0)}, {5: always(HERE, 0)}, 1)
    assert scores.motp == 1.0
    scores, _ = both({1: always((100.0, 100.0, 100.0, 100.0), 0)}, {5: always((100.0, 100.0, 99.6, 100.0), 0)}, 1)
    assert scores.motp == pytest.approx(0.996)


def test_true_coordinates_are_1_at_least():
    scores, _ = both({1: always((-20.0, -3.0, 100.0, 100.0), 0)}, {5: always((1.0, 1.0, 100.0, 100.0), 0)}, 1)
    assert scores.motp == 1.0


def test_every_class_counts_as_one():
    truth, result = truth_of({1: always(HERE, 0)}, 1), result_of({5: always(HERE, 0)})
    scores = evaluate_tracking(replace(truth, labels=truth.labels + 3), result, "detrac")
    assert scores.mota == 1.0


@pytest.mark.parametrize("truth", [{}, {1: always(HERE, 0)}], ids=["no-truth", "truth"])
@pytest.mark.parametrize("result", [{}, {1: always(HERE, 0)}], ids=["no-result", "result"])
def test_nothing_on_a_side_is_no_error(truth, result):
    scores, _ = both(truth, result, 1)
    assert scores.true_positives == len(truth) * len(result)
    assert scores.mota == len(truth) * len(result)


def test_sequences_are_combined_by_their_counts():
    one, _ = both({1: always(HERE, 0, 1)}, {5: always(HERE, 0)}, 2)
    two, _ = both({1: always(HERE, 0)}, {5: always(HERE, 0), 6: always(HERE, 0)}, 1)
    together = combine([one, two])
    assert (together.true_positives, together.misses, together.false_positives) == (2, 1, 1)
    assert together.mota == pytest.approx(1 / 3)
    assert together.frames == 3


def test_protocols_do_not_mix():
    one, _ = both({}, {}, 1)
    usual = evaluate_tracking(truth_of({}, 1), result_of({}))
    with pytest.raises(ValueError, match="one protocol, got both"):
        combine([one, usual])
    with pytest.raises(ValueError, match="protocol: expected one of trackeval, detrac, got MOTA"):
        evaluate_tracking(truth_of({}, 1), result_of({}), "MOTA")


def test_pr_average_is_half_the_area_under_the_figure_along_the_curve():
    precision, recall = np.array([0.2, 0.6, 1.0]), np.array([0.9, 0.6, 0.0])
    values = np.array([0.1, 0.5, 0.3])
    steps = [0.5, np.hypot(0.4, 0.6)]
    expected = (steps[0] * 0.3 + steps[1] * 0.4) / 2
    assert pr_average(values, precision, recall) == pytest.approx(expected)
    assert pr_average(values[::-1], precision[::-1], recall[::-1]) == pytest.approx(expected)
    assert pr_average(values[:1], precision[:1], recall[:1]) == 0.0
    with pytest.raises(ValueError, match="one or more thresholds"):
        pr_average(values[:0], precision[:0], recall[:0])


def test_pr_scores_take_every_figure_along_the_curve():
    good, _ = both({1: always(HERE, 0, 1)}, {5: always(HERE, 0, 1)}, 2)
    poor, _ = both({1: always(HERE, 0, 1)}, {5: always(HERE, 0)}, 2)
    scores = pr_scores([good, poor], np.array([0.0, 1.0]), np.array([0.0, 0.0]))
    assert (scores.mota, scores.recall, scores.misses) == (0.375, 0.375, 0.25)


@pytest.mark.data
def test_the_only_official_example_gives_the_figures_of_the_formula(data_folder):
    """The official program prints 29.77; see the docstring of PRScores."""
    folder = data_folder / "detrac" / "prmota"
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    recalls, precisions = np.loadtxt(folder / "R-CNN_detection_PR.txt").T.copy()
    rows = np.loadtxt(folder / "GOG_R-CNN_DETRAC-MOT_results.txt", delimiter=",")[:-1]
    columns = {"MOTA": 11, "MOTP": 12, "MT": 4, "ML": 6}
    got = {name: pr_average(rows[:, column].copy(), precisions, recalls) for name, column in columns.items()}
    expected = {"MOTA": 29.3831, "MOTP": 42.0711, "MT": 30.0734, "ML": 17.6645}
    assert got == pytest.approx(expected, abs=5e-5)


XML = """<?xml version="1.0" encoding="utf-8"?>
<sequence name="MVI_1"><ignored_region><box left="0.5" top="500.25" width="80" height="90"/></ignored_region>
<frame num="1"><target_list>
<target id="1"><box left="592.75" top="378.8" width="160.05" height="162.2"/><attribute vehicle_type="car"/></target>
</target_list></frame>
<frame num="3"><target_list>
<target id="ID"><box left="500" top="300" width="10.5" height="20"/><attribute vehicle_type="van"/></target>
</target_list></frame></sequence>"""


def write_xml(folder: Path, identity: str = "2") -> Path:
    path = folder / "MVI_1.xml"
    path.write_text(XML.replace("ID", identity))
    return path


def test_truth_is_read_without_being_cut(tmp_path):
    truth = read_detrac_truth(write_xml(tmp_path), frame_count=5)
    assert truth.frames.tolist() == [0, 1, 2, 3, 4]
    assert truth.row_frames.tolist() == [0, 2]
    assert truth.xyxy[0].tolist() == pytest.approx([592.75, 378.8, 752.8, 541.0])
    assert truth.ignored.tolist() == [[0.5, 500.25, 80.5, 540]]
    assert len(read_detrac_truth(write_xml(tmp_path)).frames) == 3


def test_truth_with_a_twin_or_beyond_the_end_is_refused(tmp_path):
    path = write_xml(tmp_path)
    path.write_text(path.read_text().replace('num="3"', 'num="1"').replace('id="2"', 'id="1"'))
    with pytest.raises(FormatError, match=r"MVI_1.xml:7: identity 1 a second time in frame 1"):
        read_detrac_truth(path)
    with pytest.raises(ValueError, match="row_frames"):
        read_detrac_truth(write_xml(tmp_path), frame_count=2)
    path.write_text(path.read_text().replace('width="10.5"', 'width="-1"'))
    with pytest.raises(FormatError, match="left < right"):
        read_detrac_truth(path)
