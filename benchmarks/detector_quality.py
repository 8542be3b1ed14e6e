"""Average precision and time of detectors on labelled stills.

    python benchmarks/detector_quality.py MODEL.onnx ... --stills FOLDER[:list.txt] ...
    python benchmarks/detector_quality.py MODEL.onnx --yolox yolox_nano.onnx --stills FOLDER --vehicles

`FOLDER:list.txt` takes only the pictures that the file names, one a line, such as those that a training held out.

Scores above `--score` count, and NMS at 0.45 within each class has been done. First some classes count as one
(`--one-class`, by default car, bus and truck; `--vehicles` adds motorcycles): a car that is also found as a truck is
one right and one false row. `AP50` and `AP` (mean over IoU 0.50 to 0.95) are COCO's: precision at 101 points of recall,
at most 100 detections in a picture; `area` is the area under the envelope of precision at IoU 0.50 over all points of
recall, without that limit. Then AP50/AP of each class, and their mean over the classes that the set labels and that all
models know; a class without a box in the set is not in the table's row. A set that labels a class only partly makes
its figure too low for every model.

`ms` is the median time of a picture, from pixels to boxes, on one thread; the models take turns at each picture.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, median
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lookonce import Detections, Model
from lookonce.errors import LookonceError
from lookonce.evaluation import average_precision, precision_recall
from machine import describe_machine
from stills import StillSet, read_frames, read_stills, usual_names
from yolox import Yolox

IOU_THRESHOLD = 0.45
MAX_DETECTIONS = 100_000  # none is cut off before the evaluation
VEHICLES = "car,bus,truck,motorcycle"
DATA = Path(__file__).parents[1] / "../shared/data"


class Detector(Protocol):
    """What is measured."""

    @property
    def names(self) -> tuple[str, ...]:
        """Class names by label."""

    def detect(self, image: NDArray[np.uint8]) -> Detections:
        """Detections in a picture."""


@dataclass(frozen=True, slots=True)
class Quality:
    """One model on one set.

    Attributes:
        ms: median time of a picture.
        area: area under the envelope at IoU 0.50, some classes as one; NaN without boxes of them.
        one_class: AP50 and AP of the same.
        classes: AP50 and AP of each class that the set labels and the model knows, by name.
    """

    ms: float
    area: float
    one_class: tuple[float, float]
    classes: dict[str, tuple[float, float]]


def detect_all(detectors: Sequence[Detector], stills: StillSet) -> tuple[list[list[Detections]], list[float]]:
    """For each detector the detections in each picture, with the set's labels, and its median time in ms."""
    found: list[list[Detections]] = [[] for _ in detectors]
    times_ms: list[list[float]] = [[] for _ in detectors]
    for picture, image in enumerate(stills.images()):
        for number, detector in enumerate(detectors):
            if not picture:
                detector.detect(image)  # the first run of a session allocates
            started = time.perf_counter()
            detections = detector.detect(image)
            times_ms[number].append((time.perf_counter() - started) * 1000)
            found[number].append(stills.renumber(detections, detector.names))
    return found, [median(values) for values in times_ms]


def measure(
    stills: StillSet, found: Sequence[Detections], names: Sequence[str], merged: Sequence[str], ms: float
) -> Quality:
    """The figures of one model's detections."""
    labels = stills.labels_of([name for name in usual_names(merged) if name in stills.classes])
    one_class, area = (math.nan, math.nan), math.nan
    if labels:
        scores = average_precision(stills.truths, found, stills.classes, as_one_class=labels)
        row = scores.classes[min(labels)]
        one_class = (row.ap50, row.ap)
        area = precision_recall(stills.truths, found, labels).area()
    rows = average_precision(stills.truths, found, stills.classes).classes
    known = set(usual_names(names))
    return Quality(
        ms, area, one_class, {row.name: (row.ap50, row.ap) for row in rows if row.boxes and row.name in known}
    )


