"""The camera: from metres in the world to px in the picture.

World: x and y in the plane of the ground, z up, metres. Camera: x right, y down, z ahead. Picture: px, the corner of
the left top pixel is (0, 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["NEAR_M", "Camera", "clip_near"]

Floats = NDArray[np.float64]

NEAR_M = 0.7  # nothing nearer than this is drawn


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera on a pole.

    Attributes:
        position: x, y, z in m.
        yaw_rad: where it looks, in the plane, counter-clockwise from x.
        pitch_rad: how far it looks down.
        focal_px: focal length in px.
        size: (height, width) of the picture in px.
        rotation: (3, 3), world to camera; follows from the angles.
    """

    position: tuple[float, float, float]
    yaw_rad: float
    pitch_rad: float
    focal_px: float
    size: tuple[int, int]
    rotation: Floats = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        cos_yaw, sin_yaw = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        cos_pitch, sin_pitch = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        right = np.array([sin_yaw, -cos_yaw, 0.0])
        ahead = np.array([cos_yaw * cos_pitch, sin_yaw * cos_pitch, -sin_pitch])
        object.__setattr__(self, "rotation", np.stack([right, np.cross(ahead, right), ahead]))

    def to_camera(self, points: Floats) -> Floats:
        """World points ``(N, 3)`` in camera coordinates ``(N, 3)``, m."""
        offset = points - np.array(self.position)
        x, y, z = offset[:, :1], offset[:, 1:2], offset[:, 2:]
        turned: Floats = x * self.rotation[:, 0] + y * self.rotation[:, 1] + z * self.rotation[:, 2]
        return turned  # sums in a fixed order, unlike a matrix product's

    def to_picture(self, points: Floats) -> Floats:
        """Camera coordinates ``(N, 3)`` in px ``(N, 2)``; points nearer than ``NEAR_M`` are moved there."""
        height, width = self.size
        scale = self.focal_px / np.maximum(points[:, 2:], NEAR_M)
        middle = np.array([width / 2, height / 2])
        projected: Floats = points[:, :2] * scale + middle
        return projected

    def ground_rays(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats, Floats]:
        """Where the rays through pixels meet the ground.

        Args:
            columns: (W,) px.
            rows: (H,) px.

        Returns:
            x and y ``(H, W)`` in m, and the distance along the plane ``(H, W)``; infinite above the horizon.
        """
        height, width = self.size
        right, down, ahead = self.rotation
        u = ((columns - width / 2) / self.focal_px)[None, :]
        v = ((rows - height / 2) / self.focal_px)[:, None]
        fall = -(ahead[2] + u * right[2] + v * down[2])
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(fall > 1e-6, self.position[2] / fall, np.inf)
            x = self.position[0] + reach * (ahead[0] + u * right[0] + v * down[0])
            y = self.position[1] + reach * (ahead[1] + u * right[1] + v * down[1])
            distance = np.hypot(x - self.position[0], y - self.position[1])
        return x, y, np.where(np.isfinite(distance), distance, np.inf)


def clip_near(points: Floats) -> Floats:
    """The part of a polygon ``(N, 3)`` in camera coordinates that is not nearer than ``NEAR_M``; maybe 0 rows."""
    kept: list[Floats] = []
    for here, there in zip(points, np.roll(points, -1, axis=0), strict=True):
        if here[2] >= NEAR_M:
            kept.append(here)
        if (here[2] >= NEAR_M) != (there[2] >= NEAR_M):
            share = (NEAR_M - here[2]) / (there[2] - here[2])
            kept.append(here + share * (there - here))
    return np.array(kept, np.float64).reshape(-1, 3)
