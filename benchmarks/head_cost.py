"""What descriptor heads cost inside the model file, against the same detector without descriptors.

    python benchmarks/head_cost.py detector.onnx native.onnx compact.onnx [--objects 0 10 30 100] [--threads 1]

All files must hold the same detector; the first is what the others are compared with (make it with
`lookonce import ... --no-descriptors`). Thresholds are so low, and `max_detections` such, that every picture has the
given number of objects (for 0: so high that it has none). The files take turns picture by picture, each round in
another order (A B C, B C A). Of a picture the least of all rounds counts, of the pictures' differences the median. The
share is of the detector's time at its usual threshold, where it decodes no thousands of weak boxes. On one thread the
processor's time is measured, not the clock's: other programs then disturb less.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
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
    parser.add_argument("--objects", type=int, nargs="+", default=[0, 10, 30, 100])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=12)
    arguments = parser.parse_args()
    print(describe_machine())
    clock = time.process_time if arguments.threads == 1 else time.perf_counter
    usual = run_time([Model(arguments.models[0], threads=arguments.threads)], arguments.rounds, clock)[0]
    detector_ms = 1000 * float(np.median(usual.min(axis=0)))
    print(f"\n{arguments.models[0].name}: {detector_ms:.2f} ms without objects\n")
    print("objects  model                    head ms  share")
    for count in arguments.objects:
        threshold = 0.0 if count else 1.0
        models = [
            Model(
                path, threads=arguments.threads, score_threshold=threshold, iou_threshold=1.0, max_detections=count or 1
            )
            for path in arguments.models
        ]
        seconds = run_time(models, arguments.rounds, clock)
        for path, own in zip(arguments.models[1:], seconds[1:], strict=True):
            head_ms = 1000 * float(np.median(own.min(axis=0) - seconds[0].min(axis=0)))
            print(f"{count:7}  {path.name:24} {head_ms:7.2f}  {head_ms / detector_ms:5.1%}", flush=True)


def run_time(models: list[Model], rounds: int, clock: Callable[[], float]) -> NDArray[np.float64]:
    """Seconds (models, rounds, pictures) of each inference, the models taking turns."""
    canvases = pictures(models[0].size, seed=0)
    seconds = np.zeros((len(models), rounds, PICTURES))
    for turn in range(rounds):
        for column, (canvas, placed) in enumerate(canvases):
            for row in np.roll(np.arange(len(models)), -turn):
                start = clock()
                models[row].run(canvas[None], [placed])
                seconds[row, turn, column] = clock() - start
    return seconds


if __name__ == "__main__":
    main()
