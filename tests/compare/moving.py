"""Objects that move evenly, as a detector would see them: for tests of trackers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lookonce.compare.detections import DetectedFrame, DetectedSequence
from lookonce.structures import Detections

FPS = 10.0
Lane = Callable[[int], tuple[float, float] | None]
"""Left and top of an object in a frame; None = it is not seen."""


def lane(top: float, start: float = 0.0, step: float = 3.0, hidden: tuple[int, ...] = ()) -> Lane:
    """An object that moves to the right, or to the left."""
    return lambda frame: None if frame in hidden else (start + step * frame, top)


def make_sequence(
    lanes: list[Lane], frames: int = 12, *, scores: tuple[float, ...] = (), mixed: bool = False, every: int = 1
) -> tuple[DetectedSequence, np.ndarray]:
    """Boxes of 20 x 40 px, each lane with a look of its own, and the lane of each row.

    Args:
        lanes: one an object.
        frames: how many.
        scores: of each lane; 0.9 where none are given.
        mixed: whether rows of a frame come in another order each time.
        every: only frames whose number is a multiple of it.
    """
    made, owners = [], []
    rng = np.random.default_rng(5)
    looks = np.eye(max(len(lanes), 2), dtype=np.float32)
    for index in range(0, frames, every):
        seen = [number for number, where in enumerate(lanes) if where(index) is not None]
        if mixed:
            seen = rng.permutation(seen).tolist()
        corners = np.array([lanes[number](index) for number in seen], np.float32).reshape(-1, 2)
        boxes = np.hstack([corners, corners + np.array([20, 40], np.float32)])
        given = np.array([(scores or (0.9,) * len(lanes))[number] for number in seen], np.float32)
        found = Detections(boxes, given, np.zeros(len(seen), np.int64), looks[seen])
        made.append(DetectedFrame(index, index / FPS, found))
        owners += seen
    return DetectedSequence.of_frames(made, 0.7), np.array(owners, np.int64)


def ids_by_lane(ids: np.ndarray, owners: np.ndarray) -> list[set[int]]:
    """The ids that each lane has got, without "none"."""
    return [set(ids[(owners == number) & (ids >= 0)].tolist()) for number in range(int(owners.max()) + 1)]


def nothing(frames: int = 3) -> DetectedSequence:
    """Frames in which nothing was found."""
    return DetectedSequence.of_frames([DetectedFrame(n, n / FPS, Detections.empty(2)) for n in range(frames)])


def leaves_and_comes() -> DetectedSequence:
    """One that leaves over the right border of a picture of 480 x 640 px, and one that looks the same comes in there.

    The picture's size is not told.
    """

    def where(frame: int) -> tuple[float, float] | None:
        if 10 <= frame < 20:
            return None
        return (560.0 + 8 * frame, 200.0) if frame < 10 else (650.0 - 4 * (frame - 20), 200.0)

    return make_sequence([where], 30)[0]
