"""Truth and results from files, with MOTChallenge's rules: every figure equals that of TrackEval on the same files."""

from __future__ import annotations

import numpy as np
import pytest

from evaluation.tracking.trackeval_oracle import (
    combined_figures,
    differences,
    random_frames,
    trackeval_on_files,
    write_mot,
)
from lookonce import Tracker
from lookonce.datasets import read_mot_results
from lookonce.errors import FormatError
from lookonce.evaluation import TrackingResult, combine, evaluate_tracking, read_motchallenge_truth


def benchmark_rows(seed: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Random truth with classes and rows that do not count, results on all of it, and the number of frames."""
    rng = np.random.default_rng(seed)
    frames = random_frames(seed)
    classes = dict(enumerate(rng.choice([1, 1, 1, 2, 3, 6, 7, 8, 9, 12, 13], 20).tolist()))
    truth = [
        [frame + 1, number, *box, int(rng.random() < 0.8), classes[int(number)], 1.0]
        for frame, (ids, boxes) in enumerate(zip(frames.truth_ids, frames.truth_ltwh, strict=True))
        for number, box in zip(ids, boxes, strict=True)
    ]
    result = [
        [frame + 1, number, *box, 0.9, -1, -1, -1]
        for frame, (ids, boxes) in enumerate(zip(frames.result_ids, frames.result_ltwh, strict=True))
        for number, box in zip(ids, boxes, strict=True)
        if box[2] >= 0 and box[3] >= 0
    ]
    return np.array(truth).reshape(-1, 9), np.array(result).reshape(-1, 10), len(frames)


@pytest.mark.parametrize("benchmark", ["MOT15", "MOT16", "MOT17", "MOT20"])
def test_figures_equal_trackevals_on_written_files(tmp_path, benchmark):
    lengths = {}
    for seed in range(40):
        truth, result, lengths[f"s{seed}"] = benchmark_rows(seed)
        write_mot(tmp_path / "gt" / f"s{seed}" / "gt" / "gt.txt", truth)
        write_mot(tmp_path / "results" / "ours" / "data" / f"s{seed}.txt", result)
    theirs = trackeval_on_files(tmp_path, benchmark, lengths)
    ours = {}
    for name, count in lengths.items():
        truth = read_motchallenge_truth(tmp_path / "gt" / name / "gt" / "gt.txt", benchmark, count)
        result = TrackingResult.of_rows(read_mot_results(tmp_path / "results" / "ours" / "data" / f"{name}.txt"))
        ours[name] = evaluate_tracking(truth, result)
        assert differences(theirs[name], ours[name]) == [], name
        counted = ours[name].counts
        left_out = sum(ours[name].left_out.values())
        assert counted.truth_boxes + counted.result_boxes + left_out == len(truth) + len(result)
    assert differences(combined_figures(list(theirs.values())), combine(list(ours.values()))) == []
    reasons = {reason for one in ours.values() for reason in one.left_out}
    assert ("result: on a distractor" in reasons) == (benchmark != "MOT15")


def linked(path) -> np.ndarray:
    """Detections of a file with the identities that the package's tracker gives them, by where they are."""
    table = np.loadtxt(path, delimiter=",")
    tracker, rows = Tracker("paper"), []
    for frame in range(1, int(table[:, 0].max()) + 1):
        ltwh = table[table[:, 0] == frame, 2:6]
        boxes = np.hstack([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:], np.full((len(ltwh), 1), 0.9), ltwh[:, :1] * 0])
        place = np.hstack([ltwh[:, :2] / 40, np.ones((len(ltwh), 1))])
        place /= np.linalg.norm(place, axis=1, keepdims=True)
        tracked = tracker.update(boxes.astype(np.float32), descriptors=place.astype(np.float32))
        rows += [[frame, *numbers] for numbers in np.hstack([tracked[:, 6:7], ltwh]).tolist()]
    kept = np.array(rows)
    return np.hstack([kept[kept[:, 1] >= 0], np.tile([0.9, -1, -1, -1], (int((kept[:, 1] >= 0).sum()), 1))])


def noisy(path, seed: int) -> np.ndarray:
    """The truth with boxes moved, missed, doubled and renamed."""
    rng = np.random.default_rng(seed)
    table = np.loadtxt(path, delimiter=",")
    moved = table[:, :6] + np.hstack([np.zeros((len(table), 2)), rng.normal(0, 2, (len(table), 4))])
    moved[:, 4:] = np.maximum(moved[:, 4:], 1)
    moved[:, 1] += 1000 * (table[:, 0] // 60)  # another track from time to time
    doubles = moved[rng.random(len(moved)) < 0.1].copy()
    doubles[:, 1] += 500
    doubles[:, 2:4] += rng.normal(0, 6, (len(doubles), 2))
    kept = np.vstack([moved[rng.random(len(moved)) < 0.85], doubles])
    return np.hstack([kept, np.tile([0.9, -1, -1, -1], (len(kept), 1))])


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "frames", "how"),
    [
        pytest.param("PETS09-S2L1", 795, "linked", id="pets-detections-linked"),
        pytest.param("PETS09-S2L1", 795, "noisy", id="pets-truth-with-noise"),
        pytest.param("highway2", 750, "noisy", id="highway-truth-with-noise"),
    ],
)
def test_figures_equal_trackevals_on_real_sequences(data_folder, tmp_path, name, frames, how):
    folder = data_folder / "sequences" / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    table = np.loadtxt(folder / "gt" / "gt.txt", delimiter=",")
    write_mot(tmp_path / "gt" / name / "gt" / "gt.txt", table)
    result = linked(folder / "det" / "det.txt") if how == "linked" else noisy(folder / "gt" / "gt.txt", 3)
    write_mot(tmp_path / "results" / "ours" / "data" / f"{name}.txt", result)
    theirs = trackeval_on_files(tmp_path, "MOT15", {name: frames})[name]
    truth = read_motchallenge_truth(tmp_path / "gt" / name / "gt" / "gt.txt", "MOT15", frames)
    rows = read_mot_results(tmp_path / "results" / "ours" / "data" / f"{name}.txt")
    scores = evaluate_tracking(truth, TrackingResult.of_rows(rows))
    assert differences(theirs, scores) == []
    assert scores.clear.true_positives > 1000
    assert scores.clear.id_switches > 0


def test_length_of_the_video_is_that_of_the_truth_where_not_given(tmp_path):
    write_mot(tmp_path / "gt.txt", np.array([[1, 1, 0, 0, 5, 5, 1, 1, 1], [4, 1, 0, 0, 5, 5, 1, 1, 1]]))
    truth = read_motchallenge_truth(tmp_path / "gt.txt")
    assert truth.frames.tolist() == [0, 1, 2, 3]
    result = TrackingResult(np.array([9]), np.array([1]), np.array([[0.0, 0, 5, 5]]), np.zeros(1, np.int64))
    assert evaluate_tracking(truth, result).left_out == {"result: in a frame without truth": 1}


def test_unknown_class_and_benchmark_are_refused(tmp_path):
    write_mot(tmp_path / "gt.txt", np.array([[1, 1, 0, 0, 5, 5, 1, -1, 1]]))
    with pytest.raises(FormatError, match="class: expected 1 to 13 as in MOT20; name MOT15"):
        read_motchallenge_truth(tmp_path / "gt.txt", "MOT20")
    with pytest.raises(ValueError, match="benchmark: expected MOT15"):
        read_motchallenge_truth(tmp_path / "gt.txt", "MOT18")  # type: ignore[arg-type]
    assert read_motchallenge_truth(tmp_path / "gt.txt", "MOT15").is_counted.all()
