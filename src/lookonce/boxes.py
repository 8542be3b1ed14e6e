"""Box arithmetic: the only intersections over union or over one box, and the only conversions of the package.

Layouts: ``xyxy`` = left, top, right, bottom; ``ltwh`` = left, top, width, height; all in pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["FARTHEST_PX", "clip", "iou", "iou_of_pairs", "share_inside", "xyxy_to_ltwh"]

FARTHEST_PX = 1e7
"""No box of a picture lies farther out; areas of such boxes are still exact enough."""

_LEAST_AREA = float(np.finfo(np.float32).tiny)
_EPS = float(np.finfo(np.float64).eps)


def xyxy_to_ltwh(xyxy: NDArray[np.float32]) -> NDArray[np.float32]:
    """Boxes ``xyxy (N, 4)`` as ``ltwh (N, 4)``, same dtype; 0 rows give 0 rows."""
    ltwh = xyxy.copy()
    ltwh[:, 2:] -= xyxy[:, :2]
    return ltwh


def clip(xyxy: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Boxes ``xyxy (N, 4)`` cut at the border of an image of ``size`` (height, width) pixels; a copy."""
    height, width = size
    limit = np.array([width, height, width, height], dtype=xyxy.dtype)
    return np.clip(xyxy, 0, limit)


def iou(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    """Intersection over union of every pair.

    Args:
        a: xyxy (N, 4).
        b: xyxy (M, 4).

    Returns:
        (N, M) in [0, 1]; 0 where both boxes are empty.

    >>> import numpy as np
    >>> iou(np.array([[0, 0, 2, 2]], np.float32), np.array([[1, 0, 3, 2]], np.float32)).round(3).tolist()
    [[0.3330000042915344]]
    """
    top_left = np.maximum(a[:, None, :2], b[None, :, :2])
    bottom_right = np.minimum(a[:, None, 2:], b[None, :, 2:])
    intersection: NDArray[np.float32] = np.prod(np.clip(bottom_right - top_left, 0, None), axis=2)
    area_a = np.prod(a[:, 2:] - a[:, :2], axis=1)
    area_b = np.prod(b[:, 2:] - b[:, :2], axis=1)
    union = area_a[:, None] + area_b[None, :] - intersection
    overlap = np.zeros_like(intersection)
    np.divide(intersection, union, out=overlap, where=union > 0)
    return overlap


def iou_of_pairs(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Intersection over union of each row of ``a`` (N, 4) xyxy with the same row of ``b``: (N,), as ``iou`` has it.

    >>> import numpy as np
    >>> iou_of_pairs(np.array([[0, 0, 2.0, 2]]), np.array([[1, 0, 3.0, 2]])).round(3).tolist()
    [0.333]
    """
    low_a, high_a, low_b, high_b = a.T[:2], a.T[2:], b.T[:2], b.T[2:]  # (2, N) each, x before y
    common = np.minimum(high_a, high_b)
    common -= np.maximum(low_a, low_b)
    np.maximum(common, 0.0, out=common)
    size_a, size_b = high_a - low_a, high_b - low_b
    overlap: NDArray[np.float64] = common[0] * common[1]
    union = size_a[0] * size_a[1]
    union += size_b[0] * size_b[1]
    union -= overlap
    overlap /= np.maximum(union, _LEAST_AREA, out=union)
    return overlap


def share_inside(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much of each box lies in each of some others: intersection over the box's own area.

    Args:
        a: xyxy (N, 4).
        b: xyxy (M, 4).

    Returns:
        (N, M) in [0, 1]; 0 where the box of ``a`` has no area.

    >>> import numpy as np
    >>> share_inside(np.array([[0, 0, 2.0, 2]]), np.array([[1, 0, 9.0, 9], [-9, -9, 9.0, 9]])).tolist()
    [[0.5, 1.0]]
    """
    sides = np.minimum(a[:, None, 2:], b[None, :, 2:]) - np.maximum(a[:, None, :2], b[None, :, :2])
    np.maximum(sides, 0.0, out=sides)
    area = ((a[:, 2] - a[:, 0]) * (a[:, 3] - a[:, 1]))[:, None]
    share = np.zeros(sides.shape[:2])
    np.divide(sides[..., 0] * sides[..., 1], area, out=share, where=area > _EPS)
    return share
