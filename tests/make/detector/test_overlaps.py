"""Overlaps against the formulas of their papers, written plainly, and gradients where boxes are as bad as can be."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from lookonce.boxes import iou
from lookonce.make.detector.overlaps import complete_iou, generalized_iou, pair_iou, row_iou, shape_iou


def random_boxes(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    corner = rng.uniform(-20, 80, (count, 2))
    return np.concatenate([corner, corner + rng.uniform(1, 60, (count, 2))], axis=1).astype(np.float32)


A, B = random_boxes(200, 1), random_boxes(200, 2)


def areas(a, b) -> tuple[float, float, float]:
    """Intersection, union and area of the hull of two boxes."""
    width = max(0, min(a[2], b[2]) - max(a[0], b[0]))
    height = max(0, min(a[3], b[3]) - max(a[1], b[1]))
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - width * height
    hull = (max(a[2], b[2]) - min(a[0], b[0])) * (max(a[3], b[3]) - min(a[1], b[1]))
    return width * height, union, hull


def published_giou(a, b) -> float:
    """Rezatofighi et al. 2019, algorithm 1."""
    intersection, union, hull = areas(a, b)
    return intersection / union - (hull - union) / hull


def published_ciou(a, b) -> float:
    """Zheng et al. 2020, equations 7 to 11."""
    intersection, union, _ = areas(a, b)
    distance2 = ((a[0] + a[2] - b[0] - b[2]) / 2) ** 2 + ((a[1] + a[3] - b[1] - b[3]) / 2) ** 2
    diagonal2 = (max(a[2], b[2]) - min(a[0], b[0])) ** 2 + (max(a[3], b[3]) - min(a[1], b[1])) ** 2
    slants = [math.atan((box[2] - box[0]) / (box[3] - box[1])) for box in (a, b)]
    v = 4 / math.pi**2 * (slants[0] - slants[1]) ** 2
    alpha = v / (1 - intersection / union + v) if v else 0.0
    return intersection / union - distance2 / diagonal2 - alpha * v


def test_iou_is_that_of_the_package():
    expected = iou(A, B)
    a, b = torch.from_numpy(A), torch.from_numpy(B)
    np.testing.assert_allclose(pair_iou(a, b).numpy(), expected, atol=1e-6)
    np.testing.assert_allclose(row_iou(a, b).numpy(), np.diagonal(expected), atol=1e-6)


@pytest.mark.parametrize(
    ("function", "published"), [(generalized_iou, published_giou), (complete_iou, published_ciou)], ids=["giou", "ciou"]
)
def test_losses_are_those_of_the_papers(function, published):
    expected = [published(a, b) for a, b in zip(A.astype(float), B.astype(float), strict=True)]
    np.testing.assert_allclose(function(torch.from_numpy(A), torch.from_numpy(B)).numpy(), expected, atol=1e-5)
    np.testing.assert_allclose(function(torch.from_numpy(A), torch.from_numpy(A)).numpy(), 1, atol=1e-5)


def test_the_weight_of_the_aspect_has_no_gradient():
    """As in the paper's own program: with a gradient through alpha the aspect would be learnt another way."""
    a, b = torch.from_numpy(A[:5]).requires_grad_(), torch.from_numpy(B[:5])
    complete_iou(a, b).sum().backward()
    step = torch.zeros_like(a)
    slope = torch.zeros_like(a)
    for column in range(4):
        step.zero_()
        step[:, column] = 1e-2
        with torch.no_grad():
            w, h = a[:, 2] - a[:, 0], a[:, 3] - a[:, 1]
            v = 4 / math.pi**2 * (torch.atan(w / h) - torch.atan((b[:, 2] - b[:, 0]) / (b[:, 3] - b[:, 1]))) ** 2
            alpha = v / (1 - row_iou(a, b) + v)

            def value(boxes, alpha=alpha):
                w, h = boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1]
                other = torch.atan((b[:, 2] - b[:, 0]) / (b[:, 3] - b[:, 1]))
                aspect = 4 / math.pi**2 * (torch.atan(w / h) - other) ** 2
                hull = torch.maximum(boxes[:, 2:], b[:, 2:]) - torch.minimum(boxes[:, :2], b[:, :2])
                apart = ((boxes[:, :2] + boxes[:, 2:] - b[:, :2] - b[:, 2:]) / 2).square().sum(1)
                return row_iou(boxes, b) - apart / hull.square().sum(1) - alpha * aspect

            slope[:, column] = (value(a.double() + step) - value(a.double() - step)) / 2e-2
    np.testing.assert_allclose(a.grad.numpy(), slope.numpy(), atol=2e-4)


HARD = {
    "equal": [[5, 5, 20, 30]],
    "a point": [[7, 7, 7, 7]],
    "a line": [[0, 7, 30, 7]],
    "an upright line": [[7, 0, 7, 30]],
    "far apart": [[4000, 4000, 4001, 4001]],
    "touching": [[20, 5, 40, 30]],
    "inside": [[10, 10, 11, 11]],
    "huge": [[-100_000, -100_000, 100_000, 100_000]],
    "very flat": [[-100_000, 7, 100_000, 7.000001]],
}


@pytest.mark.parametrize("function", [row_iou, generalized_iou, complete_iou])
@pytest.mark.parametrize("name", HARD)
def test_values_and_gradients_are_finite_for_any_boxes(function, name):
    for other in ([[5.0, 5, 20, 30]], HARD[name]):
        a = torch.tensor(HARD[name], dtype=torch.float32, requires_grad=True)
        value = function(a, torch.tensor(other, dtype=torch.float32))
        value.sum().backward()
        assert torch.isfinite(value).all()
        assert torch.isfinite(a.grad).all()
        assert -3 < float(value.detach()) <= 1 + 1e-6


def test_no_boxes_give_no_overlaps():
    none = torch.zeros(0, 4)
    assert row_iou(none, none).shape == generalized_iou(none, none).shape == complete_iou(none, none).shape == (0,)
    assert pair_iou(none, torch.from_numpy(B)).shape == (0, 200)


def test_overlap_of_shapes_is_that_of_boxes_on_one_corner():
    extents = random_boxes(30, 3)[:, 2:] % 50 + 1
    boxes = np.concatenate([np.zeros_like(extents), extents], axis=1)
    shapes = torch.from_numpy(extents)
    np.testing.assert_allclose(shape_iou(shapes, shapes[:7]).numpy(), iou(boxes, boxes[:7]), atol=1e-6)
