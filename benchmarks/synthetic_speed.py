"""Frames per second of the synthetic scene, on one core.

    python benchmarks/synthetic_speed.py --frames 100

Each row is one place and light at the given size. A figure is process CPU time, so other work on the machine counts
only as far as it takes caches: `ms` the median frame with its traffic, rendering, truth and noise, `p95` the slowest
twentieth, `fps` its inverse of the mean; `set up` is the time until the first frame, of which the backdrop takes most.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from clips import parse_size
from lookonce.synthetic import LIGHTS, PLACES, SceneConfig, SyntheticScene
from machine import describe_machine

WARM_UP_FRAMES = 5


def measure(config: SceneConfig, frames: int) -> tuple[float, list[float], float]:
    """Seconds of the set-up, milliseconds of each frame after the first few, and objects in a frame."""
    start = time.process_time()
    scene = iter(SyntheticScene(config))
    next(scene)
    set_up_s = time.process_time() - start
    times, objects = [], 0
    for number in range(frames + WARM_UP_FRAMES):
        start = time.process_time()
        frame = next(scene)
        if number >= WARM_UP_FRAMES:
            times.append(1e3 * (time.process_time() - start))
            objects += len(frame.objects)
    return set_up_s, times, objects / frames


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=parse_size, default=(540, 960), metavar="WIDTHxHEIGHT")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--density", type=float, default=1.0)
    arguments = parser.parse_args()
    height, width = arguments.size
    print(describe_machine())
    print(f"{width}x{height}, {arguments.frames} frames, seed {arguments.seed}, density {arguments.density:g}")
    print(f"\n{'place':<10} {'light':<8} {'objects':>8} {'set up s':>9} {'ms':>7} {'p95':>7} {'fps':>7}")
    for place in PLACES:
        for light in LIGHTS:
            config = SceneConfig(
                seconds=(arguments.frames + WARM_UP_FRAMES + 1) / 15,
                height=height,
                width=width,
                seed=arguments.seed,
                place=place,
                light=light,
                density=arguments.density,
            )
            set_up_s, times, objects = measure(config, arguments.frames)
            median, slow = np.percentile(times, [50, 95])
            rate = 1e3 / float(np.mean(times))
            print(
                f"{place:<10} {light:<8} {objects:8.1f} {set_up_s:9.2f} {median:7.1f} {slow:7.1f} {rate:7.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