def print_table(
    names: Sequence[str], sets: Sequence[StillSet], qualities: Sequence[Sequence[Quality]], merged: Sequence[str]
) -> None:
    """A row for each model on each set."""
    stems = [Path(name).stem for name in names]
    names = stems if len(set(stems)) == len(stems) else names
    classes = list(dict.fromkeys(name for row in qualities for quality in row for name in quality.classes))
    widths = [max(len(name) for name in (*names, "model")), max(len(stills.name) for stills in sets)]
    first = f"{'set':<{widths[1]}} {'stills':>6}  {'model':<{widths[0]}} {'ms':>6}"
    print(f"\n{'':<{len(first)}}  {'+'.join(merged):^21}  {'AP50 / AP':^11}")
    print(f"{first}  {'area':>6} {'AP50':>6} {'AP':>6}   {'mean':^13}" + "".join(f" {name:^13}" for name in classes))
    for stills, row in zip(sets, qualities, strict=True):
        shared = [name for name in classes if all(name in quality.classes for quality in row)]
        for name, quality in zip(names, row, strict=True):
            mean = [fmean(quality.classes[c][which] for c in shared) if shared else math.nan for which in (0, 1)]
            cells = [(mean[0], mean[1]), *(quality.classes.get(c, (math.nan, math.nan)) for c in classes)]
            print(
                f"{stills.name:<{widths[1]}} {len(stills):6d}  {name:<{widths[0]}} {quality.ms:6.2f}  "
                f"{quality.area:6.4f} {quality.one_class[0]:6.4f} {quality.one_class[1]:6.4f}  "
                + "".join(f" {'-':^13}" if math.isnan(a) else f" {a:6.4f}/{b:6.4f}" for a, b in cells)
            )


def read_set(text: str, limit: int | None) -> StillSet:
    """The stills of ``FOLDER`` or ``FOLDER:list.txt``."""
    folder, colon, listed = text.rpartition(":")
    if colon and listed.endswith(".txt"):
        return read_stills(Path(folder), limit, Path(listed))
    return read_stills(Path(text), limit)


def parse_arguments() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", help="model files")
    parser.add_argument("--yolox", type=Path, help="also this file of YOLOX")
    parser.add_argument("--names", type=Path, default=DATA / "weights/coco.names", help="class names of --yolox")
    parser.add_argument("--stills", nargs="+", default=[], metavar="FOLDER[:list.txt]")
    parser.add_argument("--sequence", type=Path, help="also frames of this labelled sequence of pictures")
    parser.add_argument("--start", type=int, default=0, help="first frame of --sequence, from 0")
    parser.add_argument("--every", type=int, default=1, help="of --sequence")
    merged = parser.add_mutually_exclusive_group()
    merged.add_argument("--one-class", default="car,bus,truck", help="classes that count as one in the first figures")
    merged.add_argument(
        "--vehicles", action="store_const", dest="one_class", const=VEHICLES, help=f"that is {VEHICLES}"
    )
    parser.add_argument("--score", type=float, default=0.005, help="detections above it count")
    parser.add_argument("--limit", type=int, help="only the first so many stills of each set")
    arguments = parser.parse_args()
    if not arguments.models and not arguments.yolox:
        parser.error("no model given")
    return arguments


def main() -> int:
    """Print the table."""
    arguments = parse_arguments()
    print(describe_machine())
    print(f"scores above {arguments.score}, NMS at {IOU_THRESHOLD}, one thread")
    settings = {"score_threshold": arguments.score, "iou_threshold": IOU_THRESHOLD, "max_detections": MAX_DETECTIONS}
    try:
        detectors: list[Detector] = [Model(path, threads=1, **settings) for path in arguments.models]
        sets = [read_set(text, arguments.limit) for text in arguments.stills]
        if arguments.sequence:
            sets.append(
                read_frames(arguments.sequence, arguments.start, arguments.every, arguments.one_class.split(",")[0])
            )
    except (LookonceError, ValueError) as error:
        sys.exit(str(error))
    if arguments.yolox:
        names = tuple(arguments.names.read_text().splitlines())
        detectors.append(Yolox(arguments.yolox, names, arguments.score))
    merged = arguments.one_class.split(",")
    qualities = []
    for stills in sets:
        found, times_ms = detect_all(detectors, stills)
        qualities.append(
            [
                measure(stills, rows, detector.names, merged, ms)
                for detector, rows, ms in zip(detectors, found, times_ms, strict=True)
            ]
        )
    print_table(arguments.models + [str(path) for path in (arguments.yolox,) if path], sets, qualities, merged)
    return 0


if __name__ == "__main__":
    sys.exit(main())
