"""Time and memory of one update of the preset `default`, by number of objects.

    python benchmarks/tracker_speed.py
    python benchmarks/tracker_speed.py --scenes crowded --objects 100 --profile

Two scenes of N objects with descriptors of 128 values of unit length, at 25 frames/s; 5 % of the detections are missed
and 1 % of the objects replaced a frame, rows in random order. `free`: the picture grows with N, as in the table of
other trackers, and boxes seldom meet. `crowded`: three times as many boxes for each place, which overlap all the time.
Objects that were replaced stay in the tracker's memory, eight seconds long: `unseen` says how many there were in the
middle of the run, `--warm-up 250` measures with all of them. Times are process CPU time, of which the median over the
frames counts; the growth exponent is that of the time from 50 to 1,000 objects. Memory is that of a process of its own:
its peak, beside the peak of one that only makes the frames.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce import Detections, Tracker
from machine import describe_machine

SIZE = 128
STEP_S = 0.04
BOX_PX = 40.0
SPACING_PX = {"free": 120.0, "crowded": 30.0}  # side of the square that each object has for itself
GOALS_MS = {50: 0.5, 100: 1.0, 10_000: 250.0}
GOAL_EXPONENT, GOAL_MB = 1.3, 512.0


def make_stream(objects: int, frames: int, scene: str, seed: int) -> Iterator[Detections]:
    """Frames of boxes of constant velocity, with noisy descriptors."""
    rng = np.random.default_rng(seed)
    side = SPACING_PX[scene] * np.sqrt(objects)
    looks = rng.normal(size=(objects, SIZE)).astype(np.float32)
    centres, speeds = rng.uniform(0, side, (objects, 2)), rng.normal(0, 3, (objects, 2))
    half = np.stack([np.full(objects, BOX_PX / 4), rng.uniform(0.8, 1.2, objects) * BOX_PX / 2], axis=1)
    for _ in range(frames):
        replaced = rng.random(objects) < 0.01
        count = int(replaced.sum())
        looks[replaced] = rng.normal(size=(count, SIZE))
        centres[replaced], speeds[replaced] = rng.uniform(0, side, (count, 2)), rng.normal(0, 3, (count, 2))
        centres += speeds
        speeds *= np.where((centres < 0) & (speeds < 0) | (centres > side) & (speeds > 0), -1, 1)
        rows = rng.permutation(np.flatnonzero(rng.random(objects) >= 0.05))
        yield _detections(rng, centres[rows], half[rows], looks[rows])


def _detections(
    rng: np.random.Generator, centres: NDArray[np.float64], half: NDArray[np.float64], looks: NDArray[np.float32]
) -> Detections:
    places = centres + rng.normal(0, 1, centres.shape)
    descriptors = looks + rng.normal(0, 0.25, looks.shape).astype(np.float32)
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    xyxy = np.concatenate([places - half, places + half], axis=1).astype(np.float32)
    scores = rng.uniform(0.5, 1, len(xyxy)).astype(np.float32)
    return Detections(xyxy, scores, np.zeros(len(xyxy), np.int64), descriptors)


def time_updates(
    objects: int, frames: int, warm_up: int, scene: str, seed: int, preset: str
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """CPU milliseconds of each update after the warm-up, and objects that were kept unseen, each (frames,)."""
    tracker, took, unseen = Tracker(preset), [], []
    for number, detections in enumerate(make_stream(objects, frames + warm_up, scene, seed)):
        start = time.process_time_ns()
        tracks = tracker.update(detections, number * STEP_S)
        took.append((time.process_time_ns() - start) / 1e6)
        unseen.append(len(tracks.unseen_ids))
    return np.array(took[warm_up:]), np.array(unseen[warm_up:])


def measure_memory(objects: int, scene: str, seed: int, preset: str) -> tuple[float, float]:
    """Peak of a process that tracks, and of one that only makes the frames, MB."""
    peaks = []
    for what in ("track", "make"):
        options = ["--memory", what, "--objects", str(objects), "--scenes", scene, "--seed", str(seed)]
        command = [sys.executable, __file__, *options, "--preset", preset]
        peaks.append(float(subprocess.run(command, capture_output=True, text=True, check=True).stdout))
    return peaks[0], peaks[1]


def print_peak(what: str, objects: int, scene: str, seed: int, preset: str) -> None:
    """Run a few frames in this process and print its peak memory, MB."""
    tracker = Tracker(preset)
    for number, detections in enumerate(make_stream(objects, 12, scene, seed)):
        if what == "track":
            tracker.update(detections, number * STEP_S)
    # Not ru_maxrss, which a new process inherits from the one that starts it.
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM:"))
    print(int(line.split()[1]) * 1024 / 1e6)


def profile(objects: int, frames: int, warm_up: int, scene: str, seed: int, preset: str) -> None:
    """Print the functions in which most time goes."""
    stream = list(make_stream(objects, frames + warm_up, scene, seed))
    tracker, profiler = Tracker(preset), cProfile.Profile(time.process_time)
    for number, detections in enumerate(stream):
        if number == warm_up:
            profiler.enable()
        tracker.update(detections, number * STEP_S)
    profiler.disable()
    print(f"\n{scene}, {objects} objects, {frames} frames")
    pstats.Stats(profiler).sort_stats("tottime").print_stats(25)


def frames_for(objects: int, frames: int) -> int:
    """Fewer where a frame takes long."""
    return frames if objects <= 1_000 else max(10, frames // 10)


def print_table(scene: str, arguments: argparse.Namespace) -> None:
    """A line for each number of objects, and the exponent."""
    medians: dict[int, float] = {}
    for objects in arguments.objects:
        frames = frames_for(objects, arguments.frames)
        rounds = [
            time_updates(objects, frames, arguments.warm_up, scene, arguments.seed, arguments.preset)
            for _ in range(arguments.rounds)
        ]
        each = [float(np.median(took)) for took, _ in rounds]
        medians[objects] = min(each)
        slowest = float(np.median([np.quantile(took, 0.95) for took, _ in rounds]))
        goal = f"{GOALS_MS[objects]:8.1f}" if objects in GOALS_MS and scene == "free" else " " * 8
        listed = " ".join(f"{value:.3f}" for value in each)
        unseen = int(np.median(rounds[0][1]))
        line = f"{scene:>8} {objects:8,d} {unseen:8,d} {medians[objects]:10.3f} {goal} {slowest:10.3f}   {listed}"
        print(line, flush=True)
    if {50, 1_000} <= medians.keys():
        exponent = np.log(medians[1_000] / medians[50]) / np.log(1_000 / 50)
        print(f"{scene}: exponent from 50 to 1,000 objects {exponent:.2f} (goal {GOAL_EXPONENT})")
    if 10_000 in medians:
        tracking, making = measure_memory(10_000, scene, arguments.seed, arguments.preset)
        print(f"{scene}: peak at 10,000 objects {tracking:.0f} MB (goal {GOAL_MB:.0f}); frames alone {making:.0f} MB")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, nargs="+", default=[10, 50, 100, 500, 1_000, 10_000])
    parser.add_argument("--scenes", nargs="+", choices=sorted(SPACING_PX), default=["free", "crowded"])
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--warm-up", type=int, default=50, help="frames that are not timed")
    parser.add_argument("--rounds", type=int, default=3, help="the lowest of their medians counts")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--preset", default="default")
    parser.add_argument("--profile", action="store_true", help="where the time goes, instead of the tables")
    parser.add_argument("--memory", choices=["track", "make"], help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.memory:
        for scene in arguments.scenes:
            print_peak(arguments.memory, arguments.objects[0], scene, arguments.seed, arguments.preset)
        return
    print(describe_machine())
    print(
        f"preset {arguments.preset}, seed {arguments.seed}, "
        f"{arguments.frames} frames up to 1,000 objects after {arguments.warm_up} that are not timed"
    )
    if arguments.profile:
        for scene in arguments.scenes:
            for objects in arguments.objects:
                frames = frames_for(objects, arguments.frames)
                profile(objects, frames, arguments.warm_up, scene, arguments.seed, arguments.preset)
        return
    print(f"CPU milliseconds a frame, median of the frames, the lowest of {arguments.rounds} rounds")
    print(f"{'scene':>8} {'objects':>8} {'unseen':>8} {'median':>10} {'goal':>8} {'95 %':>10}   medians of the rounds")
    for scene in arguments.scenes:
        print_table(scene, arguments)


if __name__ == "__main__":
    main()
