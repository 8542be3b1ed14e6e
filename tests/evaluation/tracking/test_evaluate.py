"""The usual protocol: every figure equals TrackEval's."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import lookonce.evaluation.tracking.evaluate as evaluate
import lookonce.evaluation.tracking.matching as matching
import lookonce.evaluation.tracking.overlaps as overlaps
import lookonce.evaluation.tracking.pair_counts as pair_counts
from evaluation.tracking.trackeval_oracle import (
    Frames,
    combined_figures,
    differences,
    random_frames,
    trackeval_figures,
    values_of,
)
from lookonce.evaluation import TrackingResult, TrackingTruth, combine, evaluate_tracking


def scene(truth: dict[int, list[int]], result: dict[int, list[int]], frames: int) -> Frames:
    """id -> frames it is in; each truth id has its own place, each result id that of the truth id ``id % 10``."""
    made = Frames([], [], [], [])
    for frame in range(frames):
        for ids, boxes, side in (
            (made.truth_ids, made.truth_ltwh, truth),
            (made.result_ids, made.result_ltwh, result),
        ):
            here = [number for number, when in side.items() if frame in when]
            ids.append(np.array(here, np.int64))
            boxes.append(np.array([(100.0 * (number % 10), 10, 20, 40) for number in here]).reshape(-1, 4))
    return made


def test_figures_equal_trackevals_on_1000_random_sequences():
    faults = [
        f"seed {seed}: {fault}"
        for seed in range(1000)
        for frames in [random_frames(seed)]
        for fault in differences(trackeval_figures(frames), evaluate_tracking(*values_of(frames)))
    ]
    assert faults == []


def crowd(seed: int, objects: int, frames: int, is_coarse: bool) -> Frames:
    """Many objects in little room, found with noise, ids far apart."""
    rng = np.random.default_rng(seed)
    made = Frames([], [], [], [])
    ltwh = np.hstack([rng.uniform(0, 300, (objects, 2)), rng.uniform(20, 60, (objects, 2))])
    for _ in range(frames):
        ltwh[:, :2] += rng.normal(0, 2, (objects, 2))
        seen, found = rng.permutation(objects)[: objects - 5], rng.permutation(objects)[: objects - 9]
        boxes = ltwh + rng.normal(0, 3, ltwh.shape)
        made.truth_ids.append(seen * 10**9)
        made.result_ids.append(found * 10**6 + 7)
        made.truth_ltwh.append(np.rint(ltwh / 10) * 10 if is_coarse else ltwh.copy())
        made.truth_ltwh[-1] = made.truth_ltwh[-1][seen]
        made.result_ltwh.append((np.rint(boxes / 10) * 10 if is_coarse else boxes)[found])
    return made


def trackevals_ids(frames: Frames) -> Frames:
    """The same with small ids: TrackEval makes a table as long as the largest."""
    return replace(
        frames,
        truth_ids=[ids // 10**9 for ids in frames.truth_ids],
        result_ids=[ids // 10**6 for ids in frames.result_ids],
    )


@pytest.mark.parametrize("is_coarse", [False, True], ids=["any-boxes", "coarse-boxes"])
@pytest.mark.parametrize("objects", [30, 90, 170])
def test_figures_of_crowds_equal_trackevals(objects, is_coarse):
    frames = crowd(objects, objects, 6, is_coarse)
    expected = trackeval_figures(trackevals_ids(frames))
    assert differences(expected, evaluate_tracking(*values_of(frames))) == []


def test_very_many_tracks_give_the_same_figures(monkeypatch):
    """Then pairs of object and track are looked up among sorted ones, not in a table."""
    cases = [values_of(random_frames(seed)) for seed in range(40)]
    expected = [evaluate_tracking(*case) for case in cases]
    monkeypatch.setattr(pair_counts, "_TABLE_ENTRIES", 0)
    for case, one in zip(cases, expected, strict=True):
        got = evaluate_tracking(*case)
        assert (got.clear, got.identity) == (one.clear, one.identity)
        np.testing.assert_allclose(got.hota.hota_by_alpha, one.hota.hota_by_alpha, rtol=1e-12)


@pytest.mark.slow
def test_memory_beyond_the_input_is_a_few_numbers_a_row():
    frames, objects = 100_000, 5
    rng = np.random.default_rng(0)
    rows, ids = (part.ravel().astype(np.int64) for part in np.indices((frames, objects)))
    corner = np.column_stack([40.0 * ids, 0.001 * rows])
    xyxy = np.hstack([corner, corner + 60])
    every, labels = np.ones(len(ids), np.bool_), np.zeros(len(ids), np.int64)
    truth = TrackingTruth(np.arange(frames), rows, ids, xyxy, labels, every, ~every)
    result = TrackingResult(rows, ids + objects * (rows // 5000), xyxy + rng.normal(0, 1, xyxy.shape), labels)
    tracemalloc.start()
    scores = evaluate_tracking(truth, result)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert scores.clear.id_switches == objects * (frames // 5000 - 1)
    assert peak < 300 * (len(truth) + len(result))


def test_which_of_several_best_matchings_is_taken_changes_figures(monkeypatch):
    """Why ties are solved as SciPy solves them: any other choice gives other figures than TrackEval's."""

    def first_found(scene, pairs, weights):
        return matching.choose(pairs.truths, pairs.results, weights)[0]

    import lookonce.evaluation.tracking.clear as clear
    import lookonce.evaluation.tracking.hota as hota

    monkeypatch.setattr(clear, "best_pairs", first_found)
    monkeypatch.setattr(hota, "best_pairs", first_found)
    frames = [random_frames(seed) for seed in range(60)]
    assert any(differences(trackeval_figures(one), evaluate_tracking(*values_of(one))) for one in frames)


