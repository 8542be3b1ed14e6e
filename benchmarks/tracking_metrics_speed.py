"""Time of the tracking figures against TrackEval, and memory over a long video.

    python benchmarks/tracking_metrics_speed.py [--frames 1000] [--objects 50] [--rounds 5] [--long 100000]

Random objects cross a picture of 1920 x 1080: 5 % of the true boxes and 10 % of the results are missing, boxes are
moved by 4 px, five false boxes a frame, a new track for an object every 500 frames. Both sides start twice: from arrays
in memory (TrackEval: its similarities, MOTChallenge preprocessing and CLEAR, Identity, HOTA and Count), and from
MOTChallenge files. They run in turn, A B A B; a time is the least of all rounds, in CPU seconds of the process. All
figures must agree within 1e-9. TrackEval comes with ``pip install --no-deps trackeval==1.3.0``.

The last lines are the most memory that NumPy held at once beyond the input, for a tenth of the long video and for all.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets import read_mot_results
from lookonce.evaluation import (
    TrackingResult,
    TrackingScores,
    TrackingTruth,
    evaluate_tracking,
    read_motchallenge_truth,
)
from machine import describe_machine

PICTURE = (1920, 1080)
FALSE_BOXES = 5
NEW_TRACK_FRAMES = 500


def make_rows(frames: int, objects: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rows ``frame, id, left, top, width, height`` of truth and result, frames from 0."""
    rng = np.random.default_rng(seed)
    start, speed = rng.uniform(0, 1, (objects, 2)) * PICTURE, rng.normal(0, 3, (objects, 2))
    size = rng.uniform(40, 120, (objects, 2))
    number = np.arange(frames)
    corner = (start + number[:, None, None] * speed) % PICTURE  # (F, K, 2)
    ltwh = np.concatenate([corner, np.broadcast_to(size, corner.shape)], axis=2)
    frame, one = (part.ravel() for part in np.indices((frames, objects)))
    track = one + objects * ((frame + 37 * one) // NEW_TRACK_FRAMES)
    truth = np.column_stack([frame, one, ltwh.reshape(-1, 4)])
    found = np.column_stack([frame, track, (ltwh + rng.normal(0, 4, ltwh.shape)).reshape(-1, 4)])
    false = np.column_stack(
        [
            np.repeat(number, FALSE_BOXES),
            1e6 + np.tile(np.arange(FALSE_BOXES), frames),
            rng.uniform(0, 1, (frames * FALSE_BOXES, 2)) * PICTURE,
            rng.uniform(40, 120, (frames * FALSE_BOXES, 2)),
        ]
    )
    result = np.vstack([found[rng.random(len(found)) > 0.1], false])
    return truth[rng.random(len(truth)) > 0.05], result[np.argsort(result[:, 0], kind="stable")]


def values_of(
    truth: NDArray[np.float64], result: NDArray[np.float64], frames: int
) -> tuple[TrackingTruth, TrackingResult]:
    """The rows as our values."""
    (true_frames, ids, xyxy), found = (_columns(rows) for rows in (truth, result))
    every, labels = np.ones(len(ids), np.bool_), np.ones(len(ids), np.int64)
    return (
        TrackingTruth(np.arange(frames), true_frames, ids, xyxy, labels, every, ~every),
        TrackingResult(*found, np.zeros(len(result), np.int64)),
    )


def _columns(rows: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    whole = rows[:, :2].astype(np.int64)
    return whole[:, 0].copy(), whole[:, 1].copy(), np.hstack([rows[:, 2:4], rows[:, 2:4] + rows[:, 4:6]])


class TrackEval:
    """TrackEval's ``MotChallenge2DBox`` and its metrics, silenced.

    Args:
        folder: with ``gt/one/gt/gt.txt`` and ``results/ours/data/one.txt``.
        frames: of the sequence.
    """

    def __init__(self, folder: Path, frames: int) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            import trackeval

            self.metrics = [trackeval.metrics.HOTA(), trackeval.metrics.Count()]
            self.metrics += [
                kind({"PRINT_CONFIG": False}) for kind in (trackeval.metrics.CLEAR, trackeval.metrics.Identity)
            ]
            self.dataset = trackeval.datasets.MotChallenge2DBox(
                {
                    **{"GT_FOLDER": str(folder / "gt"), "TRACKERS_FOLDER": str(folder / "results")},
                    **{"TRACKERS_TO_EVAL": ["ours"], "SEQ_INFO": {"one": frames}, "SKIP_SPLIT_FOL": True},
                    "PRINT_CONFIG": False,
                }
            )

    def from_files(self) -> dict[str, Any]:
        """All figures from the files."""
        return self._figures(self.dataset.get_raw_seq_data("ours", "one"))

    def load(self) -> dict[str, Any]:
        """The arrays in memory."""
        raw = self.dataset._load_raw_file("ours", "one", is_gt=True)
        return {**self.dataset._load_raw_file("ours", "one", is_gt=False), **raw}

    def from_arrays(self, raw: dict[str, Any]) -> dict[str, Any]:
        """All figures from what ``load`` gave."""
        boxes = zip(raw["gt_dets"], raw["tracker_dets"], strict=True)
        similar = [self.dataset._calculate_similarities(truth, result) for truth, result in boxes]
        return self._figures({**raw, "similarity_scores": similar})

    def _figures(self, raw: dict[str, Any]) -> dict[str, Any]:
        data = self.dataset.get_preprocessed_seq_data(raw, "pedestrian")
        return {name: value for metric in self.metrics for name, value in metric.eval_sequence(data).items()}


def write(folder: Path, truth: NDArray[np.float64], result: NDArray[np.float64]) -> tuple[Path, Path]:
    """Both as MOTChallenge text, every digit kept."""
    paths = folder / "gt" / "one" / "gt" / "gt.txt", folder / "results" / "ours" / "data" / "one.txt"
    for path, rows, tail in zip(paths, (truth, result), ((1, 1, 1), (0.9, -1, -1, -1)), strict=True):
        path.parent.mkdir(parents=True)
        numbered = np.hstack([rows, np.tile(np.array(tail, np.float64), (len(rows), 1))])
        numbered[:, 0] += 1
        np.savetxt(path, numbered, fmt="%.17g", delimiter=",")
    return paths


def compare(name: str, ours: Callable[[], TrackingScores], theirs: Callable[[], dict[str, Any]], rounds: int) -> None:
    """Times both in turn and prints a line."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        start = time.process_time()
        scores = ours()
        times[0].append(time.process_time() - start)
        start = time.process_time()
        figures = theirs()
        times[1].append(time.process_time() - start)
    agree = [
        np.abs(figures["HOTA"] - scores.hota.hota_by_alpha).max(),
        abs(figures["MOTA"] - scores.clear.mota),
        abs(figures["IDSW"] - scores.clear.id_switches),
        abs(figures["IDF1"] - scores.identity.idf1),
    ]
    assert max(agree) < 1e-9, agree
    best = [min(side) for side in times]
    each = ", ".join(f"{ours_s:.3f} {theirs_s:.3f}" for ours_s, theirs_s in zip(*times, strict=True))
    print(
        f"{name:12s} lookonce {best[0]:.3f} s, TrackEval {best[1]:.3f} s: {best[1] / best[0]:.1f} times (all: {each})"
    )


def memory(frames: int, objects: int) -> None:
    """Prints the most memory held at once beyond the input."""
    truth, result = values_of(*make_rows(frames, objects, 0), frames)
    tracemalloc.start()
    start = time.process_time()
    evaluate_tracking(truth, result)
    seconds, (_, peak) = time.process_time() - start, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    rows = len(truth) + len(result)
    held = sum(value.nbytes for value in (truth.xyxy, result.xyxy)) * 2  # with frames, ids and labels about twice
    print(
        f"{frames:,} frames, {rows:,} rows ({held / 1e6:.0f} MB): {peak / 1e6:.0f} MB more at most, "
        f"{peak / rows:.0f} bytes a row, {seconds:.1f} s"
    )


def main() -> None:
    """Prints all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--objects", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--long", type=int, default=100_000, help="frames of the long video, of 20 objects; 0 = none")
    args = parser.parse_args()
    print(describe_machine())
    print(f"{args.frames:,} frames, {args.objects} objects, seed 0, least CPU time of {args.rounds} rounds in turn")
    truth, result = make_rows(args.frames, args.objects, 0)
    values = values_of(truth, result, args.frames)
    with tempfile.TemporaryDirectory() as name:
        truth_path, result_path = write(Path(name), truth, result)
        theirs = TrackEval(Path(name), args.frames)
        raw = theirs.load()
        compare("from arrays", lambda: evaluate_tracking(*values), lambda: theirs.from_arrays(raw), args.rounds)

        def ours_from_files() -> TrackingScores:
            read = TrackingResult.of_rows(read_mot_results(result_path))
            return evaluate_tracking(read_motchallenge_truth(truth_path, "MOT17", args.frames), read)

        compare("from files", ours_from_files, theirs.from_files, args.rounds)
    if args.long:
        for frames in (args.long // 10, args.long):
            memory(frames, 20)


if __name__ == "__main__":
    main()
