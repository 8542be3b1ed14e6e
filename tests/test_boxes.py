"""Box arithmetic."""

from __future__ import annotations

import numpy as np

from lookonce.boxes import clip, iou, iou_of_pairs, share_inside, xyxy_to_ltwh

BOXES = np.array([[0, 0, 10, 20], [5, 5, 15, 25], [-5, -5, 30, 40]], np.float32)


def test_corners_become_left_top_width_height():
    before = BOXES.copy()
    ltwh = xyxy_to_ltwh(BOXES)
    assert ltwh.tolist() == [[0, 0, 10, 20], [5, 5, 10, 20], [-5, -5, 35, 45]]
    assert ltwh.dtype == np.float32
    np.testing.assert_array_equal(BOXES, before)
    assert xyxy_to_ltwh(BOXES[:0]).shape == (0, 4)


def test_boxes_are_cut_at_the_border():
    before = BOXES.copy()
    cut = clip(BOXES, (12, 8))  # height 12, width 8
    assert cut.tolist() == [[0, 0, 8, 12], [5, 5, 8, 12], [0, 0, 8, 12]]
    assert cut.dtype == np.float32
    np.testing.assert_array_equal(BOXES, before)
    assert clip(BOXES[:0], (12, 8)).shape == (0, 4)


def test_overlap_of_every_pair():
    a = np.array([[0, 0, 2, 2], [0, 0, 4, 4]], np.float32)
    b = np.array([[0, 0, 2, 2], [1, 1, 3, 3], [2, 0, 4, 2], [9, 9, 10, 10]], np.float32)
    expected = [[1, 1 / 7, 0, 0], [4 / 16, 4 / 16, 4 / 16, 0]]
    np.testing.assert_allclose(iou(a, b), expected, rtol=1e-6)
    np.testing.assert_allclose(iou(b, a), np.transpose(expected), rtol=1e-6)


def test_overlap_with_nothing():
    empty = np.array([[3, 3, 3, 3]], np.float32)
    assert iou(empty, empty).tolist() == [[0.0]]
    assert iou(BOXES[:0], BOXES).shape == (0, 3)
    assert iou(BOXES, BOXES[:0]).shape == (3, 0)


def test_iou_of_pairs_is_the_diagonal_of_iou():
    rng = np.random.default_rng(0)
    a, b = (np.sort(rng.uniform(0, 9, (2, 2, 500)), axis=0).transpose(2, 0, 1).reshape(-1, 4) for _ in range(2))
    b[0] = [3, 3, 3, 3]
    b[1] = a[1] = [1, 1, 1, 1]
    np.testing.assert_array_equal(iou_of_pairs(a, b), np.diagonal(iou(a, b)))
    assert iou_of_pairs(a[:0], b[:0]).shape == (0,)


def test_share_of_a_box_inside_others():
    a = np.array([[0, 0, 4, 2], [-4, 0, 4, 2], [3, 3, 3, 9], [4, 2, 0, 0], [4, 0, 0, 2.0]])
    b = np.array([[0, 0, 2, 2], [-9, -9, 9, 9], [4, 0, 8, 2.0]])
    nothing = [0, 0, 0]
    assert share_inside(a, b).tolist() == [[0.5, 1, 0], [0.25, 1, 0], nothing, nothing, nothing]
    assert share_inside(a[:0], b).shape == (0, 3)
    assert share_inside(a, b[:0]).shape == (5, 0)
