"""All detections of a sequence, found once and given to every tracker."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import Detections, check_array, check_boxes, check_cameras, check_finite

__all__ = ["DEFAULT_FPS", "DetectedFrame", "DetectedSequence"]

DEFAULT_FPS = 25.0
"""Of detections whose frame rate nobody states."""


@dataclass(frozen=True, slots=True)
class DetectedFrame:
    """One frame.

    Attributes:
        index: its number in the source, from 0.
        time_s: when it was taken, s.
        detections: what was found in it.
        camera: (2, 3) float64, where pixels of the frame before are now; None: where they were, or nobody looked.
    """

    index: int
    time_s: float
    detections: Detections
    camera: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class DetectedSequence:
    """What was found in F frames, R rows in all, checked on construction; rows of a frame lie together.

    Attributes:
        frames: (F,) int64, rising, numbers of the frames in the source, from 0. A frame may hold nothing.
        times: (F,) float64, seconds, rising.
        starts: (F + 1,) int64: rows of frame f are ``starts[f]`` to ``starts[f + 1]``.
        xyxy: (R, 4) float32, px.
        scores: (R,) float32.
        labels: (R,) int64.
        descriptors: (R, D) float32, rows of unit length or zeros; None where there are none.
        match_threshold: calibrated largest distance of one object's descriptors; 0 = not known.
        size: (height, width) of the pictures, px; None = not known.
        cameras: how the camera moved where that was looked for: taking every so many-th frame -> number of a frame in
            which it did -> (2, 3) float64 map from the frame before, px.

    Raises:
        ValueError: a field has another shape, dtype or range.
    """

    frames: NDArray[np.int64]
    times: NDArray[np.float64]
    starts: NDArray[np.int64]
    xyxy: NDArray[np.float32]
    scores: NDArray[np.float32]
    labels: NDArray[np.int64]
    descriptors: NDArray[np.float32] | None = None
    match_threshold: float = 0.0
    size: tuple[int, int] | None = None
    cameras: Mapping[int, Mapping[int, NDArray[np.float64]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_array("frames", self.frames, (None,), np.int64)
        if len(self.frames) and (self.frames[0] < 0 or (np.diff(self.frames) <= 0).any()):
            raise ValueError("frames: expected 0 or more, each once and in rising order")
        check_array("times", self.times, (len(self.frames),), np.float64)
        check_finite("times", self.times)
        check_array("starts", self.starts, (len(self.frames) + 1,), np.int64)
        if self.starts[0] != 0 or (np.diff(self.starts) < 0).any() or self.starts[-1] != len(self.xyxy):
            raise ValueError("starts: expected rising numbers from 0 to the number of rows")
        check_boxes("xyxy", self.xyxy)
        Detections(self.xyxy, self.scores, self.labels, self.descriptors)  # checks the rest
        if self.size is not None and min(self.size) < 1:
            raise ValueError(f"size: expected (height, width) in px, got {self.size}")
        for maps in self.cameras.values():
            if maps:
                check_cameras("cameras", np.array(list(maps.values())))

    def __len__(self) -> int:
        return len(self.xyxy)

    def __iter__(self) -> Iterator[DetectedFrame]:
        maps = self.cameras.get(1, {})
        for number, (index, time_s) in enumerate(zip(self.frames.tolist(), self.times.tolist(), strict=True)):
            rows = slice(int(self.starts[number]), int(self.starts[number + 1]))
            descriptors = None if self.descriptors is None else self.descriptors[rows]
            found = Detections(self.xyxy[rows], self.scores[rows], self.labels[rows], descriptors)
            yield DetectedFrame(index, time_s, found, maps.get(index))

    @property
    def row_frames(self) -> NDArray[np.int64]:
        """(R,) int64, the frame number of each row."""
        return np.repeat(self.frames, np.diff(self.starts))

    @property
    def fps(self) -> float:
        """Frames per second of these frames, by their times."""
        span = float(self.times[-1] - self.times[0]) if len(self.times) > 1 else 0.0
        return (len(self.times) - 1) / span if span > 0 else DEFAULT_FPS

    def rows(self, is_kept: NDArray[np.bool_]) -> DetectedSequence:
        """The same frames with the chosen rows only; ``is_kept`` (R,)."""
        counts = np.concatenate([[0], np.cumsum(is_kept)])
        return replace(
            self,
            starts=counts[self.starts].astype(np.int64),
            xyxy=self.xyxy[is_kept],
            scores=self.scores[is_kept],
            labels=self.labels[is_kept],
            descriptors=None if self.descriptors is None else self.descriptors[is_kept],
        )

    def every(self, step: int) -> DetectedSequence:
        """The frames whose number is a multiple of ``step``; the camera moved as was looked for at that rate."""
        chosen = self.frames % step == 0
        kept = self.rows(np.repeat(chosen, np.diff(self.starts)))
        starts = np.concatenate([[0], np.cumsum(np.diff(kept.starts)[chosen])]).astype(np.int64)
        cameras = {1: self.cameras[step]} if step in self.cameras else {}
        return replace(kept, frames=self.frames[chosen], times=self.times[chosen], starts=starts, cameras=cameras)

    @classmethod
    def of_frames(
        cls, frames: list[DetectedFrame], match_threshold: float = 0.0, size: tuple[int, int] | None = None
    ) -> DetectedSequence:
        """Frames one after the other, with descriptors if all that hold rows have them."""
        parts = [frame.detections for frame in frames]
        with_rows = [part for part in parts if len(part)] or parts[:1]
        described = [part.descriptors for part in with_rows if part.descriptors is not None]
        has_all = bool(described) and len(described) == len(with_rows)
        return cls(
            np.array([frame.index for frame in frames], np.int64),
            np.array([frame.time_s for frame in frames], np.float64),
            np.cumsum([0, *(len(part) for part in parts)]).astype(np.int64),
            np.concatenate([np.zeros((0, 4), np.float32), *(part.xyxy for part in parts)]),
            np.concatenate([np.zeros(0, np.float32), *(part.scores for part in parts)]),
            np.concatenate([np.zeros(0, np.int64), *(part.labels for part in parts)]),
            np.concatenate(described) if has_all else None,
            match_threshold,
            size,
        )
