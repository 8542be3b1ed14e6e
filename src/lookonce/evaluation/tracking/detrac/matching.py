"""Matches as the toolkit of UA-DETRAC makes them: held ones first, then greedily by overlap.

In one thing the toolkit is not followed. Where a second box of the result overlaps an object by 0.7 or more and other
objects are still free, its loop goes on to give the object that second box, though it has the better one already; here
the better one stays.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.tracking.detrac.regions import covered_share, rounded
from lookonce.evaluation.tracking.detrac.scores import DetracScores
from lookonce.evaluation.tracking.overlaps import Boxes, Pairs, Scene, by_id, overlapping_pairs
from lookonce.evaluation.tracking.preparation import IN_REGION, NOT_COUNTED, frames_with_truth
from lookonce.evaluation.tracking.values import TrackingResult, TrackingTruth

__all__ = ["Matches", "evaluate_detrac", "prepare_detrac", "rows_before"]

MIN_IOU = 0.7
MIN_IOU_HELD = 0.7 * 0.8
_MOST_COVERED = 0.5
_MOSTLY_TRACKED, _MOSTLY_LOST = 0.8, 0.2
NO_AREA = "result: zero or negative size"


def evaluate_detrac(truth: TrackingTruth, result: TrackingResult) -> DetracScores:
    """The figures of a sequence; see ``evaluate_tracking``."""
    scene, left_out = prepare_detrac(truth, result)
    before = rows_before(scene)
    matches = Matches(scene)
    for pairs in overlapping_pairs(scene):
        matches.add(pairs)
    return _scores(scene, before, matches, left_out)


def prepare_detrac(truth: TrackingTruth, result: TrackingResult) -> tuple[Scene, Counter[str]]:
    """The rows that count, true boxes rounded, and how many rows do not count and why."""
    left_out: Counter[str] = Counter()
    truth_frames, result_frames, rows = frames_with_truth(truth, result, left_out)
    ltwh = np.maximum(1, rounded(np.hstack([truth.xyxy[:, :2], truth.xyxy[:, 2:] - truth.xyxy[:, :2]])))
    left_out[NOT_COUNTED] += int((~truth.is_counted).sum())
    is_in = truth.is_counted & _on_kept_part(truth, truth_frames, covered_share(ltwh, truth.ignored) < _MOST_COVERED)
    left_out[f"truth: {IN_REGION}"] += int((truth.is_counted & ~is_in).sum())

    xyxy = result.xyxy[rows]
    has_area = (xyxy[:, 2] > xyxy[:, 0]) & (xyxy[:, 3] > xyxy[:, 1])
    left_out[NO_AREA] += int((~has_area).sum())
    is_covered = has_area.copy()
    is_covered[has_area] = _is_result_covered(xyxy[has_area], truth.ignored)
    left_out[f"result: {IN_REGION}"] += int(is_covered.sum())
    total = len(truth.frames)
    true_xyxy = np.hstack([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]])
    scene = Scene(
        Boxes.of(truth_frames, truth.ids, true_xyxy, np.flatnonzero(is_in), total),
        Boxes.of(result_frames, result.ids, result.xyxy, rows[has_area & ~is_covered], total),
    )
    return scene, +left_out


def _on_kept_part(truth: TrackingTruth, frames: NDArray[np.int64], is_clear: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) bool: the rows from the first to the last row of their object that is clear of the regions."""
    _, number = np.unique(truth.ids, return_inverse=True)
    count = int(number.max(initial=-1)) + 1
    first, last = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    clear = is_clear & truth.is_counted
    np.minimum.at(first, number[clear], frames[clear])
    np.maximum.at(last, number[clear], frames[clear])
    return (first[number] <= frames) & (frames <= last[number])


