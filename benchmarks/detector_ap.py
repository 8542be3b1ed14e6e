"""AP50 of a Darknet detector on labelled stills: lookonce's model file against the same network in OpenCV.

    python benchmarks/detector_ap.py
    python benchmarks/detector_ap.py --cfg N.cfg --weights N.weights --names N.names --size 512 --stills FOLDER ...

Both sides get the same letterboxed pixels, so that only the network, its decoding and NMS differ. Both keep scores
above 0.005 and drop the weaker of two boxes of one class that overlap by more than 0.45. Then the wanted classes count
as one class: a car that is also found as a truck is one right and one false row. AP50 is the area under the precision
envelope over all points of recall at IoU >= 0.5. By default cars, buses and trucks count, because motorcycles are
labelled with their riders there, which COCO's are not; and manaus5 stands for manaus4 too, whose labels it revises.

The second table says what the way of scaling does to AP50, with lookonce's network on every row; the first row is
`Model.detect` as users call it. Stills with 512 px on the longer side are not scaled at all for 512: see it at
`--size 320`. The exit status is 1 where the two sides differ by more than 0.005.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from av.video.reformatter import Interpolation, VideoReformatter
from numpy.typing import NDArray

from lookonce import Detections, Model
from lookonce.boxes import clip
from lookonce.evaluation import precision_recall
from lookonce.letterbox import PADDING_GREY, Fit, Letterboxer, fit
from lookonce.make.darknet.importer import import_darknet
from machine import describe_machine
from stills import StillSet, read_stills

SCORE_THRESHOLD = 0.005
IOU_THRESHOLD = 0.45
MAX_DETECTIONS = 100_000  # none is cut off
ALLOWED_DIFFERENCE = 0.005
SAME_ROW_PX = 2.0  # rows of one class whose sides are no further apart are one row
DATA = Path(__file__).parents[1] / "../shared/data"

Scaler = Callable[[NDArray[np.uint8], tuple[int, int]], NDArray[np.uint8]]


class OpenCvDetector:
    """A Darknet network in OpenCV, with its own decoding and NMS."""

    def __init__(self, cfg: Path, weights: Path) -> None:
        self._network = cv2.dnn.readNetFromDarknet(str(cfg), str(weights))
        self._outputs = self._network.getUnconnectedOutLayersNames()

    def run(self, canvas: NDArray[np.uint8], placed: Fit) -> Detections:
        """Detections in one letterboxed picture, in px of its source."""
        height, width = placed.network
        self._network.setInput(cv2.dnn.blobFromImage(canvas, 1 / 255))
        rows = np.concatenate(
            self._network.forward(self._outputs)
        )  # (R, 5 + classes): centre, size, objectness, scores
        scale = np.array([width, height], np.float32)
        centre, half = rows[:, :2] * scale, rows[:, 2:4] * scale / 2
        xyxy = np.concatenate([centre - half, centre + half], axis=1)
        kept, labels = self._suppress(xyxy, rows[:, 5:])
        boxes = clip(placed.to_source(xyxy[kept]), placed.source)
        is_inside = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
        return Detections(boxes, rows[kept, 5 + labels], labels)[is_inside]

    @staticmethod
    def _suppress(xyxy: NDArray[np.float32], scores: NDArray[np.float32]) -> tuple[NDArray[np.int64], ...]:
        """Rows that survive the NMS of their class, and the class of each."""
        ltwh = np.concatenate([xyxy[:, :2], xyxy[:, 2:] - xyxy[:, :2]], axis=1).astype(np.float64)
        kept, labels = [], []
        for label in range(scores.shape[1]):
            rows = np.flatnonzero(scores[:, label] > SCORE_THRESHOLD)
            if len(rows):
                chosen = cv2.dnn.NMSBoxes(ltwh[rows].tolist(), scores[rows, label], SCORE_THRESHOLD, IOU_THRESHOLD)
                kept.append(rows[np.asarray(chosen, np.int64)])
                labels.append(np.full(len(chosen), label))
        empty = [np.zeros(0, np.int64)]
        return np.concatenate(kept or empty), np.concatenate(labels or empty).astype(np.int64)


@dataclass(slots=True)
class Agreement:
    """How near the rows of two detectors are, over many pictures."""

    matched: int = 0
    unmatched: int = 0
    box_px: float = 0.0
    score: float = 0.0

    def add(self, ours: Detections, theirs: Detections) -> None:
        """Pairs the rows of one picture: same class, nearest box, each once."""
        rows = set(range(len(theirs)))
        for xyxy, score, label in zip(ours.xyxy, ours.scores, ours.labels, strict=True):
            candidates = [row for row in rows if theirs.labels[row] == label]
            apart = np.abs(theirs.xyxy[candidates] - xyxy).max(axis=1)
            if not len(apart) or apart.min() > SAME_ROW_PX:
                self.unmatched += 1
                continue
            row = candidates[int(apart.argmin())]
            rows.remove(row)
            self.matched += 1
            self.box_px = max(self.box_px, float(apart.min()))
            self.score = max(self.score, abs(float(score - theirs.scores[row])))
        self.unmatched += len(rows)


def compare(
    model: Model, opencv: OpenCvDetector, stills: StillSet, classes: Sequence[str]
) -> tuple[float, float, Agreement]:
    """AP50 of lookonce and of OpenCV on the same canvases, and how near their rows are."""
    letterbox = Letterboxer(model.size)
    ours, theirs, agreement = [], [], Agreement()
    for image in stills.images():
        canvas, placed = letterbox(image)
        mine, other = model.run(canvas[np.newaxis], [placed])[0], opencv.run(canvas, placed)
        agreement.add(mine, other)
        ours.append(stills.renumber(mine, model.names))
        theirs.append(stills.renumber(other, model.names))
    return ap50(stills, ours, classes), ap50(stills, theirs, classes), agreement


def ap50(stills: StillSet, found: Sequence[Detections], classes: Sequence[str]) -> float:
    """AP50 of some classes as one; ``found`` has the labels of the stills."""
    return precision_recall(stills.truths, found, stills.labels_of(classes)).area()


def swscale(interpolation: Interpolation) -> Scaler:
    """A way of scaling from libswscale."""
    scaler = VideoReformatter()

    def scale(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
        return scaler.reformat(frame, width=size[1], height=size[0], interpolation=interpolation).to_ndarray()

    return scale


def opencv_resize(interpolation: int) -> Scaler:
    """A way of scaling from OpenCV."""
    return lambda image, size: cv2.resize(image, size[::-1], interpolation=interpolation)


SCALERS: dict[str, Scaler] = {
    "swscale AREA": swscale(Interpolation.AREA),
    "swscale FAST_BILINEAR": swscale(Interpolation.FAST_BILINEAR),
    "swscale BILINEAR": swscale(Interpolation.BILINEAR),
    "swscale BICUBIC": swscale(Interpolation.BICUBIC),
    "OpenCV INTER_LINEAR": opencv_resize(cv2.INTER_LINEAR),
    "OpenCV INTER_AREA": opencv_resize(cv2.INTER_AREA),
    "OpenCV INTER_CUBIC": opencv_resize(cv2.INTER_CUBIC),
}


def precision_with(model: Model, scale: Scaler, stills: StillSet, classes: Sequence[str]) -> float:
    """AP50 of lookonce's network where ``scale`` makes its input."""
    found = []
    for image in stills.images():
        placed = fit(image.shape[:2], model.size)
        canvas = np.full((*model.size, 3), PADDING_GREY, np.uint8)
        top, left = placed.offset
        canvas[top : top + placed.scaled[0], left : left + placed.scaled[1]] = scale(image, placed.scaled)
        found.append(stills.renumber(model.run(canvas[np.newaxis], [placed])[0], model.names))
    return ap50(stills, found, classes)


