"""How far descriptors carry identity from one frame to the next, by match threshold of the preset `paper`.

    python benchmarks/links.py -m model.onnx

A link is two detections of neighbouring frames with one id. Precision: the share of links that join the same truth
object, of those that touch a truth object at all. Recall: of the truth objects detected in both frames, the share
that is linked. `ceiling` is what the paper's rule could reach if every descriptor were perfect: an object missed once
is a new one, so misses of the detector alone split identities.

The sequences are those with identity truth in the development data; every n-th frame makes the task harder.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce import Detections, Model, PaperConfig, Tracker, open_video
from lookonce.boxes import iou
from lookonce.tracking.greedy import assign_greedily
from machine import describe_machine

DATA = Path(__file__).parents[2] / "shared" / "data"
SEQUENCES = {
    "PETS09-S2L1": ("sequences/PETS09-S2L1", "sequences/PETS09-S2L1/gt/gt.txt", ("person",)),
    "highway2": ("videos/haarcascades_video2.avi", "sequences/highway2/gt/gt.txt", ("car", "bus", "truck")),
}
THRESHOLDS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4)
NOTHING = -1


def read_truth(path: Path) -> dict[int, tuple[NDArray[np.int64], NDArray[np.float32]]]:
    """Ids (T,) and boxes xyxy (T, 4) by frame, from 0, of a MOT file."""
    rows = defaultdict(list)
    for line in path.read_text().splitlines():
        frame, identity, left, top, width, height = (float(value) for value in line.split(",")[:6])
        rows[int(frame) - 1].append((identity, left, top, left + width, top + height))
    table = {frame: np.array(values) for frame, values in rows.items()}
    return {frame: (rows[:, 0].astype(np.int64), rows[:, 1:].astype(np.float32)) for frame, rows in table.items()}


def truth_of(detections: Detections, truth: tuple[NDArray[np.int64], NDArray[np.float32]] | None) -> NDArray[np.int64]:
    """The truth id of each detection, by greedy overlap of at least 0.5; -1 for none."""
    if truth is None or not len(detections):
        return np.full(len(detections), NOTHING)
    ids, boxes = truth
    row = assign_greedily(1 - iou(boxes, detections.xyxy).astype(np.float64), 0.5)
    return np.where(row >= 0, ids[row], NOTHING)


def count_links(frames: list[tuple[Detections, NDArray[np.int64]]], threshold: float) -> tuple[int, int, int, int]:
    """Right links, wrong links, possible links, identities."""
    tracker = Tracker(PaperConfig(match_threshold=threshold))
    before: dict[int, int] = {}
    right = wrong = possible = last = 0
    for detections, truth in frames:
        ids = tracker.update(detections).ids
        now = dict(zip(ids.tolist(), truth.tolist(), strict=True))
        possible += len((set(before.values()) & set(now.values())) - {NOTHING})
        for identity in before.keys() & now.keys():
            right += now[identity] == before[identity] != NOTHING
            wrong += now[identity] != before[identity]
        before, last = now, max([last, *now])
    return right, wrong, possible, last


def ceiling_identities(frames: list[tuple[Detections, NDArray[np.int64]]]) -> int:
    """Identities the paper's rule gives with perfect descriptors: one for each unbroken run of detections."""
    before: set[int] = set()
    identities = 0
    for _, truth in frames:
        now = set(truth.tolist()) - {NOTHING}
        identities += len(now - before) + int((truth == NOTHING).sum())
        before = now
    return identities


def main() -> None:
    """Print a table for each sequence and step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-m", "--model", type=Path, required=True)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--every", type=int, nargs="+", default=[1, 4])
    arguments = parser.parse_args()
    print(describe_machine())
    model = Model(arguments.model)
    for name, (source, truth_file, classes) in SEQUENCES.items():
        labels, truth = model.labels_of(classes), read_truth(arguments.data / truth_file)
        frames = []
        for frame in open_video(arguments.data / source):
            detections = model.detect(frame.image)
            detections = detections[np.isin(detections.labels, labels)]
            frames.append((detections, truth_of(detections, truth.get(frame.index))))
        for every in arguments.every:
            chosen = frames[::every]
            print(f"\n{name}, every {every}: ceiling {ceiling_identities(chosen)} identities")
            print("threshold  precision  recall  identities")
            for threshold in THRESHOLDS:
                right, wrong, possible, identities = count_links(chosen, threshold)
                print(
                    f"{threshold:9.1f}  {right / max(1, right + wrong):9.3f}  {right / max(1, possible):6.3f}"
                    f"  {identities:10d}"
                )


if __name__ == "__main__":
    main()