def _is_result_covered(xyxy: NDArray[np.float64], regions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) bool: which boxes of a result lie in the regions; their corners are rounded only for this."""
    size = rounded(xyxy[:, 2:] - xyxy[:, :2])
    left = rounded(xyxy[:, 0] + ((xyxy[:, 2] - xyxy[:, 0]) - size[:, 0]) / 2)  # the toolkit keeps the box's middle ...
    top = rounded(xyxy[:, 3] - size[:, 1])  # ... and its foot
    is_covered = np.zeros(len(xyxy), np.bool_)
    has_pixels = (size > 0).all(axis=1)
    ltwh = np.column_stack([left, top, size])[has_pixels]
    is_covered[has_pixels] = covered_share(ltwh, regions) >= _MOST_COVERED
    return is_covered


class Matches:
    """What each true box is matched with, frame by frame: ``track`` (N,) int64, -1 = nothing, ``overlap`` (N,)."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._frame = -1
        self._held: dict[int, int] = {}  # object -> track, in the last frame that was looked at
        self.track = np.full(len(scene.truth), -1, np.int64)
        self.overlap = np.zeros(len(scene.truth))

    def add(self, pairs: Pairs) -> None:
        """Matches the next frames; ``pairs`` come in the order of frames."""
        near = pairs[pairs.overlaps >= MIN_IOU_HELD]
        objects = self._scene.truth.ids[near.truths]
        tracks = self._scene.result.ids[near.results]
        # The toolkit looks for the largest overlap track by track, and in a track object by object.
        order = np.lexsort((objects, tracks, -near.overlaps, near.frames))
        columns = (near.frames, near.truths, objects, tracks, near.overlaps)
        frame: list[tuple[int, int, int, float]] = []
        for number, *pair in zip(*(column[order].tolist() for column in columns), strict=True):
            if number != self._frame:
                self._match(frame)
                self._held = self._held if number == self._frame + 1 else {}
                self._frame, frame = number, []
            frame.append((pair[0], pair[1], pair[2], pair[3]))
        self._match(frame)

    def _match(self, pairs: list[tuple[int, int, int, float]]) -> None:
        """Matches one frame: pairs of row, object, track and overlap, the largest overlap first."""
        if not pairs:
            return
        matched: dict[int, int] = {}
        taken: set[int] = set()
        for is_turn_of_held in (True, False):
            for row, one, track, overlap in pairs:
                if one in matched or track in taken:
                    continue
                if self._held.get(one) == track if is_turn_of_held else overlap >= MIN_IOU:
                    matched[one] = track
                    taken.add(track)
                    self.track[row], self.overlap[row] = track, overlap
        self._held = matched


def rows_before(scene: Scene) -> NDArray[np.int64]:
    """(N,) int64: for each true box the row of the same object one frame earlier, -1 = none."""
    frames = scene.truth.frames
    rows = by_id(scene.truth.ids)
    follows = (np.diff(scene.truth.ids[rows]) == 0) & (np.diff(frames[rows]) == 1)
    before = np.full(len(scene.truth), -1, np.int64)
    before[rows[1:][follows]] = rows[:-1][follows]
    return before


def _scores(scene: Scene, before: NDArray[np.int64], matches: Matches, left_out: Counter[str]) -> DetracScores:
    truth = scene.truth
    found = matches.track >= 0
    tp = int(found.sum())
    rows = np.flatnonzero(found)[by_id(truth.ids[found])]  # by object, then by frame
    follows = np.diff(truth.ids[rows]) == 0
    is_other_track = follows & (np.diff(matches.track[rows]) != 0)
    is_gap = follows & (np.diff(truth.frames[rows]) > 1)
    lengths = np.bincount(truth.ids, minlength=truth.count)
    tracked = np.bincount(truth.ids[found], minlength=truth.count) / np.maximum(1, lengths)
    mostly, lost = int((tracked > _MOSTLY_TRACKED).sum()), int((tracked < _MOSTLY_LOST).sum())
    return DetracScores(
        true_positives=tp,
        misses=len(truth) - tp,
        false_positives=len(scene.result) - tp,
        id_switches=int((is_other_track & (before[rows[1:]] >= 0)).sum()),
        mostly_tracked=mostly,
        partly_tracked=truth.count - mostly - lost,
        mostly_lost=lost,
        fragmentations=int(is_gap.sum()),
        overlap_sum=float(matches.overlap[found & (matches.overlap >= MIN_IOU)].sum()),
        frames=len(scene),
        left_out=dict(left_out),
    )
