"""Time of one association step of the preset `paper` against the same rule in straight NumPy (`rule-sorted`).

    python benchmarks/association.py

Streams of N objects with descriptors of 128 values: 5 % of the detections are missed, 1 % of the objects replaced a
frame, rows shuffled. Both sides get the same frames in turn, A B A B; times are process CPU time a frame. Both must
give the same identities.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray

from lookonce import Detections, Tracker
from lookonce.tracking import PaperConfig
from machine import describe_machine

THRESHOLD = 0.7
SIZE = 128


class RuleSorted:
    """The paper's rule, written plainly: distances by a product, a sort of the pairs, masks, `np.median`."""

    def __init__(self, threshold: float) -> None:
        self.threshold = threshold
        self.next_id = 1
        self.ids = np.zeros(0, np.int64)
        self.count = np.zeros(0, np.int64)
        self.history = np.zeros((0, 3, SIZE), np.float32)

    def update(self, descriptors: NDArray[np.float32]) -> NDArray[np.int64]:
        """Ids (N,) of descriptors (N, SIZE)."""
        ids = np.full(len(descriptors), -1, np.int64)
        history = np.zeros((len(descriptors), 3, SIZE), np.float32)
        count = np.ones(len(descriptors), np.int64)
        history[:, 0] = descriptors
        if len(self.ids) and len(descriptors):
            for track, row in self.match(self.references(), descriptors):
                ids[row] = self.ids[track]
        matched = ids >= 0
        if matched.any():
            order = np.argsort(self.ids)
            tracks = order[np.searchsorted(self.ids[order], ids[matched])]
            history[matched, 1:] = self.history[tracks, :2]
            count[matched] = np.minimum(self.count[tracks] + 1, 3)
        new = int((~matched).sum())
        ids[~matched] = np.arange(self.next_id, self.next_id + new)
        self.next_id += new
        self.ids, self.count, self.history = ids, count, history
        return ids

    def references(self) -> NDArray[np.float32]:
        """What each object is compared with: the median of three, or the newest."""
        references = self.history[:, 0].copy()
        full = self.count == 3
        if full.any():
            references[full] = np.median(self.history[full], axis=1)
        return references

    def match(self, references: NDArray[np.float32], descriptors: NDArray[np.float32]) -> list[tuple[int, int]]:
        """Pairs (track, row), smallest distance first, each once."""
        squared = (references**2).sum(1)[:, None] + (descriptors**2).sum(1)[None, :] - 2 * (references @ descriptors.T)
        distance = np.sqrt(np.maximum(squared, 0))
        tracks, rows = np.nonzero(distance <= self.threshold)
        order = np.argsort(distance[tracks, rows], kind="stable")
        used_tracks, used_rows, pairs = set(), set(), []
        for track, row in zip(tracks[order].tolist(), rows[order].tolist(), strict=True):
            if track not in used_tracks and row not in used_rows:
                used_tracks.add(track)
                used_rows.add(row)
                pairs.append((track, row))
        return pairs


def make_stream(objects: int, frames: int, seed: int) -> list[Detections]:
    """Frames of detections of moving objects with noisy descriptors."""
    rng = np.random.default_rng(seed)
    looks = rng.normal(size=(objects, SIZE))
    centres, speeds = rng.uniform(0, 1000, (objects, 2)), rng.normal(0, 3, (objects, 2))
    stream = []
    for _ in range(frames):
        replaced = rng.random(objects) < 0.01
        looks[replaced] = rng.normal(size=(int(replaced.sum()), SIZE))
        centres += speeds
        rows = rng.permutation(np.flatnonzero(rng.random(objects) >= 0.05))
        descriptors = looks[rows] + rng.normal(0, 0.25, (len(rows), SIZE))
        descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
        xyxy = np.concatenate([centres[rows] - 20, centres[rows] + 20], axis=1).astype(np.float32)
        scores = np.full(len(rows), 0.9, np.float32)
        stream.append(Detections(xyxy, scores, np.zeros(len(rows), np.int64), descriptors.astype(np.float32)))
    return stream


def compare(objects: int, frames: int, rounds: int, seed: int) -> tuple[list[float], list[float]]:
    """CPU microseconds a frame of each side, one figure a round: the median of its frames."""
    stream = make_stream(objects, frames, seed)
    ours, plain = [], []
    for _ in range(rounds):
        tracker, rule = Tracker(PaperConfig(match_threshold=THRESHOLD)), RuleSorted(THRESHOLD)
        times = np.zeros((frames, 2))
        for index, detections in enumerate(stream):
            assert detections.descriptors is not None
            start = time.process_time_ns()
            tracks = tracker.update(detections)
            middle = time.process_time_ns()
            ids = rule.update(detections.descriptors)
            end = time.process_time_ns()
            times[index] = middle - start, end - middle
            assert np.array_equal(tracks.ids, ids), "the two rules disagree"
        medians = np.median(times[5:], axis=0) / 1000
        ours.append(float(medians[0]))
        plain.append(float(medians[1]))
    return ours, plain


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, nargs="+", default=[10, 50, 100, 500, 1000])
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(describe_machine())
    print(f"seed {arguments.seed}, {arguments.frames} frames, {arguments.rounds} rounds, CPU microseconds a frame")
    print(f"{'objects':>8} {'paper':>10} {'rule-sorted':>12} {'ratio':>7}   ratios of the rounds")
    for objects in arguments.objects:
        frames = arguments.frames if objects <= 100 else max(20, arguments.frames * 100 // objects)
        ours, plain = compare(objects, frames, arguments.rounds, arguments.seed)
        ratios = [a / b for a, b in zip(ours, plain, strict=True)]
        each = " ".join(f"{ratio:.2f}" for ratio in ratios)
        print(
            f"{objects:8d} {np.median(ours):10.1f} {np.median(plain):12.1f} {np.median(ratios):7.2f}   {each}",
            flush=True,
        )


if __name__ == "__main__":
    main()