def test_sequences_in_many_pieces_give_the_same_figures(monkeypatch):
    cases = [values_of(random_frames(seed)) for seed in range(40)]
    whole = [evaluate_tracking(*case) for case in cases]
    monkeypatch.setattr(overlaps, "_PIECE_ENTRIES", 40)
    monkeypatch.setattr(evaluate, "_KEPT_PAIRS", 3)
    for case, expected in zip(cases, whole, strict=True):
        got = evaluate_tracking(*case)
        assert (got.clear, got.identity, got.counts) == (expected.clear, expected.identity, expected.counts)
        np.testing.assert_allclose(got.hota.hota_by_alpha, expected.hota.hota_by_alpha, rtol=1e-12)


def test_renamed_ids_change_nothing():
    for seed in range(40):
        truth, result = values_of(random_frames(seed))
        rng = np.random.default_rng(seed)
        expected = evaluate_tracking(truth, result)
        names = rng.permutation(5000)
        got = evaluate_tracking(replace(truth, ids=names[truth.ids]), replace(result, ids=names[result.ids]))
        assert (got.clear, got.identity, got.counts) == (expected.clear, expected.identity, expected.counts)
        np.testing.assert_allclose(got.hota.hota_by_alpha, expected.hota.hota_by_alpha, rtol=1e-12)


def test_shuffled_rows_change_nothing_where_no_two_matchings_are_equally_good():
    for seed in range(40):
        truth, result = values_of(random_frames(seed))
        rng = np.random.default_rng(seed)
        noise = rng.uniform(0, 0.01, (len(result), 4))
        result = replace(result, xyxy=result.xyxy + noise)
        rows, others = rng.permutation(len(truth)), rng.permutation(len(result))
        expected = evaluate_tracking(truth, result)
        got = evaluate_tracking(
            replace(
                truth,
                **{name: getattr(truth, name)[rows] for name in ("row_frames", "ids", "xyxy", "labels")},
                is_counted=truth.is_counted[rows],
                is_distractor=truth.is_distractor[rows],
            ),
            TrackingResult(result.row_frames[others], result.ids[others], result.xyxy[others], result.labels[others]),
        )
        assert got.clear.overlap_sum == pytest.approx(expected.clear.overlap_sum)
        assert replace(got.clear, overlap_sum=0.0) == replace(expected.clear, overlap_sum=0.0)
        assert got.identity == expected.identity
        np.testing.assert_allclose(got.hota.hota_by_alpha, expected.hota.hota_by_alpha, rtol=1e-9)


def test_sequences_are_combined_as_trackeval_does():
    for first in range(0, 40, 4):
        frames = [random_frames(seed) for seed in range(first, first + 4)]
        theirs = combined_figures([trackeval_figures(one) for one in frames])
        ours = combine([evaluate_tracking(*values_of(one)) for one in frames])
        assert differences(theirs, ours) == []
        assert differences(combined_figures([trackeval_figures(one) for one in frames], CLASSES_BY_BOXES), ours) == []


