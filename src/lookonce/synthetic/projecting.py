"""Bodies in their places, as coloured polygons in the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.body import Body
from lookonce.synthetic.camera import NEAR_M, Camera, clip_near
from lookonce.synthetic.light import Light
from lookonce.synthetic.shading import Exposure, shade_capsules, shade_faces

__all__ = ["Outline", "Placed", "project"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Colour = tuple[int, int, int]

_ARC = 6  # corners of a capsule's end
_HIGHLIGHT_PX = 1.2  # limbs thinner than this get none


@dataclass(frozen=True, slots=True)
class Placed:
    """A body in the world.

    Attributes:
        body: what.
        x: m, of its middle.
        y: m.
        yaw: rad, where it looks.
        sun: share of the sun that reaches it.
        lamps: light of street lamps, 0 to 1.
        is_braking: whether brake lights are on.
    """

    body: Body
    x: float
    y: float
    yaw: float
    sun: float = 1.0
    lamps: float = 0.0
    is_braking: bool = False


@dataclass(frozen=True, slots=True)
class Outline:
    """A body in the picture, as polygons in painting order.

    Attributes:
        corners: (K, 2) px, polygon after polygon.
        counts: corners of each polygon.
        colours: of each polygon.
        xyxy: (4,) px, the extent, not cut at the picture's border; no extent = it is behind the camera.
    """

    corners: Floats
    counts: list[int]
    colours: list[Colour]
    xyxy: Floats


def project(placed: Sequence[Placed], camera: Camera, light: Light, shift: tuple[float, float]) -> list[Outline]:
    """Every body in the picture, whether inside or not.

    Args:
        placed: bodies.
        camera: where it is seen from.
        light: of the moment.
        shift: px right and down by which the picture is off.
    """
    if not placed:
        return []
    faces = _project_faces(placed, camera, light, shift)
    limbs = _project_capsules(placed, camera, light, shift)
    return [
        Outline(
            np.concatenate([first.corners, second.corners]),
            first.counts + second.counts,
            first.colours + second.colours,
            np.concatenate([np.minimum(first.xyxy[:2], second.xyxy[:2]), np.maximum(first.xyxy[2:], second.xyxy[2:])]),
        )
        for first, second in zip(faces, limbs, strict=True)
    ]


def _split(owners: Ints, corners: Floats, counts: Ints, colours: NDArray[np.uint8], boxes: Floats) -> list[Outline]:
    """Outlines of each owner from polygons that come owner by owner."""
    number = np.arange(len(boxes) + 1)
    polygons = np.searchsorted(owners, number).tolist()
    ends = np.concatenate([[0], np.cumsum(counts)])[polygons].tolist()
    all_counts: list[int] = counts.tolist()
    all_colours: list[Colour] = [(red, green, blue) for red, green, blue in colours.tolist()]
    return [
        Outline(
            corners[ends[k] : ends[k + 1]],
            all_counts[polygons[k] : polygons[k + 1]],
            all_colours[polygons[k] : polygons[k + 1]],
            boxes[k],
        )
        for k in range(len(boxes))
    ]


def _to_world(points: Floats, owners: Ints, placed: Sequence[Placed]) -> Floats:
    places = np.array([(one.x, one.y, np.cos(one.yaw), np.sin(one.yaw)) for one in placed])[owners]
    cos, sin = places[:, 2], places[:, 3]
    x, y = points[:, 0], points[:, 1]
    return np.stack([x * cos - y * sin + places[:, 0], x * sin + y * cos + places[:, 1], points[:, 2]], axis=1)


_NOTHING = np.array([np.inf, np.inf, -np.inf, -np.inf])


def _boxes(points: Floats, owners: Ints, count: int) -> Floats:
    """The extents ``(count, 4)`` of points ``(K, 2)`` that come owner by owner."""
    boxes = np.tile(_NOTHING, (count, 1))
    if len(points):
        starts = np.flatnonzero(np.diff(owners, prepend=-1))
        boxes[owners[starts], :2] = np.minimum.reduceat(points, starts)
        boxes[owners[starts], 2:] = np.maximum.reduceat(points, starts)
    return boxes


def _project_faces(placed: Sequence[Placed], camera: Camera, light: Light, shift: tuple[float, float]) -> list[Outline]:
    bodies = [one.body for one in placed]
    face_owners = np.repeat(np.arange(len(bodies)), [len(body.surfaces) for body in bodies])
    corner_counts = np.concatenate([np.diff(body.bounds) for body in bodies])
    bounds = np.concatenate([[0], np.cumsum(corner_counts)])
    corner_owners = np.repeat(face_owners, corner_counts)
    world = _to_world(np.concatenate([body.corners for body in bodies]), corner_owners, placed)
    seen = camera.to_camera(world)
    px = camera.to_picture(seen) + np.array(shift)
    boxes = _boxes(px, corner_owners, len(bodies))
    chosen, colours = _visible_faces(placed, face_owners, boxes, camera, light)
    counts = corner_counts[chosen]
    starts = np.cumsum(counts) - counts
    rows = np.arange(int(counts.sum())) + np.repeat(bounds[chosen] - starts, counts)
    outlines = _split(face_owners[chosen], px[rows], counts, colours, boxes)
    for owner in np.unique(corner_owners[seen[:, 2] < NEAR_M]).tolist():
        mine = chosen[face_owners[chosen] == owner]
        faces = [clip_near(seen[bounds[face] : bounds[face + 1]]) for face in mine.tolist()]
        outlines[owner] = _clipped(faces, outlines[owner].colours, camera, shift)
    return outlines


def _clipped(faces: list[Floats], colours: list[Colour], camera: Camera, shift: tuple[float, float]) -> Outline:
    """The outline of faces in camera coordinates, of some of which nothing may be left."""
    kept = [number for number, face in enumerate(faces) if len(face)]
    corners = np.concatenate([np.zeros((0, 3)), *(faces[number] for number in kept)])
    px = camera.to_picture(corners) + np.array(shift)
    box = _boxes(px, np.zeros(len(px), np.int64), 1)[0]
    return Outline(px, [len(faces[number]) for number in kept], [colours[number] for number in kept], box)


def _visible_faces(
    placed: Sequence[Placed], owners: Ints, boxes: Floats, camera: Camera, light: Light
) -> tuple[Ints, NDArray[np.uint8]]:
    """The faces that look at the camera, in painting order, and their colours (K, 3)."""
    if not len(owners):
        return np.zeros(0, np.int64), np.zeros((0, 3), np.uint8)
    bodies = [one.body for one in placed]
    middles = _to_world(np.concatenate([body.middles for body in bodies]), owners, placed)
    normals = np.concatenate([body.normals for body in bodies])
    turns = np.array([(np.cos(one.yaw), np.sin(one.yaw)) for one in placed])[owners]
    normals = np.stack(
        [
            normals[:, 0] * turns[:, 0] - normals[:, 1] * turns[:, 1],
            normals[:, 0] * turns[:, 1] + normals[:, 1] * turns[:, 0],
            normals[:, 2],
        ],
        axis=1,
    )
    views = middles - np.array(camera.position)
    faces_us = (normals * views).sum(axis=1) < 0
    length_px = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
    shown = np.flatnonzero(faces_us & (np.concatenate([body.details for body in bodies]) <= length_px[owners]))
    layers, distances = _part_keys(placed, camera)
    first_part = np.concatenate([[0], np.cumsum([len(body.layers) for body in bodies])])
    parts = np.concatenate([body.parts for body in bodies]) + first_part[owners]
    order = np.lexsort((shown, -distances[parts[shown]], layers[parts[shown]], owners[shown]))
    chosen = shown[order]
    views = views[chosen] / np.maximum(np.sqrt((views[chosen] ** 2).sum(axis=1, keepdims=True)), 1e-9)
    own = owners[chosen]
    exposure = Exposure(
        np.array([one.sun for one in placed])[own],
        np.array([one.lamps for one in placed])[own],
        np.array([one.is_braking for one in placed])[own],
    )
    colours = shade_faces(
        np.concatenate([body.colours for body in bodies])[chosen],
        np.concatenate([body.surfaces for body in bodies])[chosen],
        normals[chosen],
        views,
        exposure,
        light,
    )
    return chosen, colours


def _part_keys(placed: Sequence[Placed], camera: Camera) -> tuple[Ints, Floats]:
    """Layers and squared distances of all parts."""
    layers = np.concatenate([one.body.layers for one in placed])
    owners = np.repeat(np.arange(len(placed)), [len(one.body.layers) for one in placed])
    middles = _to_world(np.concatenate([one.body.part_middles for one in placed]), owners, placed)
    return layers, ((middles - np.array(camera.position)) ** 2).sum(axis=1)


def _project_capsules(
    placed: Sequence[Placed], camera: Camera, light: Light, shift: tuple[float, float]
) -> list[Outline]:
    limbs = [one.body.capsules for one in placed]
    owners = np.repeat(np.arange(len(placed)), [len(limb.radii) for limb in limbs])
    starts = camera.to_camera(_to_world(np.concatenate([limb.starts for limb in limbs]), owners, placed))
    ends = camera.to_camera(_to_world(np.concatenate([limb.ends for limb in limbs]), owners, placed))
    depths = (starts[:, 2] + ends[:, 2]) / 2
    ahead = np.flatnonzero((starts[:, 2] >= NEAR_M) & (ends[:, 2] >= NEAR_M))
    shown = ahead[np.lexsort((ahead, -depths[ahead], owners[ahead]))]
    owners, starts, ends = owners[shown], starts[shown], ends[shown]
    radii = np.concatenate([limb.radii for limb in limbs])[shown]
    first, second = camera.to_picture(starts) + np.array(shift), camera.to_picture(ends) + np.array(shift)
    radii_px = radii * camera.focal_px / np.stack([starts[:, 2], ends[:, 2]], axis=1)
    rings = _rings(first, second, radii_px)
    offset = _highlight_offset(camera, light) * radii_px.mean(axis=1, keepdims=True)
    inner = _rings(first + offset, second + offset, radii_px * 0.62)
    colours = shade_capsules(
        np.concatenate([limb.colours for limb in limbs])[shown],
        np.array([one.sun for one in placed])[owners],
        np.array([one.lamps for one in placed])[owners],
        light,
    )
    drawn = np.stack([np.ones(len(shown), bool), radii_px.max(axis=1) > _HIGHLIGHT_PX], axis=1)
    corners = np.stack([rings, inner], axis=1)[drawn]
    boxes = _boxes(rings.reshape(-1, 2), np.repeat(owners, rings.shape[1]), len(placed))
    counts = np.full(len(corners), rings.shape[1])
    twice = np.repeat(owners[:, None], 2, axis=1)[drawn]
    return _split(twice, corners.reshape(-1, 2), counts, np.stack(colours, axis=1)[drawn], boxes)


def _highlight_offset(camera: Camera, light: Light) -> Floats:
    """Where on a round limb the light falls, in radii: right and down, (2,)."""
    towards = camera.rotation @ light.towards_sun
    flat: Floats = towards[:2] / max(float(np.hypot(towards[0], towards[1])), 1e-9)
    return 0.3 * flat


def _rings(starts: Floats, ends: Floats, radii: Floats) -> Floats:
    """Outlines ``(C, 2 * _ARC, 2)`` of capsules in the picture, px."""
    ways = ends - starts
    angles = np.arctan2(ways[:, 1], ways[:, 0])[:, None]
    turn = np.linspace(np.pi / 2, 3 * np.pi / 2, _ARC)[None]
    back = starts[:, None] + radii[:, :1, None] * np.stack([np.cos(angles + turn), np.sin(angles + turn)], axis=2)
    turn = turn - np.pi
    front = ends[:, None] + radii[:, 1:, None] * np.stack([np.cos(angles + turn), np.sin(angles + turn)], axis=2)
    return np.concatenate([back, front], axis=1)
