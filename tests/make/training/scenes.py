"""What training tests work with: labelled squares on disk, detections in a row, readings that need no detector."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from lookonce.make.training.fit import FitData, FitResult, fit
from lookonce.make.training.readings import Readings
from lookonce.structures import Detections
from lookonce.video import VideoWriter
from squares import CELL, COLOURS, ROWS, SIZE, picture

NAMES = tuple(ROWS)


def columns_at(index: int) -> list[int]:
    """The cell column of each square in frame ``index``, in the order of ``NAMES``."""
    return [(index if name != "green" else -index) % (SIZE // CELL) for name in NAMES]


def write_labelled(folder: Path, frames: int = 12, extra_rows: str = "") -> Path:
    """The moving squares as a MOTChallenge sequence with three identities."""
    images = folder / "img1"
    images.mkdir(parents=True)
    lines = []
    for index in range(frames):
        Image.fromarray(picture(index)).save(images / f"{index + 1:06d}.png")
        for number, (name, column) in enumerate(zip(NAMES, columns_at(index), strict=True), 1):
            lines.append(f"{index + 1},{number},{column * CELL},{ROWS[name] * CELL},{CELL},{CELL},1,-1,-1,-1\n")
    (folder / "gt").mkdir()
    (folder / "gt" / "gt.txt").write_text("".join(lines) + extra_rows)
    return folder


def write_stills(folder: Path, frames: Sequence[int] = (0, 3, 5), *, labels: bool = True) -> Path:
    """Frames of the clip as stills in YOLO's layout."""
    (folder / "images").mkdir(parents=True)
    (folder / "labels").mkdir()
    for index in frames:
        Image.fromarray(picture(index)).save(folder / "images" / f"{index}.png")
        shares = [
            ((column + 0.5) / 8, (ROWS[name] + 0.5) / 8) for name, column in zip(NAMES, columns_at(index), strict=True)
        ]
        if labels:
            (folder / "labels" / f"{index}.txt").write_text("".join(f"0 {x} {y} 0.125 0.125\n" for x, y in shares))
    return folder


def write_resting_clip(path: Path, stops: int = 4, rest: int = 6) -> Path:
    """Squares that stand still for some frames and then jump: linking gives a track for each stop of each square."""
    with VideoWriter(path, 10.0) as writer:
        for index in range(stops * rest):
            writer.write(picture(3 * (index // rest)), index / 10)
    return path


def square(name: str) -> np.ndarray:
    """(8, 8, 3) one square."""
    return np.full((CELL, CELL, 3), COLOURS[name], np.uint8)


def make_detections(
    boxes: Sequence[Sequence[float]], labels: Sequence[int] | None = None, scores: Sequence[float] | None = None
) -> Detections:
    """Detections at ``boxes`` xyxy, of class 0 and score 0.9 unless said otherwise."""
    count = len(boxes)
    return Detections(
        np.array(boxes, np.float32).reshape(-1, 4),
        np.array([0.9] * count if scores is None else scores, np.float32),
        np.array([0] * count if labels is None else labels, np.int64),
    )


def make_readings(
    identities: int = 12,
    rows: int = 6,
    *,
    held_out: int = 4,
    points: int = 8,
    channels: int = 5,
    sources: int = 1,
    noise: float = 0.5,
    seed: int = 0,
) -> Readings:
    """Readings of kind ``compact``: each identity is a point in channel space, its rows lie around it.

    Identities are dealt out to the sources in turn; the last ``held_out`` are held out.
    """
    rng = np.random.default_rng(seed)
    identity = np.repeat(np.arange(identities), rows)
    centre = rng.normal(0, 1, (identities, 1, channels))
    values = centre[identity] + rng.normal(0, noise, (len(identity), points, channels))
    return Readings(
        values={"points": values.astype(np.float16), "group": np.zeros(len(identity), np.int64)},
        identity=identity,
        source=identity % sources,
        frame=np.tile(np.arange(rows), identities),
        height_px=np.full(len(identity), 40, np.float32),
        lifetime=np.tile(np.array([0, 2**31 - 1]), (identities, 1)),
        scene=np.arange(identities) % sources,
        held_out=np.arange(identities) >= identities - held_out,
        names=tuple(f"source {n}" for n in range(sources)),
        kinds=("sequences",) * sources,
    )


class Watcher:
    """Progress that is remembered, and that may interrupt: after ``stop_after`` reports of the stage ``stop_in``."""

    def __init__(self, stop_in: str = "", stop_after: int = 0) -> None:
        self.stages: list[tuple[str, int, int | None, str]] = []
        self.findings: list[str] = []
        self._stop_in, self._stop_after = stop_in, stop_after

    def stage(self, name: str, done: int, total: int | None, note: str = "") -> None:
        self.stages.append((name, done, total, note))
        if name == self._stop_in and sum(stage[0] == name for stage in self.stages) == self._stop_after:
            raise KeyboardInterrupt

    def say(self, text: str) -> None:
        self.findings.append(text)


def run_fit(
    model: Path, data: FitData, output: Path, config, *, watcher: Watcher | None = None, **options
) -> FitResult:
    """``fit`` with one thread, its folder beside the output."""
    return fit(
        model,
        data,
        output,
        config,
        folder=output.with_suffix(".fit"),
        device="cpu",
        threads=options.pop("threads", 1),
        progress=watcher or Watcher(),
        **options,
    )
