"""How well descriptors tell objects apart, and what that gives the preset `paper`, model file by model file.

    python benchmarks/descriptors.py native.onnx paper.onnx compact.onnx [--match-threshold 0.9]

First part: descriptors read at the truth boxes; pairs 30 to 200 frames apart and rank-1 after 30 frames on PETS09-S2L1,
8 to 200 and 48 on highway2; `half` = the second half of PETS only, for models trained on its first half. Second part:
IDF1 of the preset `paper` on each model's own detections (the same for all), every frame and every 4th.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from lookonce import Detections, Model, PaperConfig, Tracker, open_video
from lookonce.boxes import iou
from lookonce.datasets import LabelledSequence, open_sequences
from lookonce.evaluation import DescribedObjects, equal_error_rate, pair_distances, rank_one
from lookonce.make.probing.describing import describe_sequences
from machine import describe_machine

DATA = Path(__file__).parents[2] / "shared" / "data"
CLASSES = {"PETS09-S2L1": ("person",), "highway2": ("car", "bus", "truck")}
GAPS = {"PETS09-S2L1": (30, 200, 30), "highway2": (8, 200, 48)}  # least, most, rank-1 after; frames


def sequences(data: Path) -> tuple[LabelledSequence, LabelledSequence]:
    """The two sequences with identity truth."""
    (pets,) = open_sequences(data / "sequences" / "PETS09-S2L1")
    (highway,) = open_sequences(data / "sequences" / "highway2", pictures=data / "videos" / "haarcascades_video2.avi")
    return replace(pets, fps=7.0, classes=("person",)), highway  # its own class is called "objects"


def quality(objects: DescribedObjects, gaps: tuple[int, int, int]) -> str:
    """Equal error rate, its threshold, rank-1."""
    rate, threshold = equal_error_rate(pair_distances(objects, gaps[0], gaps[1]))
    first = rank_one(objects, gaps[2])
    return f"{rate:.3f}  {threshold:9.3f}  {first.rate:6.3f}"


def detect(model: Model, sequence: LabelledSequence) -> list[tuple[Detections, NDArray[np.int64], NDArray[np.float32]]]:
    """Detections, truth ids and truth boxes of every frame."""
    labels = model.labels_of(CLASSES[sequence.name])
    truth = {frame.index: frame.objects for frame in sequence.frames}
    result = []
    with open_video(sequence.pictures, fps=sequence.fps) as video:
        for frame in video:
            detections = model.detect(frame)
            detections = detections[np.isin(detections.labels, labels)]
            objects = truth.get(frame.index)
            ids = objects.identities if objects else np.zeros(0, np.int64)
            xyxy = objects.xyxy if objects else np.zeros((0, 4), np.float32)
            result.append((outside(detections, sequence.ignored), ids, xyxy))
    return result


def outside(detections: Detections, ignored: NDArray[np.float32]) -> Detections:
    """The detections that lie less than half in an ignored region."""
    if not len(ignored) or not len(detections):
        return detections
    corners = np.maximum(detections.xyxy[:, None, :2], ignored[None, :, :2])
    ends = np.minimum(detections.xyxy[:, None, 2:], ignored[None, :, 2:])
    covered = np.clip(ends - corners, 0, None).prod(axis=2).sum(axis=1)
    area = (detections.xyxy[:, 2:] - detections.xyxy[:, :2]).prod(axis=1)
    return detections[covered < 0.5 * area]


def idf1(
    frames: list[tuple[Detections, NDArray[np.int64], NDArray[np.float32]]], threshold: float
) -> tuple[float, int]:
    """IDF1 in percent (Ristani et al. 2016, IoU 0.5) and the number of identities given."""
    tracker = Tracker(PaperConfig(match_threshold=threshold))
    common: Counter[tuple[int, int]] = Counter()
    truth_length: Counter[int] = Counter()
    track_length: Counter[int] = Counter()
    for detections, ids, xyxy in frames:
        given = tracker.update(detections).ids
        truth_length.update(ids.tolist())
        track_length.update(given[given >= 0].tolist())
        for row, column in zip(*np.nonzero(iou(xyxy, detections.xyxy) >= 0.5), strict=True):
            if given[column] >= 0:
                common[int(ids[row]), int(given[column])] += 1
    rows = {identity: n for n, identity in enumerate(truth_length)}
    columns = {identity: n for n, identity in enumerate(track_length)}
    matches = np.zeros((len(rows), len(columns)))
    for (identity, track), count in common.items():
        matches[rows[identity], columns[track]] = count
    true_positives = matches[linear_sum_assignment(-matches)].sum()
    total = sum(truth_length.values()) + sum(track_length.values())
    return 200 * true_positives / total, len(track_length)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", type=Path, nargs="+")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--match-threshold", type=float, nargs="+", help="besides the model's own (0.7 where none)")
    parser.add_argument("--no-tracking", action="store_true")
    arguments = parser.parse_args()
    print(describe_machine())
    pets, highway = sequences(arguments.data)
    half = replace(pets, frames=tuple(frame for frame in pets.frames if frame.index >= 397))
    print("\nmodel                     kind     sequence      EER    threshold  rank-1")
    for path in arguments.models:
        kind = Model(path).metadata.descriptor
        for sequence, name in ((pets, pets.name), (half, "half"), (highway, highway.name)):
            numbers = quality(describe_sequences(path, [sequence]), GAPS[sequence.name])
            print(f"{path.name:25} {kind.kind if kind else '-':8} {name:12} {numbers}", flush=True)
    if arguments.no_tracking:
        return
    print("\nmodel                     sequence     every  threshold  IDF1  identities")
    for path in arguments.models:
        model = Model(path)
        info = model.metadata.descriptor
        own = info.match_threshold if info and info.match_threshold else 0.7
        for sequence in (pets, highway):
            frames = detect(model, sequence)
            for every in (1, 4):
                for threshold in (own, *(arguments.match_threshold or ())):
                    score, count = idf1(frames[::every], threshold)
                    print(
                        f"{path.name:25} {sequence.name:12} {every:5}  {threshold:9.3f}  {score:4.1f}  {count:10}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
