"""The values that cross the borders between the parts: detections and tracks. Row order is a promise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.stories import FrameStory

__all__ = [
    "NO_ID",
    "Detections",
    "Filled",
    "GivenBack",
    "Track",
    "Tracks",
    "check_array",
    "check_boxes",
    "check_cameras",
    "check_finite",
    "class_name",
    "has_unit_length",
]

_LEAST_GROWTH = 1e-4  # of areas from one frame to the next; also what it may be at most, the other way round

NO_ID = -1
"""The id of a row that has no identity (yet)."""


def class_name(names: Sequence[str], label: int) -> str:
    """The name of class ``label``; its number where ``names`` does not reach.

    >>> class_name(["person", "car"], 1), class_name([], 7)
    ('car', '7')
    """
    return names[label] if 0 <= label < len(names) else str(label)


_UNIT_LENGTH_TOLERANCE = 1e-3  # float16 storage of a unit vector stays within this


def check_array(name: str, array: object, shape: tuple[int | None, ...], dtype: type) -> None:
    """Raise ``ValueError`` unless ``array`` has that shape (one or two sizes, None = any) and dtype."""
    if (
        isinstance(array, np.ndarray)
        and array.dtype == dtype
        and array.ndim == len(shape)
        and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
    ):
        return
    letters = ", ".join(letter if n is None else str(n) for letter, n in zip("ND", shape, strict=False))
    comma = "," if len(shape) == 1 else ""
    got = f"{array.shape} {array.dtype}" if isinstance(array, np.ndarray) else type(array).__name__
    raise ValueError(f"{name}: expected ({letters}{comma}) {np.dtype(dtype).name}, got {got}")


def check_finite(name: str, array: NDArray[np.floating]) -> None:
    """Raise ``ValueError`` for NaN or infinity."""
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite numbers, got NaN or infinity")


def check_cameras(name: str, maps: NDArray[np.float64]) -> None:
    """Raise ``ValueError`` unless all of ``maps`` (K, 2, 3) float64 are finite and can be undone."""
    if not (isinstance(maps, np.ndarray) and maps.shape[1:] == (2, 3) and maps.dtype == np.float64):
        raise ValueError(f"{name}: expected affine maps (2, 3) float64, got another shape or dtype")
    check_finite(name, maps)
    with np.errstate(over="ignore", invalid="ignore"):
        growth = np.abs(maps[:, 0, 0] * maps[:, 1, 1] - maps[:, 0, 1] * maps[:, 1, 0])
    is_possible = (growth >= _LEAST_GROWTH) & (growth <= 1 / _LEAST_GROWTH)
    if not is_possible.all():
        times = growth[~is_possible][0]
        raise ValueError(f"{name}: expected an affine map that can be undone, got one that makes areas {times:g} times")


def check_boxes(name: str, xyxy: NDArray[np.float32]) -> None:
    """Raise ``ValueError`` unless ``xyxy`` is (N, 4) float32, finite, left < right and top < bottom."""
    check_array(name, xyxy, (None, 4), np.float32)
    check_finite(name, xyxy)
    if (xyxy[:, 2:] <= xyxy[:, :2]).any():
        raise ValueError(f"{name}: expected left < right and top < bottom, got a box of zero or negative size")


def has_unit_length(descriptors: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,) bool: which rows of ``descriptors`` (N, D) are of unit length, and so finite.

    >>> has_unit_length(np.array([[0.6, 0.8], [0, 0], [np.nan, 1]], np.float32)).tolist()
    [True, False, False]
    """
    squared = np.einsum("nd,nd->n", descriptors, descriptors)
    is_unit: NDArray[np.bool_] = np.abs(squared - 1) <= 2 * _UNIT_LENGTH_TOLERANCE  # False for NaN and infinity, too
    return is_unit


@dataclass(frozen=True, slots=True)
class Detections:
    """What the detector saw in one frame, checked on construction.

    Attributes:
        xyxy: (N, 4) float32, px of the original image, left < right and top < bottom.
        scores: (N,) float32, confidence in [0, 1].
        labels: (N,) int64, index into the model's class names.
        descriptors: (N, D) float32, rows of unit length (a row of zeros: this detection has none), or None where the
            model has no descriptors.

    Raises:
        ValueError: a field has another shape, dtype, row count, or is not finite.
    """

    xyxy: NDArray[np.float32]
    scores: NDArray[np.float32]
    labels: NDArray[np.int64]
    descriptors: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        check_boxes("xyxy", self.xyxy)
        count = len(self.xyxy)
        check_array("scores", self.scores, (count,), np.float32)
        check_array("labels", self.labels, (count,), np.int64)
        check_finite("scores", self.scores)
        if self.descriptors is not None:
            self._check_descriptors(self.descriptors, count)

    @staticmethod
    def _check_descriptors(descriptors: NDArray[np.float32], count: int) -> None:
        check_array("descriptors", descriptors, (count, None), np.float32)
        is_zero = np.einsum("nd,nd->n", descriptors, descriptors) == 0
        if not (has_unit_length(descriptors) | is_zero).all():
            raise ValueError("descriptors: expected rows of unit length (or zeros), got another length")

    def __len__(self) -> int:
        return len(self.xyxy)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Detections:
        """The chosen rows (a mask, indices or a slice), all fields kept aligned."""
        descriptors = None if self.descriptors is None else self.descriptors[rows]
        return Detections(self.xyxy[rows], self.scores[rows], self.labels[rows], descriptors)

    @classmethod
    def empty(cls, descriptor_size: int | None = None) -> Detections:
        """No detections, with descriptors of that size or without any."""
        return cls(
            np.zeros((0, 4), np.float32),
            np.zeros(0, np.float32),
            np.zeros(0, np.int64),
            None if descriptor_size is None else np.zeros((0, descriptor_size), np.float32),
        )


