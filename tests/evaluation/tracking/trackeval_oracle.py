"""Random tracks, and what TrackEval says about them.

TrackEval pulls in opencv-python, whose files overwrite those of opencv-python-headless, so that no extra can name it:
``pip install --no-deps trackeval==1.3.0``. Without it the tests that need it are skipped.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lookonce.evaluation import TrackingResult, TrackingScores, TrackingTruth

_BY_ALPHA = {
    **{"HOTA": "hota", "DetA": "det_a", "DetRe": "det_re", "DetPr": "det_pr", "AssA": "ass_a", "AssRe": "ass_re"},
    **{"AssPr": "ass_pr", "LocA": "loc_a", "OWTA": "owta", "HOTA_TP": "tp", "HOTA_FN": "fn", "HOTA_FP": "fp"},
}
NAMES = {
    "HOTA": {theirs: f"{ours}_by_alpha" for theirs, ours in _BY_ALPHA.items()}
    | {"HOTA(0)": "hota_0", "LocA(0)": "loc_a_0", "HOTALocA(0)": "hota_loc_a_0"},
    "CLEAR": {
        **{"MOTA": "mota", "MOTP": "motp", "MODA": "moda", "sMOTA": "smota", "MOTAL": "motal", "CLR_F1": "f1"},
        **{"CLR_Re": "recall", "CLR_Pr": "precision", "FP_per_frame": "false_positives_per_frame"},
        **{"MTR": "mostly_tracked_share", "PTR": "partly_tracked_share", "MLR": "mostly_lost_share"},
        **{"CLR_TP": "true_positives", "CLR_FN": "misses", "CLR_FP": "false_positives", "IDSW": "id_switches"},
        **{"MT": "mostly_tracked", "PT": "partly_tracked", "ML": "mostly_lost", "Frag": "fragmentations"},
        **{"MOTP_sum": "overlap_sum", "CLR_Frames": "frames"},
    },
    "Identity": {"IDF1": "idf1", "IDR": "idr", "IDP": "idp", "IDTP": "idtp", "IDFN": "idfn", "IDFP": "idfp"},
    "Count": {"Dets": "result_boxes", "GT_Dets": "truth_boxes", "IDs": "tracks", "GT_IDs": "objects"},
}
"""Metric -> TrackEval's figure -> ours."""

Figures = dict[str, dict[str, Any]]


@cache
def oracle() -> Any:
    """TrackEval without a word."""
    with contextlib.redirect_stdout(io.StringIO()):
        return pytest.importorskip("trackeval", reason="the oracle is absent: pip install --no-deps trackeval==1.3.0")


@cache
def metrics() -> list[Any]:
    with contextlib.redirect_stdout(io.StringIO()):
        quiet = {"PRINT_CONFIG": False}
        of = oracle().metrics
        return [of.HOTA(), of.CLEAR(quiet), of.Identity(quiet), of.Count()]


@dataclass
class Frames:
    """Tracks frame by frame: ids (N,) and ltwh (N, 4) of each."""

    truth_ids: list[NDArray[np.int64]]
    truth_ltwh: list[NDArray[np.float64]]
    result_ids: list[NDArray[np.int64]]
    result_ltwh: list[NDArray[np.float64]]

    def __len__(self) -> int:
        return len(self.truth_ids)


def values_of(frames: Frames) -> tuple[TrackingTruth, TrackingResult]:
    """The same as our values, every row counted."""
    ids = np.concatenate([np.zeros(0, np.int64), *frames.truth_ids])
    every = np.ones(len(ids), np.bool_)
    labels = np.zeros(len(ids), np.int64)
    indices = np.arange(len(frames))
    rows = np.repeat(indices, [len(part) for part in frames.truth_ids])
    truth = TrackingTruth(indices, rows, ids, xyxy_of(frames.truth_ltwh), labels, every, ~every)
    ids = np.concatenate([np.zeros(0, np.int64), *frames.result_ids])
    rows = np.repeat(indices, [len(part) for part in frames.result_ids])
    return truth, TrackingResult(rows, ids, xyxy_of(frames.result_ltwh), np.zeros(len(ids), np.int64))