def precision_of_detect(model: Model, stills: StillSet, classes: Sequence[str]) -> float:
    """AP50 of ``Model.detect``."""
    found = [stills.renumber(model.detect(image), model.names) for image in stills.images()]
    return ap50(stills, found, classes)


def print_comparison(model: Model, opencv: OpenCvDetector, sets: Sequence[StillSet], classes: Sequence[str]) -> bool:
    """The first table; whether all sets are within the allowed difference."""
    print(
        f"\n{'set':<12} {'images':>6} {'boxes':>6} {'lookonce':>9} {'OpenCV':>8} {'difference':>10}   "
        f"{'same rows':>9} {'others':>6} {'box px':>8} {'score':>8}"
    )
    passed = True
    for stills in sets:
        ours, theirs, near = compare(model, opencv, stills, classes)
        passed &= abs(ours - theirs) <= ALLOWED_DIFFERENCE
        boxes = stills.count(stills.labels_of(classes))
        print(
            f"{stills.name:<12} {len(stills):6d} {boxes:6d} {ours:9.4f} {theirs:8.4f} {ours - theirs:+10.4f}   "
            f"{near.matched:9d} {near.unmatched:6d} {near.box_px:8.5f} {near.score:8.5f}",
            flush=True,
        )
    print("same rows, others: rows of all classes that both sides have, that only one has; then the largest")
    print("difference of a side of a box, px of the still, and of a score, on the same rows")
    return passed


