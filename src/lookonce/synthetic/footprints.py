"""Rectangles on the ground: do they overlap, and which hides which."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

__all__ = ["corners_of", "overlapping", "paint_order"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def corners_of(middles: Floats, yaws: Floats, lengths: Floats, widths: Floats) -> Floats:
    """Corners ``(N, 4, 2)``, counter-clockwise, of rectangles around ``middles (N, 2)``; angles (N,) in rad."""
    cos, sin = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    x = lengths[:, None] / 2 * np.array([1, -1, -1, 1])
    y = widths[:, None] / 2 * np.array([1, 1, -1, -1])
    return np.stack([middles[:, :1] + x * cos - y * sin, middles[:, 1:] + x * sin + y * cos], axis=2)


def _edges(corners: Floats) -> tuple[Floats, Floats]:
    """Outward unit normals ``(N, 4, 2)`` and offsets ``(N, 4)`` of the edges."""
    ways = np.roll(corners, -1, axis=1) - corners
    normals = np.stack([ways[..., 1], -ways[..., 0]], axis=2)
    normals /= np.maximum(np.hypot(normals[..., :1], normals[..., 1:]), 1e-12)
    return normals, (normals * corners).sum(axis=2)


def _outside(edges: tuple[Floats, Floats], corners: Floats, first: Ints, second: Ints) -> tuple[Floats, Ints]:
    """How far outside the farthest edge of ``first`` (K,) ``second`` (K,) are, m, and which edge it is."""
    normals, offsets = edges
    x = normals[first, :, None, 0] * corners[second, None, :, 0]
    y = normals[first, :, None, 1] * corners[second, None, :, 1]
    gaps = (x + y).min(axis=2) - offsets[first]
    best = gaps.argmax(axis=1)
    return gaps[np.arange(len(best)), best], best


def overlapping(corners: Floats) -> tuple[Ints, Ints]:
    """The pairs i < j of rectangles ``(N, 4, 2)`` that overlap: their numbers, (K,) each."""
    middles = corners.mean(axis=1)
    reach = np.hypot(*(corners[:, 0] - middles).T)
    apart = np.hypot(middles[:, None, 0] - middles[None, :, 0], middles[:, None, 1] - middles[None, :, 1])
    first, second = np.nonzero(np.triu(apart < reach[:, None] + reach[None], 1))
    edges = _edges(corners)
    outside, _ = _outside(edges, corners, first, second)
    outside_other, _ = _outside(edges, corners, second, first)
    hit = np.maximum(outside, outside_other) < 0
    return first[hit], second[hit]


def paint_order(corners: Floats, camera: tuple[float, float], boxes: Floats, distances: Floats) -> list[int]:
    """An order in which what is behind comes before what hides it.

    Two rectangles that do not overlap have a line between them along an edge of one; who is on the camera's side of it
    is in front. Where that leads in a circle, the farthest goes first.

    Args:
        corners: footprints (N, 4, 2) in m.
        camera: x and y in m.
        boxes: xyxy (N, 4), px; only things that overlap in the picture need an order.
        distances: (N,) m, from the camera.
    """
    meet = (boxes[:, None, :2] < boxes[None, :, 2:]).all(axis=2) & (boxes[None, :, :2] < boxes[:, None, 2:]).all(axis=2)
    first, second = np.nonzero(np.triu(meet, 1))
    normals, offsets = _edges(corners)
    heights = normals[..., 0] * camera[0] + normals[..., 1] * camera[1] - offsets  # of the camera outside of edges
    gap, edge = _outside((normals, offsets), corners, first, second)
    other_gap, other_edge = _outside((normals, offsets), corners, second, first)
    first_hides = np.where(gap >= other_gap, heights[first, edge] < 0, heights[second, other_edge] > 0)
    unclear = np.maximum(gap, other_gap) < 0
    first_hides = np.where(unclear, distances[first] < distances[second], first_hides)
    front, behind = np.where(first_hides, first, second), np.where(first_hides, second, first)
    return _sorted(front.tolist(), behind.tolist(), distances)


def _sorted(front: list[int], behind: list[int], distances: Floats) -> list[int]:
    """Topological order, farthest first."""
    waiting = [0] * len(distances)  # how many must be painted before i
    after: list[list[int]] = [[] for _ in waiting]
    for i, j in zip(front, behind, strict=True):
        after[j].append(i)
        waiting[i] += 1
    ranks = [(-float(distance), number) for number, distance in enumerate(distances)]
    ready = [rank for rank in ranks if not waiting[rank[1]]]
    heapq.heapify(ready)
    rest = sorted(ranks)
    done = [False] * len(ranks)
    order: list[int] = []
    while len(order) < len(ranks):
        if ready:
            number = heapq.heappop(ready)[1]
        else:
            number = next(rank[1] for rank in rest if not done[rank[1]])
        if done[number]:
            continue
        done[number] = True
        order.append(number)
        for other in after[number]:
            waiting[other] -= 1
            if not waiting[other] and not done[other]:
                heapq.heappush(ready, ranks[other])
    return order
