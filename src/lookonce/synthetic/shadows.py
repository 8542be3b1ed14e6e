"""Shadows of vehicles and people on the ground, and the light of headlights on it, as masks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from lookonce.synthetic.camera import NEAR_M, Camera, clip_near
from lookonce.synthetic.footprints import corners_of
from lookonce.synthetic.light import Light
from lookonce.synthetic.projecting import Placed

__all__ = ["beam_mask", "contact_mask", "shadow_mask"]

Floats = NDArray[np.float64]

_COARSE = 2  # masks are drawn so many times coarser
_BEAM = np.array([(0.3, 0.75), (5.0, 1.5), (14.0, 2.5), (14.0, -2.5), (5.0, -1.5), (0.3, -0.75)])


def _fill(mask: Image.Image, polygons: Floats, camera: Camera, shift: tuple[float, float], value: int) -> None:
    """Draw into ``mask`` polygons ``(K, n, 3)`` in m."""
    if not len(polygons):
        return
    brush = ImageDraw.Draw(mask)
    count, sides = polygons.shape[:2]
    seen = camera.to_camera(polygons.reshape(-1, 3))
    px = ((camera.to_picture(seen) + np.array(shift)) / _COARSE - 0.5).reshape(count, -1).tolist()
    is_near: NDArray[np.bool_] = (seen[:, 2] < NEAR_M).reshape(count, sides)
    behind: list[int] = is_near.sum(axis=1).tolist()
    for number, hidden in enumerate(behind):
        if hidden == sides:
            continue
        corners = px[number]
        if hidden:
            cut = camera.to_picture(clip_near(seen[number * sides : (number + 1) * sides])) + np.array(shift)
            corners = (cut / _COARSE - 0.5).ravel().tolist()
        brush.polygon(corners, fill=value)


def _finish(mask: Image.Image, size: tuple[int, int], blur_px: float) -> Image.Image:
    blurred = mask.filter(ImageFilter.BoxBlur(blur_px * size[1] / 960))
    return blurred.resize((size[1], size[0]), Image.Resampling.BILINEAR)


def _blank(size: tuple[int, int]) -> Image.Image:
    return Image.new("L", (size[1] // _COARSE, size[0] // _COARSE))


def shadow_mask(placed: Sequence[Placed], camera: Camera, light: Light, shift: tuple[float, float]) -> Image.Image:
    """Where bodies hold off the sun, "L" of the picture's size, 255 = wholly."""
    mask = _blank(camera.size)
    reach = -light.towards_sun[:2] / light.towards_sun[2]
    middles = np.array([(one.x, one.y) for one in placed]).reshape(-1, 2)
    yaws = np.array([one.yaw for one in placed])
    sizes = np.array([one.body.size for one in placed]).reshape(-1, 3)
    is_small = sizes[:, 0] < 2.3
    is_box = sizes[:, 2] > 2.3
    quads = []
    for long, wide, low, high in ((1.0, 1.0, 0.0, 0.58), (0.62, 0.86, 0.5, 1.0)):
        tops = np.where(is_box, 1.0, high) * sizes[:, 2]
        length = np.where(is_box, 1.0, long) * np.where(is_small, sizes[:, 0] * 0.75, sizes[:, 0])
        width = np.where(is_small, 0.38, np.where(is_box, 1.0, wide) * sizes[:, 1])
        corners = corners_of(middles, yaws, length, width)
        base = corners + (low * sizes[:, 2])[:, None, None] * reach
        top = corners + tops[:, None, None] * reach
        quads += [base, top]
        for k in range(4):
            quads.append(np.stack([base[:, k], base[:, k - 1], top[:, k - 1], top[:, k]], axis=1))
    flat = np.concatenate(quads)
    _fill(mask, np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2), camera, shift, 255)
    return _finish(mask, camera.size, 1.0)


def contact_mask(placed: Sequence[Placed], camera: Camera, shift: tuple[float, float]) -> Image.Image:
    """Where little light of the sky comes, under and around bodies, "L" of the picture's size."""
    mask = _blank(camera.size)
    middles = np.array([(one.x, one.y) for one in placed]).reshape(-1, 2)
    yaws = np.array([one.yaw for one in placed])
    sizes = np.array([one.body.size for one in placed]).reshape(-1, 3)
    for margin, value in ((0.5, 70), (0.15, 150)):
        width = np.where(sizes[:, 0] < 2.3, 0.25, sizes[:, 1]) + margin
        corners = corners_of(middles, yaws, sizes[:, 0] + margin, width)
        _fill(mask, np.concatenate([corners, np.zeros((len(corners), 4, 1))], axis=2), camera, shift, value)
    return _finish(mask, camera.size, 2.0)


def beam_mask(placed: Sequence[Placed], camera: Camera, light: Light, shift: tuple[float, float]) -> Image.Image:
    """Where headlights shine on the ground, "L" of the picture's size."""
    mask = _blank(camera.size)
    rows = [one for one in placed if one.body.size[0] > 1.9]
    for far, value in ((1.0, 46), (0.72, 84), (0.48, 120)):
        beams = []
        for one in rows:
            cos, sin = np.cos(one.yaw), np.sin(one.yaw)
            x = one.body.size[0] / 2 + _BEAM[:, 0] * far
            y = _BEAM[:, 1] * far * one.body.size[1] / 1.8
            beams.append(np.stack([one.x + x * cos - y * sin, one.y + x * sin + y * cos, 0 * x], axis=1))
        if beams:
            _fill(mask, np.array(beams), camera, shift, round(value * light.lamps))
    return _finish(mask, camera.size, 4.0)
