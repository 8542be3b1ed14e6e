"""How well the camera's motion is found, and what that costs.

    python benchmarks/camera_motion.py --still VIDEO_OR_FOLDER ... --pictures PICTURE_OR_VIDEO ... --moving VIDEO ...

Frames go through the letterbox of a 384x640 network, as in `lookonce track`; only the camera's part is timed.

1. Known motion: a picture seen through a window that shifts, turns and zooms, 960x540, with noise; then with textured
   patches that move over it on their own, once under boxes and once without.
2. Rendered scenes whose camera shakes by a known amount, or does not.
3. Clips of cameras that stand still: in how many frames is the answer not exactly the identity?
4. CPU time of a frame: standing still and moving, in turns.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.camera import CameraMotion, luma_of_canvas
from lookonce.letterbox import Letterboxer
from lookonce.synthetic import SceneConfig, SyntheticScene
from lookonce.synthetic.sensor import Sensor
from lookonce.synthetic.stage import Streams
from lookonce.video import open_video
from machine import describe_machine

NETWORK = (384, 640)
SIZE = (540, 960)
FPS = 25.0
NOISE = 2.0
IDENTITY = np.array([[1.0, 0, 0], [0, 1, 0]])
NO_BOXES = np.zeros((0, 4), np.float32)


@dataclass(frozen=True, slots=True)
class Step:
    """One frame for the camera's part: luma, boxes, size, time, and the true motion from the frame before."""

    luma: NDArray[np.uint8]
    xyxy: NDArray[np.float32]
    size: tuple[int, int]
    time_s: float
    truth: NDArray[np.float64]


def paths(kind: str, frames: int) -> Iterator[NDArray[np.float64]]:
    """Poses (2, 3) that take px of the first frame to px of each: smooth, of several periods."""
    middle = np.array([SIZE[1] / 2, SIZE[0] / 2])
    for index in range(frames):
        t = index / FPS
        wave = [math.sin(2 * math.pi * t / period + period) for period in (0.31, 0.83, 2.9)]
        shift, turn, zoom = np.zeros(2), 0.0, 1.0
        if kind == "shake":
            shift = 4.0 * np.array([wave[0] + wave[1], wave[1] - wave[2]])
        elif kind == "pan":
            shift = np.array([150 * math.sin(2 * math.pi * t / 4), 40 * math.sin(2 * math.pi * t / 3)])
        elif kind == "drone":
            shift, turn, zoom = 40 * np.array([wave[2], wave[1]]), 0.06 * wave[2], 1 + 0.06 * wave[1]
        cos, sin = zoom * math.cos(turn), zoom * math.sin(turn)
        linear = np.array([[cos, -sin], [sin, cos]])
        yield np.column_stack([linear, middle - linear @ middle + shift])


def whole(affine: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3)."""
    return np.vstack([affine, [0, 0, 1]])


def warped(picture: Image.Image, kind: str, frames: int, patches: int, has_boxes: bool) -> Iterator[Step]:
    """The picture through a moving window; some patches of it move on their own."""
    rng = np.random.default_rng(0)
    letterbox = Letterboxer(NETWORK)
    scale = max(SIZE[1] * 1.6 / picture.width, SIZE[0] * 1.6 / picture.height)
    picture = picture.resize((round(picture.width * scale), round(picture.height * scale)), Image.Resampling.LANCZOS)
    corner = np.array([(picture.width - SIZE[1]) / 2, (picture.height - SIZE[0]) / 2])
    side = 170
    starts = rng.uniform(0, 1, (patches, 2)) * (SIZE[1] - side, SIZE[0] - side)
    speeds = rng.uniform(-8, 8, (patches, 2))
    bank = [np.kron(rng.integers(0, 256, (17, 17, 3)), np.ones((10, 10, 1))).astype(np.uint8) for _ in range(patches)]
    before = None
    for index, pose in enumerate(paths(kind, frames)):
        back = np.linalg.inv(whole(pose))
        coefficients = np.vstack([back[:2, :2].T, back[:2, 2] + corner]).T.reshape(-1)
        seen = picture.transform(SIZE[::-1], Image.Transform.AFFINE, tuple(coefficients), Image.Resampling.BICUBIC)
        image = np.asarray(seen).astype(np.int16)
        boxes = []
        for start, speed, texture in zip(starts, speeds, bank, strict=True):
            left, top = ((start + index * speed) % (SIZE[1] - side, SIZE[0] - side)).astype(int)
            image[top : top + side, left : left + side] = texture
            boxes.append((left, top, left + side, top + side))
        noisy = np.clip(image + rng.normal(0, NOISE, image.shape).round(), 0, 255).astype(np.uint8)
        truth = IDENTITY if before is None else (whole(pose) @ np.linalg.inv(whole(before)))[:2]
        before = pose
        canvas, placed = letterbox(noisy)
        xyxy = np.array(boxes, np.float32).reshape(-1, 4) if has_boxes else NO_BOXES
        yield Step(luma_of_canvas(canvas, placed), xyxy, SIZE, index / FPS, truth)


def rendered(shake_px: float, seed: int, frames: int) -> Iterator[Step]:
    """A rendered scene with the motion of its camera."""
    config = SceneConfig(seconds=frames / 15, seed=seed, shake_px=shake_px, jpeg_quality=85)
    sensor = Sensor(config, Streams.of(seed).camera)
    letterbox, before = Letterboxer(NETWORK), np.zeros(2)
    for frame in SyntheticScene(config):
        off = np.array(sensor.shift(frame.time_s)) / 2
        truth = IDENTITY.copy()
        truth[:, 2] = off - before if frame.index else 0.0
        before = off
        canvas, placed = letterbox(frame.image)
        yield Step(luma_of_canvas(canvas, placed), frame.objects.xyxy, SIZE, frame.time_s, truth)


def filmed(source: Path, frames: int) -> Iterator[Step]:
    """A clip whose camera's motion nobody knows."""
    letterbox = Letterboxer(NETWORK)
    with open_video(source, max_frames=frames) as video:
        for frame in video:
            canvas, placed = letterbox(frame.picture, frame.rotation)
            yield Step(luma_of_canvas(canvas, placed), NO_BOXES, frame.size, frame.time_s, IDENTITY)