def xyxy_of(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    ltwh = np.concatenate([np.zeros((0, 4)), *parts])
    return np.hstack([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]])


def trackeval_figures(frames: Frames) -> Figures:
    """TrackEval's figures: metric -> figure -> value."""
    similar = oracle().datasets._base_dataset._BaseDataset._calculate_box_ious
    data: dict[str, Any] = {"num_timesteps": len(frames), "seq": "one"}
    for side, ids in (("gt", frames.truth_ids), ("tracker", frames.result_ids)):
        known = np.unique(np.concatenate([np.zeros(0, np.int64), *ids]))
        data[f"{side}_ids"] = [np.searchsorted(known, part) for part in ids]
        data[f"num_{side}_ids"], data[f"num_{side}_dets"] = len(known), sum(map(len, ids))
    pairs = zip(frames.truth_ltwh, frames.result_ltwh, strict=True)
    data["similarity_scores"] = [similar(truth, result) for truth, result in pairs]
    return figures_of(data)


KITTI_CLASSES = {"car": 1, "van": 2, "truck": 3}
"""TrackEval's numbers: what counts, a distractor of it, and a class that plays no part."""


def kitti_figures(truth: TrackingTruth, result: TrackingResult, kinds: NDArray[np.str_]) -> Figures:
    """TrackEval's figures for KITTI's cars; its rules for height, occlusion and truncation play no part.

    Args:
        truth: its regions are KITTI's DontCare of every frame.
        result: all of it cars.
        kinds: (N,), of each true row one of ``KITTI_CLASSES``.
    """
    dataset: Any = object.__new__(oracle().datasets.Kitti2DBox)  # which would ask for folders
    dataset.class_name_to_class_id = KITTI_CLASSES | {"pedestrian": 4, "person": 5}
    dataset.max_occlusion, dataset.max_truncation, dataset.min_height = 2, 0, -np.inf
    truths = [truth.row_frames == frame for frame in truth.frames]
    results = [result.row_frames == frame for frame in truth.frames]
    classes = np.array([KITTI_CLASSES[kind] for kind in kinds.tolist()], np.int64)
    zeros = [np.zeros(int(rows.sum())) for rows in truths]
    similar = dataset._calculate_box_ious
    raw = {
        **{"seq": "one", "num_timesteps": len(truths)},
        **{"gt_ids": [truth.ids[rows] for rows in truths], "gt_classes": [classes[rows] for rows in truths]},
        **{"gt_dets": [truth.xyxy[rows] for rows in truths]},
        **{"gt_extras": [{"occlusion": zero, "truncation": zero} for zero in zeros]},
        **{"gt_crowd_ignore_regions": [truth.ignored for _ in truths]},
        **{"tracker_ids": [result.ids[rows] for rows in results]},
        **{"tracker_dets": [result.xyxy[rows] for rows in results]},
        **{"tracker_classes": [np.full(int(rows.sum()), KITTI_CLASSES["car"]) for rows in results]},
        **{"tracker_confidences": [np.ones(int(rows.sum())) for rows in results]},
    }
    pairs = zip(raw["gt_dets"], raw["tracker_dets"], strict=True)
    raw["similarity_scores"] = [similar(*pair, box_format="x0y0x1y1") for pair in pairs]
    return figures_of(dataset.get_preprocessed_seq_data(raw, "car"))


def figures_of(data: dict[str, Any]) -> Figures:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {type(metric).__name__: metric.eval_sequence(data) for metric in metrics()}


def combined_figures(figures: list[Figures], how: str = "combine_sequences") -> Figures:
    """TrackEval's figures over several."""
    found = {}
    for metric in metrics():
        name = type(metric).__name__
        found[name] = getattr(metric, how)({str(number): one[name] for number, one in enumerate(figures)})
    return found