def print_scalers(model: Model, sets: Sequence[StillSet], classes: Sequence[str]) -> None:
    """The second table."""
    every = [image.shape for stills in sets for image in stills.images()]
    scaled = sum(fit(shape[:2], model.size).scaled != shape[:2] for shape in every)
    print(f"\n{scaled} of {len(every)} stills change size for this input")
    print(f"{'AP50 with':<24}" + "".join(f"{stills.name:>12}" for stills in sets))
    values = [precision_of_detect(model, stills, classes) for stills in sets]
    print(f"{'Model.detect':<24}" + "".join(f"{value:12.4f}" for value in values), flush=True)
    for name, scale in SCALERS.items():
        values = [precision_with(model, scale, stills, classes) for stills in sets]
        print(f"{name:<24}" + "".join(f"{value:12.4f}" for value in values), flush=True)


def write_cfg(cfg: Path, size: int, target: Path) -> Path:
    """A copy of a network's description for OpenCV, which takes from the file the input's size and the least score.

    Without ``thresh`` it sets scores up to 0.2 to zero.
    """
    lines = []
    for line in cfg.read_text().splitlines():
        key = line.partition("=")[0].strip()
        lines.append(f"{key}={size}" if key in ("width", "height") else line)
        if key in ("[yolo]", "[region]"):
            lines.append(f"thresh={SCORE_THRESHOLD}")
    target.write_text("\n".join(lines) + "\n")
    return target


def parse_arguments() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cfg", type=Path, default=DATA / "weights/yolo-fastest-1.1-xl.cfg")
    parser.add_argument("--weights", type=Path, help="default: beside the cfg")
    parser.add_argument("--names", type=Path, default=DATA / "weights/coco.names")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--stills", type=Path, nargs="+", default=[DATA / f"stills/{s}" for s in ("manaus5", "atl")])
    parser.add_argument("--classes", default="car,bus,truck", help="as the labels name them")
    parser.add_argument("--limit", type=int, help="only the first so many stills of each set")
    parser.add_argument("--scalers", action=argparse.BooleanOptionalAction, default=True, help="the second table")
    return parser.parse_args()


def main() -> int:
    """Print the tables; 1 if the sides differ by too much."""
    arguments = parse_arguments()
    weights = arguments.weights or arguments.cfg.with_suffix(".weights")
    classes = arguments.classes.split(",")
    print(describe_machine())
    print(f"{arguments.cfg.name} at {arguments.size}, {arguments.classes} as one class, scores above {SCORE_THRESHOLD}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.onnx"
        import_darknet(arguments.cfg, weights, file, names=arguments.names, size=(arguments.size, arguments.size))
        opencv = OpenCvDetector(write_cfg(arguments.cfg, arguments.size, Path(folder) / "network.cfg"), weights)
        model = Model(file, score_threshold=SCORE_THRESHOLD, iou_threshold=IOU_THRESHOLD, max_detections=MAX_DETECTIONS)
    sets = [read_stills(folder, arguments.limit) for folder in arguments.stills]
    passed = print_comparison(model, opencv, sets, classes)
    if arguments.scalers:
        print_scalers(model, sets, classes)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
