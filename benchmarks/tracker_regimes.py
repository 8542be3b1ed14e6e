"""Which ways to move trackers can follow: scripted objects and cameras, from 25 frames a second to one.

    python benchmarks/tracker_regimes.py
    python benchmarks/tracker_regimes.py --regimes turns jolts --trackers sort bytetrack ocsort botsort cbiou
    python benchmarks/tracker_regimes.py --set motion.turn_share=0 --set jolts=false

Real sequences say how well a tracker does there; these say what it cannot do at all. Boxes of 40 x 80 px err by 4 % of
their size, one in twenty is missed, rows come in random order, scores are 0.9. Prints the percentage of detections that
carry the identity of their object, where each object has one identity and each identity one object, as a mean of
scenes; "looks": with descriptors that are 0.5 apart for one object and 1.4 for two. Times are given to the presets;
the others count frames.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce import Detections
from lookonce.assignment import solve_dense
from lookonce.compare.associated import Associated
from lookonce.compare.contenders.presets import associate_by
from lookonce.compare.detections import DetectedFrame, DetectedSequence
from lookonce.tracking.settings import choose_tracker
from machine import describe_machine
from others import chosen_others

SIDE_PX = 80.0  # of which speeds and ways below are multiples
ERROR, MISSED, SCORE = 0.04, 0.05, 0.9
DESCRIPTOR, SPREAD, THRESHOLD = 32, 0.35, 0.7
SECONDS, MOST_FRAMES, FEWEST_FRAMES = 8.0, 200, 30
RATES = (25.0, 8.0, 3.0, 1.0)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Regime:
    """How objects and the camera move.

    Attributes:
        objects: so many,
        room: each has a square of so many box sides for itself when they begin.
        speed: sides / s, each object's is 0.5 to 1.5 times as much.
        path: from the time step, places, velocities, which it may change, and random numbers to the ways gone; None:
            straight on.
        camera: from the time to where the picture is, px, and how large.
        missed: share of the boxes that are.
        box: size, px.
    """

    objects: int = 10
    room: float = 6.0
    speed: float = 0.7
    path: Callable[[float, Floats, Floats, np.random.Generator], Floats] | None = None
    camera: Callable[[float], tuple[Floats, float]] | None = None
    missed: float = MISSED
    box: tuple[float, float] = (40.0, 80.0)


def turn(step_s: float, _: Floats, velocities: Floats, rng: np.random.Generator) -> Floats:
    """Everybody turns round once in five seconds."""
    turns = rng.random(len(velocities)) < step_s / 5
    velocities[turns] *= -1
    return velocities * step_s


def swing(amplitude: float, period_s: float) -> Callable[[float, Floats, Floats, np.random.Generator], Floats]:
    """To and fro; the velocity holds the phase."""

    def path(step_s: float, _: Floats, phases: Floats, __: np.random.Generator) -> Floats:
        before = np.sin(phases[:, 0])
        phases[:, 0] += 2 * np.pi * step_s / period_s
        return np.stack([np.sin(phases[:, 0]) - before, np.zeros(len(phases))], axis=1) * amplitude * SIDE_PX

    return path


def bumped(time_s: float) -> tuple[Floats, float]:
    """Once a second, by one and a half sides some way."""
    bumps = np.random.default_rng(0).uniform(0, 2 * np.pi, 1000)[: int(time_s)]
    return 1.5 * SIDE_PX * np.array([np.cos(bumps).sum(), np.sin(bumps).sum()]), 1.0


REGIMES = {
    "walk": Regime(),
    "crowd": Regime(objects=25, room=3.0),
    "one alone, fast": Regime(objects=1, room=12.0, speed=6.0),
    "fast, apart": Regime(objects=6, room=12.0, speed=6.0),
    "turns": Regime(path=turn),
    "swing, 3 s": Regime(objects=5, room=8.0, path=swing(2.0, 3.0)),
    "swing, 1 s": Regime(objects=5, room=8.0, path=swing(1.0, 1.0)),
    "half missed": Regime(missed=0.5),
    "wide boxes": Regime(box=(160.0, 40.0), room=8.0),
    "jolts": Regime(camera=bumped),
    "pan, 4 sides/s": Regime(camera=lambda time_s: (np.array([4 * SIDE_PX * time_s, 0.0]), 1.0)),
    "zoom, 4 s": Regime(camera=lambda time_s: (np.zeros(2), float(np.exp(0.5 * np.sin(np.pi * time_s / 2))))),
}


def make_scene(regime: Regime, rate: float, seed: int, has_looks: bool) -> tuple[DetectedSequence, NDArray[np.int64]]:
    """The detections, and which object each row shows."""
    rng, step_s = np.random.default_rng(seed), 1 / rate
    count, side = regime.objects, regime.room * np.sqrt(regime.objects) * SIDE_PX
    places, angles = rng.uniform(0, side, (count, 2)), rng.uniform(0, 2 * np.pi, count)
    speeds = regime.speed * SIDE_PX * rng.uniform(0.5, 1.5, count)
    velocities = np.stack([np.cos(angles), np.sin(angles)], axis=1) * speeds[:, np.newaxis]
    faces, frames, objects = unit(rng.normal(size=(count, DESCRIPTOR))), [], []
    for number in range(int(np.clip(SECONDS * rate, FEWEST_FRAMES, MOST_FRAMES))):
        if number:
            places += velocities * step_s if regime.path is None else regime.path(step_s, places, velocities, rng)
        shift, zoom = (np.zeros(2), 1.0) if regime.camera is None else regime.camera(number * step_s)
        seen = rng.permutation(np.flatnonzero(rng.random(count) >= regime.missed))
        size = np.array(regime.box) * zoom
        centres = side / 2 + (places[seen] - side / 2) * zoom + shift + rng.normal(0, ERROR, (len(seen), 2)) * size
        half = size * np.exp(rng.normal(0, ERROR, (len(seen), 2))) / 2
        looks = unit(faces[seen] + rng.normal(0, SPREAD / np.sqrt(DESCRIPTOR), (len(seen), DESCRIPTOR)))
        found = Detections(
            np.concatenate([centres - half, centres + half], axis=1).astype(np.float32),
            np.full(len(seen), SCORE, np.float32),
            np.zeros(len(seen), np.int64),
            looks.astype(np.float32) if has_looks else None,
        )
        frames.append(DetectedFrame(number, number * step_s, found))
        objects.append(seen)
    return DetectedSequence.of_frames(frames, THRESHOLD if has_looks else 0.0), np.concatenate(objects)


def unit(rows: Floats) -> Floats:
    """Of length 1."""
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def named_rightly(objects: NDArray[np.int64], ids: NDArray[np.int64]) -> float:
    """The percentage of rows that carry the identity of their object."""
    known, number = np.unique(ids[ids >= 0], return_inverse=True)
    if not len(known):
        return 0.0
    together = np.zeros((int(objects.max()) + 1, len(known)))
    np.add.at(together, (objects[ids >= 0], number), 1)
    identity_of = solve_dense(together)
    matched = np.flatnonzero(identity_of >= 0)
    return float(100 * together[matched, identity_of[matched]].sum() / len(objects))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--regimes", nargs="+", choices=list(REGIMES), default=list(REGIMES))
    parser.add_argument("--trackers", nargs="+", default=[], help="others of `lookonce compare`, by boxes alone")
    parser.add_argument("--set", action="append", default=[], dest="changes", metavar="NAME=VALUE", help="of `default`")
    parser.add_argument("--rates", type=float, nargs="+", default=RATES, help="frames a second")
    parser.add_argument("--scenes", type=int, default=5)
    arguments = parser.parse_args()
    others = chosen_others(parser, arguments.trackers)
    config = choose_tracker("default", arguments.changes).config
    ways: dict[str, tuple[bool, Callable[[DetectedSequence], Associated]]] = {
        "default, looks": (True, lambda sequence: associate_by(config, sequence)),
        "default": (False, lambda sequence: associate_by(config, sequence)),
    }
    ways |= {name: (False, one.answer) for name, one in others.items()}
    print(describe_machine())
    print(f"% of detections with their object's identity, mean of {arguments.scenes} scenes; frames a second:")
    print(f"{'regime':16s} {'tracker':16s} " + " ".join(f"{rate:6g}" for rate in arguments.rates))
    for name in arguments.regimes:
        for tracker, (has_looks, way) in ways.items():
            shares = []
            for rate in arguments.rates:
                scenes = [make_scene(REGIMES[name], rate, seed, has_looks) for seed in range(arguments.scenes)]
                shares.append(np.mean([named_rightly(objects, way(scene).ids) for scene, objects in scenes]))
            print(f"{name:16s} {tracker:16s} " + " ".join(f"{share:6.1f}" for share in shares), flush=True)


if __name__ == "__main__":
    main()
