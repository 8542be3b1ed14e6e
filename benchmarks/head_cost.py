"""What descriptor heads cost inside the model file, against the same detector without descriptors.

    python benchmarks/head_cost.py detector.onnx native.onnx compact.onnx [--objects 10 30 100] [--threads 1]

All files must hold the same detector; the first is what the others are compared with (make it with
`lookonce import ... --no-descriptors`). Thresholds are so low, and `max_detections` such, that every picture has the
given number of objects. The files take turns picture by picture (A B C A B C), the median difference counts; the
share is of the detector's time at its usual threshold, where it decodes no thousands of weak boxes.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce import Model
from lookonce.letterbox import Fit, fit
from machine import describe_machine

PICTURES = 6


def pictures(size: tuple[int, int], seed: int) -> list[tuple[NDArray[np.uint8], Fit]]:
    """Smooth random pictures: there is something in every cell."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(PICTURES):
        coarse = rng.integers(0, 256, (size[0] // 16 + 1, size[1] // 16 + 1, 3), np.uint8)
        canvas = coarse.repeat(16, axis=0).repeat(16, axis=1)[: size[0], : size[1]]
        made.append((np.ascontiguousarray(canvas), fit(size, size)))
    return made


def main() -> None:
    """Print a line for each number of objects and file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", type=Path, nargs="+")
    parser.add_argument("--objects", type=int, nargs="+", default=[10, 30, 100])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=12)
    arguments = parser.parse_args()
    print(describe_machine())
    usual = run_time([Model(arguments.models[0], threads=arguments.threads)], arguments.rounds)[0]
    detector_ms = 1000 * float(np.median(usual.min(axis=0)))
    print(f"\n{arguments.models[0].name}: {detector_ms:.2f} ms without objects\n")
    print("objects  model                    head ms  share")
    for count in arguments.objects:
        models = [
            Model(path, threads=arguments.threads, score_threshold=0.0, iou_threshold=1.0, max_detections=count)
            for path in arguments.models
        ]
        seconds = run_time(models, arguments.rounds)
        for path, own in zip(arguments.models[1:], seconds[1:], strict=True):
            head_ms = 1000 * float(np.median(own - seconds[0]))
            print(f"{count:7}  {path.name:24} {head_ms:7.2f}  {head_ms / detector_ms:5.1%}", flush=True)


def run_time(models: list[Model], rounds: int) -> NDArray[np.float64]:
    """Seconds (models, rounds, pictures) of each inference, the models taking turns."""
    canvases = pictures(models[0].size, seed=0)
    seconds = np.zeros((len(models), rounds, PICTURES))
    for turn in range(rounds):
        for column, (canvas, placed) in enumerate(canvases):
            for row, model in enumerate(models):
                start = time.perf_counter()
                model.run(canvas[None], [placed])
                seconds[row, turn, column] = time.perf_counter() - start
    return seconds


if __name__ == "__main__":
    main()
