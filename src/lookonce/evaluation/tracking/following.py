"""What became of each single box: the matches and identity switches behind the figures."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation.tracking.clear import ClearMatching
from lookonce.evaluation.tracking.detrac import matching as detrac
from lookonce.evaluation.tracking.detrac.regions import rounded
from lookonce.evaluation.tracking.evaluate import PROTOCOLS
from lookonce.evaluation.tracking.overlaps import Boxes, Scene, by_id, overlapping_pairs
from lookonce.evaluation.tracking.preparation import frames_with_truth, prepare
from lookonce.evaluation.tracking.values import TrackingResult, TrackingTruth

__all__ = ["Following", "follow"]


@dataclass(frozen=True, slots=True)
class Following:
    """Which boxes were compared and who was matched with whom; T true boxes and R boxes of the result.

    Attributes:
        truth_rows: (T,) int64, rows of the truth that take part, by frame.
        result_rows: (R,) int64, rows of the result that take part, by frame.
        partners: (T,) int64, the row of the result that each of ``truth_rows`` is matched with, -1 = missed.
        switches: (S, 2) int64, places in ``truth_rows``, by frame: an object's last match with its old identity, and
            the match that counts as a switch.
    """

    truth_rows: NDArray[np.int64]
    result_rows: NDArray[np.int64]
    partners: NDArray[np.int64]
    switches: NDArray[np.int64]

    @property
    def missed(self) -> NDArray[np.int64]:
        """Rows of the truth that were not found."""
        return self.truth_rows[self.partners < 0]

    @property
    def wrong(self) -> NDArray[np.int64]:
        """Rows of the result that found nothing."""
        return self.result_rows[~np.isin(self.result_rows, self.partners)]


def follow(truth: TrackingTruth, result: TrackingResult, protocol: str = "trackeval") -> Following:
    """The matches of ``evaluate_tracking`` box by box: as many misses, wrong boxes and switches as in its figures.

    Where a frame of the result has the very same box twice and only one of them takes part, it does not matter which
    one is named.

    Raises:
        ValueError: there is no such protocol.

    >>> frames, ids = np.array([0, 1, 2]), np.zeros(3, np.int64)
    >>> boxes = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [2, 0, 12, 10.0]])
    >>> truth = TrackingTruth(frames, frames, ids, boxes, ids, np.ones(3, bool), np.zeros(3, bool))
    >>> found = follow(truth, TrackingResult(frames, np.array([7, 7, 8]), boxes, ids))
    >>> found.partners.tolist(), found.switches.tolist()
    ([0, 1, 2], [[1, 2]])
    """
    if protocol not in PROTOCOLS:
        raise ValueError(f"protocol: expected one of {', '.join(PROTOCOLS)}, got {protocol}")
    scene, tracks, may_switch = _matched_by_detrac(truth, result) if protocol == "detrac" else _matched(truth, result)
    truth_frames, result_frames, candidates = frames_with_truth(truth, result, Counter())
    xyxy = _whole_pixels(truth.xyxy) if protocol == "detrac" else truth.xyxy
    truth_rows = _given_rows(scene.truth, np.flatnonzero(truth.is_counted), truth_frames, xyxy)
    result_rows = _given_rows(scene.result, candidates, result_frames, result.xyxy)
    return Following(
        truth_rows, result_rows, _partners(scene, tracks, result_rows), _switches(scene, tracks, may_switch)
    )


def _matched(truth: TrackingTruth, result: TrackingResult) -> tuple[Scene, NDArray[np.int64], NDArray[np.bool_]]:
    """The scene, the track of each true box (-1 = none), and whether its match may count as a switch."""
    scene, _ = prepare(truth, result)
    clear = ClearMatching(scene)
    for pairs in overlapping_pairs(scene):
        clear.add(pairs)
    return scene, clear.tracks, np.ones(len(scene.truth), np.bool_)


def _matched_by_detrac(
    truth: TrackingTruth, result: TrackingResult
) -> tuple[Scene, NDArray[np.int64], NDArray[np.bool_]]:
    """The same by UA-DETRAC's rules, where only an object that was there in the frame before can switch."""
    scene, _ = detrac.prepare_detrac(truth, result)
    matches = detrac.Matches(scene)
    for pairs in overlapping_pairs(scene):
        matches.add(pairs)
    return scene, matches.track, detrac.rows_before(scene) >= 0


def _whole_pixels(xyxy: NDArray[np.float64]) -> NDArray[np.float64]:
    """True boxes as UA-DETRAC's protocol compares them."""
    ltwh = np.maximum(1, rounded(np.hstack([xyxy[:, :2], xyxy[:, 2:] - xyxy[:, :2]])))
    return np.hstack([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]])


def _given_rows(
    boxes: Boxes, candidates: NDArray[np.int64], frames: NDArray[np.int64], xyxy: NDArray[np.float64]
) -> NDArray[np.int64]:
    """(N,) int64: the row of each of ``boxes``, which are some of the ``candidates`` sorted by frame, order kept."""
    order = candidates[np.argsort(frames[candidates], kind="stable")]
    if len(order) == len(boxes):
        return order
    kept = zip(boxes.frames.tolist(), *boxes.columns.tolist(), strict=True)
    wanted, rows = next(kept, None), []
    for row, box in zip(order.tolist(), zip(frames[order].tolist(), *xyxy[order].T.tolist(), strict=True), strict=True):
        if box == wanted:
            rows.append(row)
            wanted = next(kept, None)
    assert len(rows) == len(boxes)
    return np.array(rows, np.int64)


def _partners(scene: Scene, tracks: NDArray[np.int64], result_rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(T,) int64: rows of the result by frame and track."""
    partners = np.full(len(tracks), -1, np.int64)
    keys = scene.result.frames * scene.result.count + scene.result.ids
    order = np.argsort(keys)
    found = np.flatnonzero(tracks >= 0)
    wanted = scene.truth.frames[found] * scene.result.count + tracks[found]
    partners[found] = result_rows[order[np.searchsorted(keys[order], wanted)]]
    return partners


def _switches(scene: Scene, tracks: NDArray[np.int64], may_switch: NDArray[np.bool_]) -> NDArray[np.int64]:
    found = tracks >= 0
    rows = np.flatnonzero(found)[by_id(scene.truth.ids[found])]  # by object, then by frame
    is_switch = (np.diff(scene.truth.ids[rows]) == 0) & (np.diff(tracks[rows]) != 0) & may_switch[rows[1:]]
    pairs = np.column_stack([rows[:-1][is_switch], rows[1:][is_switch]])
    return pairs[np.argsort(pairs[:, 1], kind="stable")]
