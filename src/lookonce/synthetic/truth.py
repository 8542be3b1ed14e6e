"""What is true of a frame, and what is left out of it and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import share_inside
from lookonce.datasets import LabelledObjects

__all__ = ["FrameTruth", "Seen", "assemble_truth", "ignored_boxes", "visibility_of"]

Floats = NDArray[np.float64]

IN_IGNORED, TOO_SMALL = "in an ignored region", "smaller than min_px"


@dataclass(frozen=True, slots=True)
class Seen:
    """One object whose body reaches into the picture.

    Attributes:
        identity: of the object.
        label: its class.
        kind: in words.
        xyxy: (4,) px, exact, cut at the border.
        visibility: share of its pixels in the picture that can be seen.
        hidden: xyxy (4,) px of its hidden pixels; zeros = none.
        hidden_by: identity of what hides most of it; -1 = something that stands, or nothing.
        truncation: share of its whole box that lies outside the picture.
        speed_m_s: how fast it moves.
        heading_deg: where it moves, counter-clockwise from the way the camera looks, 0 to 360.
    """

    identity: int
    label: int
    kind: str
    xyxy: Floats
    visibility: float
    hidden: tuple[float, float, float, float]
    hidden_by: int
    truncation: float = 0.0
    speed_m_s: float = 0.0
    heading_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class FrameTruth:
    """Objects of a frame, and in the same order what ``LabelledObjects`` has no place for.

    Attributes:
        objects: boxes, identities, classes, visibility.
        kinds: type of each in words, such as "van".
        hidden: (N, 4) float32, xyxy in px of each one's hidden pixels; zeros = none.
        hidden_by: (N,) int64, identity of what hides most of it; -1 = something that stands, or nothing.
        truncation: (N,) float32, share of each one's whole box that lies outside the picture.
        speed_m_s: (N,) float32.
        heading_deg: (N,) float32, counter-clockwise from the way the camera looks, 0 to 360.
        left_out: why -> objects that reach into the picture but are not among these.
    """

    objects: LabelledObjects
    kinds: tuple[str, ...]
    hidden: NDArray[np.float32]
    hidden_by: NDArray[np.int64]
    truncation: NDArray[np.float32]
    speed_m_s: NDArray[np.float32]
    heading_deg: NDArray[np.float32]
    left_out: dict[str, int]


def visibility_of(
    mask: NDArray[np.bool_], owners: NDArray[np.int32], number: int, corner: tuple[int, int]
) -> tuple[float, tuple[float, float, float, float], int]:
    """Visibility, extent of the hidden pixels, and number of what hides most.

    Args:
        mask: (h, w) the object's pixels.
        owners: (h, w) number of what is seen in each.
        number: the object's.
        corner: left, top of the mask in px.

    Returns:
        share seen (1 for an object without a whole pixel), xyxy of the hidden pixels (zeros = none), and the number,
        0 = something that stands, or nothing.
    """
    total = int(np.count_nonzero(mask))
    hidden = mask & (owners != number)
    count = int(np.count_nonzero(hidden))
    if not count:
        return 1.0, (0.0, 0.0, 0.0, 0.0), 0
    rows, columns = np.flatnonzero(hidden.any(axis=1)), np.flatnonzero(hidden.any(axis=0))
    left, top = corner
    extent = (
        float(left + columns[0]),
        float(top + rows[0]),
        float(left + columns[-1] + 1),
        float(top + rows[-1] + 1),
    )
    return 1 - count / total, extent, int(np.bincount(owners[hidden]).argmax())


def ignored_boxes(boxes: list[Floats], size: tuple[int, int]) -> NDArray[np.float32]:
    """Regions cut at the picture's border, in whole px, without those that are hardly there, (M, 4) float32."""
    height, width = size
    limit = np.array([width, height, width, height])
    cut = [np.clip(np.round(box), 0, limit) for box in boxes]
    kept = [box for box in cut if box[2] - box[0] >= 4 and box[3] - box[1] >= 4]
    return np.array(kept, np.float32).reshape(-1, 4)


def assemble_truth(seen: list[Seen], ignored: NDArray[np.float32], min_px: float) -> FrameTruth:
    """The truth of a frame, by rising identity.

    Left out, and counted: objects lower or narrower than ``min_px``, and objects of whose box more than half lies in
    one of the ``ignored`` regions (M, 4). Objects that are wholly hidden stay, with visibility 0.
    """
    left_out: dict[str, int] = {}
    kept: list[Seen] = []
    for one in sorted(seen, key=lambda one: one.identity):
        width, height = one.xyxy[2] - one.xyxy[0], one.xyxy[3] - one.xyxy[1]
        if min(width, height) < min_px:
            left_out[TOO_SMALL] = left_out.get(TOO_SMALL, 0) + 1
        elif share_inside(one.xyxy[None], ignored.astype(np.float64)).max(initial=0.0) > 0.5:
            left_out[IN_IGNORED] = left_out.get(IN_IGNORED, 0) + 1
        else:
            kept.append(one)
    objects = LabelledObjects(
        xyxy=np.array([one.xyxy for one in kept], np.float32).reshape(-1, 4),
        identities=np.array([one.identity for one in kept], np.int64),
        labels=np.array([one.label for one in kept], np.int64),
        visibility=np.array([one.visibility for one in kept], np.float32),
    )
    return FrameTruth(
        objects,
        tuple(one.kind for one in kept),
        np.array([one.hidden for one in kept], np.float32).reshape(-1, 4),
        np.array([one.hidden_by for one in kept], np.int64),
        np.array([one.truncation for one in kept], np.float32),
        np.array([one.speed_m_s for one in kept], np.float32),
        np.array([one.heading_deg for one in kept], np.float32),
        left_out,
    )