@dataclass(frozen=True, slots=True)
class Track:
    """One object in one frame: its identity, box ``xyxy (4,)`` in px, score, class index and class name."""

    id: int
    xyxy: NDArray[np.float32]
    score: float
    label: int
    name: str


@dataclass(frozen=True, slots=True)
class GivenBack:
    """Rows of earlier frames that get their identity now, because their object is confirmed only now.

    Attributes:
        frames: (G,) int64, the frame of each row, by the number that the tracker was given, or of its update from 0.
        rows: (G,) int64, its place among the rows of that frame.
        ids: (G,) int64.
        xyxy: (G, 4) float32, px of the original image, as in ``Tracks``.
        scores: (G,) float32.
        labels: (G,) int64.
    """

    frames: NDArray[np.int64]
    rows: NDArray[np.int64]
    ids: NDArray[np.int64]
    xyxy: NDArray[np.float32]
    scores: NDArray[np.float32]
    labels: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def nothing(cls) -> GivenBack:
        """No rows."""
        return _NOTHING


@dataclass(frozen=True, slots=True)
class Filled:
    """Boxes of objects that are seen again, for earlier frames in which nobody detected them.

    Attributes:
        frames: (F,) int64, by the number that the tracker was given, or of its update from 0.
        ids: (F,) int64.
        xyxy: (F, 4) float32, px of the original image: on the straight line between the boxes before and after,
            whatever the camera did.
        labels: (F,) int64.
    """

    frames: NDArray[np.int64]
    ids: NDArray[np.int64]
    xyxy: NDArray[np.float32]
    labels: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def nothing(cls) -> Filled:
        """No boxes."""
        return _NO_GAPS

    @classmethod
    def joined(cls, parts: Sequence[Filled]) -> Filled:
        """Those of all parts, at least one, in their order."""
        return cls(
            np.concatenate([part.frames for part in parts]),
            np.concatenate([part.ids for part in parts]),
            np.concatenate([part.xyxy for part in parts]),
            np.concatenate([part.labels for part in parts]),
        )


_NONE = np.zeros(0, np.int64)
_NOTHING = GivenBack(_NONE, _NONE, _NONE, np.zeros((0, 4), np.float32), np.zeros(0, np.float32), _NONE)
_NO_GAPS = Filled(_NONE, _NONE, np.zeros((0, 4), np.float32), _NONE)


@dataclass(frozen=True, slots=True)
class Tracks:
    """A tracker's answer for one frame: one row for each detection row, in the same order.

    Attributes:
        ids: (N,) int64, from 1; -1 = no identity (yet).
        xyxy: (N, 4) float32, px of the original image: the detections' boxes, which a preset may make steadier.
        scores: (N,) float32.
        labels: (N,) int64.
        unseen_ids: (U,) int64, objects that are alive and were not detected in this frame.
        unseen_xyxy: (U, 4) float32, where the tracker believes them to be.
        names: class names by label, where known.
        given_back: rows of earlier frames that belong to objects confirmed in this one.
        filled: boxes for earlier frames, of objects that were missed there and are seen again.
        story: why, where the tracker was asked to explain.
    """

    ids: NDArray[np.int64]
    xyxy: NDArray[np.float32]
    scores: NDArray[np.float32]
    labels: NDArray[np.int64]
    unseen_ids: NDArray[np.int64]
    unseen_xyxy: NDArray[np.float32]
    names: tuple[str, ...] = ()
    given_back: GivenBack = _NOTHING
    filled: Filled = _NO_GAPS
    story: FrameStory | None = None

    def __len__(self) -> int:
        return len(self.ids)

    def identified(self) -> Tracks:
        """The same with only the rows that have an identity; without the story, which goes by rows."""
        rows = self.ids != NO_ID
        own = self.ids[rows], self.xyxy[rows], self.scores[rows], self.labels[rows]
        return Tracks(*own, self.unseen_ids, self.unseen_xyxy, self.names, self.given_back, self.filled)

    def __iter__(self) -> Iterator[Track]:
        """The rows that have an identity."""
        for row in np.flatnonzero(self.ids != NO_ID):
            label = int(self.labels[row])
            name = class_name(self.names, label)
            yield Track(int(self.ids[row]), self.xyxy[row], float(self.scores[row]), label, name)