CLASSES_BY_BOXES = "combine_classes_det_averaged"


def test_combining_nothing_is_refused():
    with pytest.raises(ValueError, match="scores: expected one or more"):
        combine([])


@pytest.mark.parametrize(
    ("truth", "result"),
    [
        pytest.param({}, {}, id="neither"),
        pytest.param({1: [0, 1]}, {}, id="no-result"),
        pytest.param({}, {1: [0, 1]}, id="no-truth"),
        pytest.param({1: [0]}, {1: [0]}, id="one-of-each"),
        pytest.param({1: [0]}, {1: [2]}, id="never-together"),
    ],
)
def test_little_or_nothing_gives_trackevals_figures(truth, result):
    frames = scene(truth, result, 3)
    assert differences(trackeval_figures(frames), evaluate_tracking(*values_of(frames))) == []


def test_switch_after_absence_counts():
    """The object is away in frames 2 and 3 and comes back with another track."""
    frames = scene({1: [0, 1, 4, 5]}, {1: [0, 1], 11: [4, 5]}, 6)
    assert evaluate_tracking(*values_of(frames)).clear.id_switches == 1


def test_frame_without_any_result_is_no_fragmentation():
    frames = scene({1: range(6)}, {1: [0, 1, 3, 4, 5]}, 6)
    assert evaluate_tracking(*values_of(frames)).clear.fragmentations == 0
    beside = scene({1: range(6), 2: range(6)}, {1: [0, 1, 3, 4, 5], 2: range(6)}, 6)
    assert evaluate_tracking(*values_of(beside)).clear.fragmentations == 1


def test_box_of_negative_size_is_wrong():
    truth, result = values_of(scene({1: [0]}, {1: [0], 2: [0]}, 1))
    xyxy = result.xyxy.copy()
    xyxy[1, 2] = xyxy[1, 0] - 5
    assert evaluate_tracking(truth, replace(result, xyxy=xyxy)).clear.false_positives == 1


def test_results_in_frames_without_truth_are_left_out_and_counted():
    truth, result = values_of(scene({1: range(6)}, {1: range(6)}, 6))
    kept = truth.row_frames % 2 == 0
    every = np.ones(int(kept.sum()), np.bool_)
    sparse = TrackingTruth(
        truth.frames[::2], truth.row_frames[kept], truth.ids[kept], truth.xyxy[kept], truth.labels[kept], every, ~every
    )
    scores = evaluate_tracking(sparse, result)
    assert (scores.clear.mota, scores.counts.frames) == (1.0, 3)
    assert scores.left_out == {"result: in a frame without truth": 3}


def test_every_row_is_compared_or_left_out_and_counted():
    truth, result = values_of(scene({1: [0, 1], 2: [0, 1], 3: [0, 1]}, {1: [0, 1], 2: [0, 1], 3: [0, 1]}, 2))
    truth = replace(truth, is_counted=truth.ids == 1, is_distractor=truth.ids == 2, left_out={"no identity": 4})
    scores = evaluate_tracking(truth, result)
    assert scores.left_out == {
        "truth: no identity": 4,
        "truth: not to be found (ignored, a distractor or another class)": 4,
        "result: on a distractor": 2,
    }
    assert scores.counts.truth_boxes + 4 == len(truth)
    assert scores.counts.result_boxes + 2 == len(result)
    assert scores.clear.false_positives == 2  # on the ignored object that is no distractor


def test_one_class_is_evaluated_by_itself():
    truth, result = values_of(scene({1: [0, 1], 2: [0, 1]}, {1: [0, 1], 2: [0, 1]}, 2))
    truth, result = replace(truth, labels=truth.ids % 2), replace(result, labels=np.zeros(4, np.int64))
    zeros, ones = (evaluate_tracking(truth.of_class(label), result.of_class(label)) for label in (0, 1))
    assert (zeros.clear.true_positives, zeros.clear.false_positives) == (2, 2)
    assert (ones.clear.misses, ones.clear.false_positives) == (2, 0)


def test_figures_of_a_sequence_come_out_the_same_twice():
    case = values_of(random_frames(5))
    first, second = evaluate_tracking(*case), evaluate_tracking(*case)
    assert first.clear == second.clear
    assert first.hota.hota_by_alpha.tobytes() == second.hota.hota_by_alpha.tobytes()
