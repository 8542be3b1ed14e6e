"""Accuracy of trackers as the mean of several draws: one clip alone is decided by a few crossings.

    python benchmarks/tracker_draws.py PETS09-S2L1 detections/PETS09-S2L1-0123456789abcdef.npz --labels 0
    python benchmarks/tracker_draws.py synthetic/synth-0201 detections/synth-0201-*.npz --set fill_s=0 --trackers cbiou

The detections are those that ``lookonce compare --cache detections`` keeps. The first draw is all of them, each other
one leaves out 3 % of the rows at random, the same for every tracker. Protocol ``trackeval``. Prints for each frame rate
the mean over the draws, and the least and the largest.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.cli.evaluated_truth import open_truth, thin
from lookonce.compare.associated import Associated
from lookonce.compare.contenders.presets import associate_by, calibrated
from lookonce.compare.contenders.registry import PLAIN_SCORE
from lookonce.compare.detection_store import read_detections
from lookonce.compare.detections import DetectedSequence
from lookonce.compare.jobs import select
from lookonce.compare.oracle import oracle_ids
from lookonce.evaluation import TrackingResult, TrackingTruth, evaluate_tracking
from lookonce.tracking.settings import choose_tracker
from machine import describe_machine
from others import chosen_others

LEFT_OUT = 0.03
LEAST_SCORE = 0.1
FIGURES = ("IDF1", "AssA", "HOTA", "MOTA", "IDSW")


def draw(sequence: DetectedSequence, number: int) -> DetectedSequence:
    """All rows, or all but some that the number decides."""
    if number == 0:
        return sequence
    return sequence.rows(np.random.default_rng(number).random(len(sequence)) >= LEFT_OUT)


def figures(truth: TrackingTruth, sequence: DetectedSequence, answer: Associated) -> list[float]:
    """``FIGURES`` of an answer; shares in percent."""
    rows, gaps = answer.ids >= 0, answer.filled
    result = TrackingResult(
        np.concatenate([sequence.row_frames[rows], sequence.frames[gaps.frames]]),
        np.concatenate([answer.ids[rows], gaps.ids]),
        np.concatenate([answer.xyxy[rows], gaps.xyxy]).astype(np.float64),
        np.concatenate([sequence.labels[rows], gaps.labels]),
    )
    scores = evaluate_tracking(truth, result, "trackeval")
    shares = scores.identity.idf1, scores.hota.ass_a, scores.hota.hota, scores.clear.mota
    return [*(100 * share for share in shares), float(scores.clear.id_switches)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path, help="a sequence with truth")
    parser.add_argument("detections", type=Path, help="its detections, .npz")
    parser.add_argument("--frames", type=Path, help="its pictures, where the truth has none beside it")
    parser.add_argument("--labels", type=int, nargs="+", default=[], help="classes, by number; default: all")
    parser.add_argument("--trackers", nargs="+", default=[], help="others of `lookonce compare`")
    parser.add_argument("--set", nargs="+", default=[], dest="changes", metavar="NAME=VALUE", help="of preset default")
    parser.add_argument("--every", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--draws", type=int, default=5)
    arguments = parser.parse_args()
    others = chosen_others(parser, arguments.trackers)
    (true,) = open_truth(arguments.truth, frames=arguments.frames)
    stored = read_detections(arguments.detections).sequence
    chosen = choose_tracker("default", arguments.changes)
    config = chosen.config if chosen.has_threshold else calibrated(chosen.config, stored)
    least = {name: LEAST_SCORE if one.has_own_threshold else PLAIN_SCORE for name, one in others.items()}
    ways = {"default": lambda sequence, _: associate_by(config, sequence)}
    ways |= {name: lambda sequence, _, one=one: one.answer(sequence) for name, one in others.items()}
    ways["oracle"] = lambda sequence, truth: Associated.of(sequence, oracle_ids(sequence, truth, 0.5))
    print(describe_machine())
    print(f"{'tracker':12s} every  " + "  ".join(f"{name:>20s}" for name in FIGURES))
    for every in arguments.every:
        truth = thin(true, every).truth
        for name, way in ways.items():
            rows = []
            for number in range(arguments.draws):
                drawn = draw(stored, number)
                drawn = select(drawn, every, least.get(name, LEAST_SCORE), tuple(arguments.labels))
                rows.append(figures(truth, drawn, way(drawn, truth)))
            print(f"{name:12s} {every:5d}  " + "  ".join(map(span, np.array(rows).T)), flush=True)


def span(values: NDArray[np.float64]) -> str:
    """Mean (least, largest)."""
    return f"{values.mean():6.1f} ({values.min():5.1f},{values.max():6.1f})"


if __name__ == "__main__":
    main()
