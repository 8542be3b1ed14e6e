"""All that the following of a camera remembers, in one file, so that it goes on as if it had never stopped."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.array_file import read_arrays, write_arrays
from lookonce.camera.pictures import working_size
from lookonce.errors import FormatError
from lookonce.structures import check_array, check_finite

__all__ = ["CameraState", "read_state", "write_state"]

_FORMAT, _VERSION = "lookonce-camera", 1
_MOST_BYTES = 1_000_000_000  # a picture of 30,000 x 30,000 px
_MOST_ABOUT = 10_000  # bytes
_REMEDY = "give a file that CameraMotion.save wrote"
_MOST_BOXES = 100_000
_MOST_PX = 1 << 30  # of a frame's side
_FARTHEST_PX = 1e6  # of a motion
_LEAST_GROWTH = 0.1  # of areas by a motion; also what it may be at most, the other way round
_BRIGHTEST = 4 * 255  # quarters of a grey level

_ARRAYS: dict[str, type] = {
    "luma": np.uint8,
    "xyxy": np.float32,
    "reference": np.int16,
    "reference_boxes": np.float64,
    "motions": np.float64,
    "times": np.float64,
}


@dataclass(frozen=True, slots=True)
class CameraState:
    """What ``CameraMotion`` keeps from frame to frame.

    Attributes:
        is_still: whether the camera counts as still.
        has_step: whether the last motion is known.
        size: (height, width) of the last frame in px.
        luma: (h, w) uint8, its picture; (0, 0): there was no frame.
        xyxy: (M, 4) float32, its boxes in px.
        reference: (h', w') int16, first level of the picture that frames are compared with; (0, 0): there is none.
        reference_boxes: (K, 4) float64, the boxes in it, working px.
        motions: (3, 2, 3) float64, working px: from the reference to the last frame, since the camera was last said to
            move, and the last one.
        times: (4,) float64, s: of the last frame, of the reference, of the last motion, of the last look (-inf: none).

    Raises:
        ValueError: it cannot be the state of a camera.
    """

    is_still: bool
    has_step: bool
    size: tuple[int, int]
    luma: NDArray[np.uint8]
    xyxy: NDArray[np.float32]
    reference: NDArray[np.int16]
    reference_boxes: NDArray[np.float64]
    motions: NDArray[np.float64]
    times: NDArray[np.float64]

    def __post_init__(self) -> None:
        flags = (self.is_still, self.has_step)
        if not all(isinstance(flag, bool) for flag in flags):
            raise ValueError(f"is_still, has_step: expected true or false, got {flags}")
        sides = self.size
        if len(sides) != 2 or not all(type(side) is int and 0 < side <= _MOST_PX for side in sides):
            raise ValueError(f"size: expected height and width in px, got {sides}")
        check_array("luma", self.luma, (None, None), np.uint8)
        check_array("xyxy", self.xyxy, (None, 4), np.float32)
        check_finite("xyxy", self.xyxy)
        check_array("reference", self.reference, (None, None), np.int16)
        check_array("reference_boxes", self.reference_boxes, (None, 4), np.float64)
        check_finite("reference_boxes", self.reference_boxes)
        check_array("times", self.times, (4,), np.float64)
        check_finite("times", self.times[:3])
        if not self.times[3] < math.inf:
            raise ValueError("times: expected the last look to be a time, or -inf")
        if self.has_reference and self.reference.shape != working_size((self.luma.shape[0], self.luma.shape[1])):
            raise ValueError(f"reference: expected the size for {self.luma.shape} px, got {self.reference.shape}")
        if self.reference.size and not 0 <= int(self.reference.min()) <= int(self.reference.max()) <= _BRIGHTEST:
            raise ValueError("reference: expected quarters of grey levels")
        _check_motions(self.motions)
        if not self.is_still and not self.has_reference:
            raise ValueError("reference: expected a picture where the camera moves")

    @property
    def has_frame(self) -> bool:
        """Whether there was a frame."""
        return self.luma.shape != (0, 0)

    @property
    def has_reference(self) -> bool:
        """Whether there is a picture that frames are compared with."""
        return self.reference.shape != (0, 0)


def _check_motions(motions: NDArray[np.float64]) -> None:
    if motions.shape != (3, 2, 3) or motions.dtype != np.float64:
        raise ValueError(f"motions: expected (3, 2, 3) float64, got {motions.shape} {motions.dtype}")
    if not (np.abs(motions) <= _FARTHEST_PX).all():
        raise ValueError("motions: expected numbers that are finite, and not too large")
    growth = motions[:, 0, 0] * motions[:, 1, 1] - motions[:, 0, 1] * motions[:, 1, 0]
    if not ((growth >= _LEAST_GROWTH) & (growth <= 1 / _LEAST_GROWTH)).all():
        raise ValueError("motions: expected such as a camera makes")


def write_state(path: Path, state: CameraState) -> None:
    """Write it in one piece.

    Raises:
        OutputError: it cannot be written.
    """
    about = {"format": _FORMAT, "version": _VERSION, "size": list(state.size)}
    about |= {"is_still": state.is_still, "has_step": state.has_step}
    arrays = {name: getattr(state, name) for name in _ARRAYS}
    write_arrays(path, {"about": np.frombuffer(json.dumps(about).encode(), np.uint8), **arrays})


def read_state(path: Path) -> CameraState:
    """What ``write_state`` wrote.

    Raises:
        FormatError: the file is something else, of another version, damaged or cut short.
    """
    arrays = read_arrays(path, {"about": np.uint8} | _ARRAYS, _MOST_BYTES, _REMEDY)
    about = _about(path, arrays.pop("about", np.zeros(0, np.uint8)))
    try:
        if max(len(arrays["xyxy"]), len(arrays["reference_boxes"])) > _MOST_BOXES:
            raise ValueError(f"xyxy, reference_boxes: more than {_MOST_BOXES} boxes")
        return CameraState(about["is_still"], about["has_step"], tuple(about["size"]), **arrays)
    except (ValueError, KeyError, TypeError) as exc:
        raise FormatError(path, 0, f"holds what cannot be a camera's state ({exc}); {_REMEDY}") from exc


def _about(path: Path, text: NDArray[np.uint8]) -> dict[str, Any]:
    try:
        about = json.loads(text.tobytes().decode()) if 0 < text.size <= _MOST_ABOUT else None
    except (ValueError, RecursionError):
        about = None
    if not isinstance(about, dict) or about.get("format") != _FORMAT:
        raise FormatError(path, 0, f"is no camera's state; {_REMEDY}")
    if about.get("version") != _VERSION:
        raise FormatError(
            path, 0, f"of version {about.get('version')}, expected {_VERSION}; use the lookonce that wrote it"
        )
    return about