def differences(theirs: Figures, ours: TrackingScores, tolerance: float = 1e-9) -> list[str]:
    """The figures that differ, "" for none; those of sequences without truth that we define otherwise do not count."""
    sides = {"HOTA": ours.hota, "CLEAR": ours.clear, "Identity": ours.identity, "Count": ours.counts}
    found = []
    for metric, names in NAMES.items():
        for theirs_name, ours_name in names.items():
            if theirs_name == "MLR" and not ours.counts.truth_boxes:
                continue
            expected, got = theirs[metric][theirs_name], getattr(sides[metric], ours_name)
            if not np.allclose(got, expected, rtol=0, atol=tolerance):
                found.append(f"{metric} {theirs_name}: expected {expected}, got {got}")
    return found


def random_frames(seed: int) -> Frames:
    """Up to 24 frames of up to 8 objects: gaps, empty frames, switches, doubled boxes, coarse boxes that tie, junk."""
    rng = np.random.default_rng(seed)
    objects, step = int(rng.integers(0, 9)), float(rng.choice([1, 1, 5]))
    is_coarse = rng.random() < 0.5
    speed, noise = rng.choice([0, 1, 3]), rng.choice([0, 0.5, 2])
    doubled, empty, switches = rng.choice([0, 0.2, 1]), rng.choice([0, 0.1, 0.25]), rng.choice([0, 0.05, 0.3])
    centre, size = rng.uniform(0, rng.choice([20, 40, 100]), (objects, 2)), rng.uniform(5, 20, (objects, 2))
    velocity, track = rng.normal(0, 1, (objects, 2)) * speed, rng.permutation(objects) + 3
    next_track = 100
    frames = Frames([], [], [], [])
    for _ in range(rng.integers(1, 25)):
        centre = centre + velocity
        ltwh = _coarse(np.hstack([centre, size]), step if is_coarse else 0, 1.0)
        seen = rng.permutation(np.flatnonzero(rng.random(objects) > rng.choice([0, 0.2])))
        seen = seen[:0] if rng.random() < empty else seen
        frames.truth_ids.append(seen)
        frames.truth_ltwh.append(ltwh[seen])
        for row in np.flatnonzero(rng.random(objects) < switches):
            other = int(rng.integers(objects))
            if rng.random() < 0.5:
                track[[row, other]] = track[[other, row]]
            else:
                track[row], next_track = next_track, next_track + 1
        found = np.flatnonzero(rng.random(objects) > 0.2)
        found = found[:0] if rng.random() < empty else found
        twice = found[rng.random(len(found)) < doubled]
        ids, rows = np.concatenate([track[found], 1000 + twice]), np.concatenate([found, twice])
        boxes = _coarse(ltwh[rows] + rng.normal(0, 1, (len(rows), 4)) * noise, step if is_coarse else 0, -2.0)
        order = rng.permutation(len(ids))
        frames.result_ids.append(ids[order])
        frames.result_ltwh.append(boxes[order])
    return frames


def _coarse(ltwh: NDArray[np.float64], step: float, least_size: float) -> NDArray[np.float64]:
    rounded = np.rint(ltwh / step) * step if step else ltwh
    return np.hstack([rounded[:, :2], np.maximum(rounded[:, 2:], least_size)])


def write_mot(path: Path, rows: NDArray[np.float64]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, rows, fmt="%.10g", delimiter=",")


def trackeval_on_files(folder: Path, benchmark: str, lengths: dict[str, int]) -> dict[str, Figures]:
    """What ``MotChallenge2DBox`` and the metrics say of ``gt/NAME/gt/gt.txt`` and ``results/ours/data/NAME.txt``."""
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset = oracle().datasets.MotChallenge2DBox(
            {
                **{"GT_FOLDER": str(folder / "gt"), "TRACKERS_FOLDER": str(folder / "results")},
                **{"TRACKERS_TO_EVAL": ["ours"], "SEQ_INFO": dict(lengths), "SKIP_SPLIT_FOL": True},
                **{"BENCHMARK": benchmark, "PRINT_CONFIG": False},
            }
        )
        raw = {name: dataset.get_raw_seq_data("ours", name) for name in lengths}
        prepared = {name: dataset.get_preprocessed_seq_data(raw[name], "pedestrian") for name in lengths}
    return {name: figures_of(data) for name, data in prepared.items()}
