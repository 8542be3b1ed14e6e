"""What counts: truth and result side by side, after the rules of the protocol have left out what does not."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.tracking.matching import best_pairs
from lookonce.evaluation.tracking.overlaps import Boxes, Scene, overlapping_pairs
from lookonce.evaluation.tracking.values import TrackingResult, TrackingTruth

__all__ = ["FRAME_WITHOUT_TRUTH", "NOT_COUNTED", "ON_DISTRACTOR", "frames_with_truth", "prepare"]

NOT_COUNTED = "truth: not to be found (ignored, a distractor or another class)"
ON_DISTRACTOR = "result: on a distractor"
FRAME_WITHOUT_TRUTH = "result: in a frame without truth"

_MIN_IOU = 0.5 - np.finfo(np.float64).eps  # TrackEval's


def frames_with_truth(
    truth: TrackingTruth, result: TrackingResult, left_out: Counter[str]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Frames of all truth rows and result rows as places in ``truth.frames``, -1 = none, and the result rows with one.

    Adds to ``left_out`` what both sources had left out before, and the result rows in frames without truth.
    """
    left_out.update({f"truth: {why}": count for why, count in truth.left_out.items()})
    left_out.update({f"result: {why}": count for why, count in result.left_out.items()})
    result_frames = _places(truth.frames, result.row_frames)
    rows = np.flatnonzero(result_frames >= 0)
    if len(rows) < len(result):
        left_out[FRAME_WITHOUT_TRUTH] += len(result) - len(rows)
    return _places(truth.frames, truth.row_frames), result_frames, rows


def _places(frames: NDArray[np.int64], row_frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) int64: the place of each of ``row_frames`` (N,) in ``frames`` (F,), which rise; -1 = not among them."""
    if not len(frames):
        return np.full(len(row_frames), -1, np.int64)
    if frames[-1] - frames[0] == len(frames) - 1:  # all frames of a video
        places = row_frames - frames[0]
        return np.where((places >= 0) & (places < len(frames)), places, -1)
    found = np.minimum(np.searchsorted(frames, row_frames), len(frames) - 1)
    return np.where(frames[found] == row_frames, found, -1)


def prepare(truth: TrackingTruth, result: TrackingResult) -> tuple[Scene, Counter[str]]:
    """The rows that count, and how many do not and why.

    As MOTChallenge has it: a result that is matched with a distractor, when all true boxes are matched by the largest
    sum of IoU of 0.5 and more, is neither right nor wrong; true boxes that do not count are no misses.
    """
    left_out: Counter[str] = Counter()
    truth_frames, result_frames, rows = frames_with_truth(truth, result, left_out)
    if truth.is_distractor.any():
        is_on_distractor = _on_distractors(truth, truth_frames, result, result_frames, rows)
        left_out[ON_DISTRACTOR] += int(is_on_distractor.sum())
        rows = rows[~is_on_distractor[rows]]
    counted = np.flatnonzero(truth.is_counted)
    left_out[NOT_COUNTED] += len(truth) - len(counted)
    total = len(truth.frames)
    scene = Scene(
        Boxes.of(truth_frames, truth.ids, truth.xyxy, counted, total),
        Boxes.of(result_frames, result.ids, result.xyxy, rows, total),
    )
    return scene, +left_out


def _on_distractors(
    truth: TrackingTruth,
    truth_frames: NDArray[np.int64],
    result: TrackingResult,
    result_frames: NDArray[np.int64],
    rows: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """(R,) bool: which results, of the rows given, are matched with a distractor."""
    total = len(truth.frames)
    every, numbers = np.arange(len(truth)), np.arange(len(result))
    true_boxes = Boxes.of(truth_frames, every, truth.xyxy, every, total)
    boxes = Boxes.of(result_frames, numbers, result.xyxy, rows, total)
    scene = Scene(true_boxes, boxes)
    is_distractor = truth.is_distractor[true_boxes.ids]
    found = np.zeros(len(rows), np.bool_)  # by the new numbers, which are in the order of rows
    for pairs in overlapping_pairs(scene):
        near = pairs[pairs.overlaps >= _MIN_IOU]
        near = near[np.isin(near.frames, near.frames[is_distractor[near.truths]])]
        chosen = near[best_pairs(scene, near, near.overlaps)]
        found[boxes.ids[chosen.results[is_distractor[chosen.truths]]]] = True
    on_distractor = np.zeros(len(result), np.bool_)
    on_distractor[rows] = found
    return on_distractor
