"""Whether the tracker runs for ever: memory and time of the preset `default` over a million frames.

    python benchmarks/endurance.py
    python benchmarks/endurance.py --frames 100000

Objects with descriptors come in on one side and leave on the other, hide for seconds, and false boxes flicker between
them; everything is a function of the frame's number, so that nothing of the scene is kept. The resident memory after a
tenth of the frames, the end, and the CPU time of the first and the last hundredth (after a warm-up) are compared.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce import Detections, Tracker
from machine import describe_machine

LANES = 10  # on each, an object at a time
WIDTH_PX, STEP_S = 1280.0, 0.04
SIZE = 128
FACES = 4096
WARM_UP = 2_000
ALLOWED_MB = 1.0  # growth from the first tenth to the end, for each million frames


class Street:
    """Detections of any frame by its number."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        faces = rng.normal(size=(FACES, SIZE))
        self.faces = (faces / np.linalg.norm(faces, axis=1, keepdims=True)).astype(np.float32)
        self.speed = rng.uniform(2, 6, LANES)  # px a frame
        self.way = WIDTH_PX + rng.uniform(50, 400, LANES)  # with the gap to the next one
        self.noise = rng.normal(0, 1.5, (997, LANES, 4))  # 997 is prime: no two objects see the same
        self.chance = rng.random((1009, LANES))

    def detections(self, number: int) -> Detections:
        """The rows of frame ``number``."""
        travelled = self.speed * number
        turn, centre = np.divmod(travelled, self.way)
        chance = self.chance[number % len(self.chance)]
        noise = self.noise[number % len(self.noise)]
        is_hidden = (centre > 500) & (centre < 500 + 30 * self.speed) & (turn % 3 == 0)  # behind something, for 1.2 s
        is_seen = (centre < WIDTH_PX) & ~is_hidden & (chance > 0.05)
        rows = np.flatnonzero(is_seen)
        top = 60.0 * rows
        boxes = np.stack([centre[rows] - 20, top, centre[rows] + 20, top + 50], axis=1) + noise[rows]
        faces = (turn[rows] * LANES + rows).astype(np.int64) % FACES
        looks = self.faces[faces]
        scores = 0.5 + 0.5 * chance[rows]
        if number % 7 == 0:  # something that is nothing
            x, y = 1200 * self.chance[number % 1009, 0], 600 * self.chance[number % 1009, 1]
            boxes = np.vstack([boxes, [x, y, x + 30, y + 60]])
            looks, scores = np.vstack([looks, self.faces[number % FACES]]), np.append(scores, 0.3)
        labels = np.zeros(len(boxes), np.int64)
        return Detections(boxes.astype(np.float32), scores.astype(np.float32), labels, looks)


def resident_mb() -> float:
    """Memory that the process holds now, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def run(frames: int, seed: int) -> tuple[NDArray[np.float64], list[tuple[int, float]], int]:
    """CPU seconds of each hundredth's updates, frames with the memory after them, and how many ids were given."""
    street, tracker = Street(seed), Tracker("default")
    hundredth, seconds, memory, largest = max(1, frames // 100), np.zeros(100), [], 0
    for number in range(-WARM_UP, 100 * hundredth):
        detections = street.detections(number + WARM_UP)
        start = time.process_time_ns()
        tracks = tracker.update(detections, (number + WARM_UP) * STEP_S)
        took = time.process_time_ns() - start
        if number < 0:
            continue
        seconds[number // hundredth] += took / 1e9
        largest = max(largest, int(tracks.ids.max(initial=0)))
        if (number + 1) % (10 * hundredth) == 0:
            memory.append((number + 1, resident_mb()))
            print(f"{number + 1:9,d} frames: {memory[-1][1]:8.2f} MB resident, {largest:,d} ids", flush=True)
    return seconds / hundredth, memory, largest


def main() -> None:
    """Print the figures; exit code 1 where memory grows by more than is allowed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(describe_machine())
    print(f"seed {arguments.seed}, {arguments.frames:,d} frames at 25 frames/s, {LANES} lanes")
    start = time.perf_counter()
    seconds, memory, _ = run(arguments.frames, arguments.seed)
    growth = memory[-1][1] - memory[0][1]
    allowed = ALLOWED_MB * max(1.0, arguments.frames / 1e6)
    first, last = 1e6 * seconds[0], 1e6 * seconds[-1]
    print(f"growth from {memory[0][0]:,d} to {memory[-1][0]:,d} frames: {growth:.2f} MB (allowed {allowed:.2f})")
    print(f"CPU microseconds a frame: first hundredth {first:.0f}, last {last:.0f}, ratio {last / first:.2f}")
    print(f"median of all hundredths {1e6 * np.median(seconds):.0f}; took {time.perf_counter() - start:.0f} s")
    raise SystemExit(growth > allowed)


if __name__ == "__main__":
    main()
