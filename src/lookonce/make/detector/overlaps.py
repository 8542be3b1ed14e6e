"""Overlap of boxes in PyTorch, row by row, with gradients."""

from __future__ import annotations

import math

import torch
from torch import Tensor

__all__ = ["complete_iou", "generalized_iou", "pair_iou", "row_iou", "shape_iou"]

_EPSILON = 1e-7


def row_iou(a: Tensor, b: Tensor) -> Tensor:
    """Intersection over union of each row of xyxy (N, 4) with the same row of the other, (N,)."""
    intersection, union = _areas(a, b)
    return intersection / (union + _EPSILON)


def generalized_iou(a: Tensor, b: Tensor) -> Tensor:
    """GIoU (Rezatofighi et al. 2019) of rows, (N,) in (-1, 1]: less than 0 where boxes are apart."""
    intersection, union = _areas(a, b)
    hull = _hull(a, b).prod(1)
    return intersection / (union + _EPSILON) - (hull - union) / (hull + _EPSILON)


def complete_iou(a: Tensor, b: Tensor) -> Tensor:
    """CIoU (Zheng et al. 2020) of rows, (N,): overlap, less distance of the centres, less difference of aspect."""
    overlap = row_iou(a, b)
    apart = ((a[:, :2] + a[:, 2:] - b[:, :2] - b[:, 2:]) / 2).square().sum(1)
    diagonal = _hull(a, b).square().sum(1)
    slant = _slant(a) - _slant(b)
    aspect = (4 / math.pi**2) * slant.square()
    with torch.no_grad():
        weight = aspect / (1 - overlap + aspect + _EPSILON)
    return overlap - apart / (diagonal + _EPSILON) - weight * aspect


def pair_iou(a: Tensor, b: Tensor) -> Tensor:
    """Intersection over union of every pair of xyxy (N, 4) and (M, 4), (N, M)."""
    corner = torch.minimum(a[:, None, 2:], b[None, :, 2:]) - torch.maximum(a[:, None, :2], b[None, :, :2])
    intersection = corner.clamp(min=0).prod(2)
    union = (a[:, 2:] - a[:, :2]).prod(1)[:, None] + (b[:, 2:] - b[:, :2]).prod(1)[None] - intersection
    return intersection / (union + _EPSILON)


def shape_iou(a: Tensor, b: Tensor) -> Tensor:
    """IoU of sizes (width, height) (N, 2) and (M, 2) laid on one corner, (N, M)."""
    common = torch.minimum(a[:, None], b[None]).prod(2)
    return common / (a.prod(1)[:, None] + b.prod(1)[None] - common)


def _areas(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    corner = torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])
    intersection = corner.clamp(min=0).prod(1)
    return intersection, (a[:, 2:] - a[:, :2]).prod(1) + (b[:, 2:] - b[:, :2]).prod(1) - intersection


def _hull(a: Tensor, b: Tensor) -> Tensor:
    """Width and height of the smallest box around both, (N, 2)."""
    return torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])


def _slant(a: Tensor) -> Tensor:
    extent = a[:, 2:] - a[:, :2]
    return torch.atan(extent[:, 0] / (extent[:, 1] + _EPSILON))
