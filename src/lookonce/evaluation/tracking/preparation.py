"""What counts: truth and result side by side, after the rules of the protocol have left out what does not."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import share_inside
from lookonce.evaluation.tracking.matching import best_pairs
from lookonce.evaluation.tracking.overlaps import Boxes, Scene, overlapping_pairs
from lookonce.evaluation.tracking.values import TrackingResult, TrackingTruth

__all__ = ["FRAME_WITHOUT_TRUTH", "IN_REGION", "NOT_COUNTED", "ON_DISTRACTOR", "frames_with_truth", "prepare"]

NOT_COUNTED = "truth: not to be found (ignored, a distractor or another class)"
ON_DISTRACTOR = "result: on a distractor"
FRAME_WITHOUT_TRUTH = "result: in a frame without truth"
IN_REGION = "in an ignored region"

_EPS = float(np.finfo(np.float64).eps)
_MIN_IOU = 0.5 - _EPS  # TrackEval's
_MOST_INSIDE = 0.5 + _EPS  # TrackEval's, of a box's own area in one ignored region (KITTI's DontCare)


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

    True boxes and results are matched by the largest sum of IoU of 0.5 and more. As MOTChallenge has it, a result that
    is matched with a distractor is neither right nor wrong, and true boxes that do not count are no misses. As KITTI
    has it, neither is a result that is matched with nothing and lies in an ignored region: more than half of its own
    area, in a single one.
    """
    left_out: Counter[str] = Counter()
    truth_frames, result_frames, rows = frames_with_truth(truth, result, left_out)
    is_in_region = np.zeros(len(result), np.bool_)
    is_in_region[rows] = _is_inside(result.xyxy[rows], truth.ignored)
    if truth.is_distractor.any() or is_in_region.any():
        partners = _partners(truth, truth_frames, result, result_frames, rows, is_in_region)
        is_on_distractor = np.isin(partners, np.flatnonzero(truth.is_distractor))
        is_in_region &= partners < 0
        left_out[ON_DISTRACTOR] += int(is_on_distractor.sum())
        left_out[f"result: {IN_REGION}"] += int(is_in_region.sum())
        rows = rows[~(is_on_distractor | is_in_region)[rows]]
    counted = np.flatnonzero(truth.is_counted)
    left_out[NOT_COUNTED] += len(truth) - len(counted)
    total = len(truth.frames)
    scene = Scene(
        Boxes.of(truth_frames, truth.ids, truth.xyxy, counted, total),
        Boxes.of(result_frames, result.ids, result.xyxy, rows, total),
    )
    return scene, +left_out


def _is_inside(xyxy: NDArray[np.float64], regions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) bool: of which boxes (N, 4) more than half lies in a single one of the regions (M, 4)."""
    is_inside = np.zeros(len(xyxy), np.bool_)
    for region in regions:  # few; all at once would take memory for each pair
        is_inside |= share_inside(xyxy, region[None])[:, 0] > _MOST_INSIDE
    return is_inside


def _partners(
    truth: TrackingTruth,
    truth_frames: NDArray[np.int64],
    result: TrackingResult,
    result_frames: NDArray[np.int64],
    rows: NDArray[np.int64],
    is_in_region: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """(R,) int64: the true row that each result, of the rows given, is matched with; -1 = none.

    Only of frames where it matters: with a pair of a distractor or of a result that ``is_in_region`` (R,).

    Without ignored regions all true boxes take part, as in MOTChallenge; with them only those that count and
    distractors, as in KITTI, where others are of another class.
    """
    total = len(truth.frames)
    takes_part = truth.is_counted | truth.is_distractor | (not len(truth.ignored))
    true_rows = np.flatnonzero(takes_part)
    true_boxes = Boxes.of(truth_frames, np.arange(len(truth)), truth.xyxy, true_rows, total)
    boxes = Boxes.of(result_frames, np.arange(len(result)), result.xyxy, rows, total)
    scene = Scene(true_boxes, boxes)
    true_row, row = true_rows[true_boxes.ids], rows[boxes.ids]  # numbered anew, ids are places among the rows given
    partners = np.full(len(result), -1, np.int64)
    for pairs in overlapping_pairs(scene):
        near = pairs[pairs.overlaps >= _MIN_IOU]
        matters = truth.is_distractor[true_row[near.truths]] | is_in_region[row[near.results]]
        near = near[np.isin(near.frames, near.frames[matters])]
        chosen = near[best_pairs(scene, near, near.overlaps)]
        partners[row[chosen.results]] = true_row[chosen.truths]
    return partners