def apart(a: NDArray[np.float64], b: NDArray[np.float64], size: tuple[int, int]) -> float:
    """Mean distance in px between where two affines take points all over the picture."""
    x, y = np.meshgrid(np.linspace(0, size[1], 7), np.linspace(0, size[0], 5))
    points = np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    return float(np.linalg.norm((a - b) @ points, axis=0).mean())


def judge(name: str, steps: Iterator[Step]) -> None:
    """One line of the table of known motions."""
    camera, errors, moved, silent = CameraMotion(), [], [], 0
    for step in steps:
        found = camera.update(step.luma, step.xyxy, step.size, step.time_s)
        errors.append(apart(found, step.truth, step.size))
        moved.append(apart(IDENTITY, step.truth, step.size))
        silent += np.array_equal(found, IDENTITY)
    off, true = np.array(errors), np.array(moved)
    print(
        f"{name:<44} {true.mean():7.2f} {true.max():7.2f}   {np.median(off):7.3f} {off.mean():7.3f} "
        f"{np.percentile(off, 95):7.3f} {off.max():7.2f}   {silent:5d} of {len(off)}",
        flush=True,
    )


def cpu_ms(steps: list[Step]) -> float:
    """CPU time of a frame, mean over a clip."""
    camera = CameraMotion()
    start = time.process_time_ns()
    for step in steps:
        camera.update(step.luma, step.xyxy, step.size, step.time_s)
    return (time.process_time_ns() - start) / len(steps) / 1e6


def print_times(clips: dict[str, list[Step]], rounds: int) -> None:
    """A, B, C, A, B, C ... in one process."""
    times: dict[str, list[float]] = {name: [] for name in clips}
    for _ in range(rounds):
        for name, steps in clips.items():
            times[name].append(cpu_ms(steps))
    print(f"\n{'CPU ms a frame, mean of a clip':<44} {'frames':>7} {'median':>7} {'least':>7} {'most':>7}")
    for name, values in times.items():
        print(f"{name:<44} {len(clips[name]):7d} {np.median(values):7.3f} {min(values):7.3f} {max(values):7.3f}")


def first_picture(source: Path) -> Image.Image:
    """The first frame of a video, or a picture."""
    with open_video(source, max_frames=1) as video:
        return Image.fromarray(next(iter(video)).image)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=Path, nargs="+", default=[], help="to look at through a moving window")
    parser.add_argument("--still", type=Path, nargs="+", default=[], help="clips of cameras that stand still")
    parser.add_argument("--moving", type=Path, nargs="+", default=[], help="clips of cameras that move, for the time")
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    print(describe_machine())
    frames = arguments.frames
    print(
        f"\n{'known motion, px a frame':<44} {'mean':>7} {'most':>7}   error: {'median':>5} {'mean':>7} {'95 %':>7} ",
        end="",
    )
    print(f"{'most':>7}   identity")
    clips: dict[str, list[Step]] = {}
    for path in arguments.pictures:
        picture, stem = first_picture(path), path.stem[:18]
        for kind in ("none", "shake", "pan", "drone"):
            clips[f"{stem} {kind}"] = list(warped(picture, kind, frames, 0, False))
            judge(f"{stem} {kind}", iter(clips[f"{stem} {kind}"]))
            judge(f"{stem} {kind}, 6 objects with boxes", warped(picture, kind, frames, 6, True))
            judge(f"{stem} {kind}, 6 objects without", warped(picture, kind, frames, 6, False))
    for shake_px in (0.0, 0.5, 3.0):
        for seed in (1, 2):
            steps = list(rendered(shake_px, seed, frames))
            clips[f"rendered, shake {shake_px:g}, seed {seed}"] = steps
            judge(f"rendered, shake {shake_px:g}, seed {seed}", iter(steps))
    print(f"\n{'cameras that stand still':<44} {'frames':>7}   not the identity")
    for path in arguments.still:
        clips[path.parent.name if path.is_dir() else path.stem] = steps = list(filmed(path, 4 * frames))
        camera = CameraMotion()
        answers = [camera.update(step.luma, step.xyxy, step.size, step.time_s) for step in steps]
        print(f"{path.parent.name if path.is_dir() else path.stem:<44} {len(steps):7d}   ", end="")
        print(sum(not np.array_equal(answer, IDENTITY) for answer in answers), flush=True)
    for path in arguments.moving:
        clips[path.stem] = list(filmed(path, frames))
    print_times(clips, arguments.rounds)


if __name__ == "__main__":
    main()
