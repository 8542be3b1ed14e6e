"""Which grid, cell and anchor answer for a box: cases small enough to work out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.make.descriptors.anchors import labels_of_names, rows_of_boxes

FIELDS = {"image_index", "boxes", "scores", "labels", "scale", "cell", "anchor"}


@pytest.fixture(scope="module")
def metadata(describe):
    """Input 64 x 96 px; a grid of 2 x 3 cells with two large anchors, then one of 4 x 6 cells with three small ones."""
    outputs = [(32, [(40, 40), (20, 60)], "a", "a"), (16, [(10, 10), (8, 24), (24, 8)], "b", "b")]
    return describe([("a", 4, 32), ("b", 4, 16)], outputs)


def _box(centre, size):
    return [centre[0] - size[0] / 2, centre[1] - size[1] / 2, centre[0] + size[0] / 2, centre[1] + size[1] / 2]


@pytest.mark.parametrize(
    ("centre", "size", "scale", "cell", "anchor"),
    [
        pytest.param((50, 20), (40, 40), 0, 1, 0, id="large-square"),
        pytest.param((50, 40), (18, 50), 0, 4, 1, id="tall"),
        pytest.param((50, 20), (11, 9), 1, 9, 0, id="small-square"),  # column 3, row 1 of 6 columns
        pytest.param((50, 20), (9, 20), 1, 9, 1, id="small-and-tall"),
        pytest.param((50, 20), (20, 7), 1, 9, 2, id="small-and-wide"),
        pytest.param((80, 40), (200, 300), 0, 5, 0, id="larger-than-all-anchors"),  # 1600 px beat 1200
        pytest.param((80, 40), (1, 1), 1, 17, 0, id="smaller-than-all-anchors"),  # the smallest anchor overlaps most
        pytest.param((48, 32), (10, 10), 1, 15, 0, id="on-the-corner-of-four-cells"),  # belongs to the last
        pytest.param((47.9, 31.9), (10, 10), 1, 8, 0, id="just-before-the-corner"),
    ],
)
def test_best_anchor_and_cell_of_the_centre(metadata, centre, size, scale, cell, anchor):
    rows = rows_of_boxes(metadata, np.array([_box(centre, size)], np.float32))
    assert (rows["scale"][0], rows["cell"][0], rows["anchor"][0]) == (scale, cell, anchor)


@pytest.mark.parametrize(
    ("centre", "cell"),
    [
        pytest.param((0, 0), 0, id="top-left"),
        pytest.param((96, 0), 5, id="right-edge"),
        pytest.param((0, 64), 18, id="bottom-edge"),
        pytest.param((96, 64), 23, id="bottom-right"),
        pytest.param((500, 500), 23, id="outside"),
        pytest.param((-30, 40), 12, id="outside-left"),
    ],
)
def test_centres_at_or_beyond_the_border_belong_to_the_border_cell(metadata, centre, cell):
    rows = rows_of_boxes(metadata, np.array([_box(centre, (10, 10))], np.float32))
    assert (rows["scale"][0], rows["cell"][0], rows["anchor"][0]) == (1, cell, 0)


def test_a_box_is_given_to_the_first_of_equal_anchors(describe):
    outputs = [(32, [(10, 10), (10, 10)], "a", "a"), (16, [(10, 10)], "a", "a")]
    rows = rows_of_boxes(describe([], outputs), np.array([_box((50, 20), (10, 10))], np.float32))
    assert (rows["scale"][0], rows["anchor"][0]) == (0, 0)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_every_field_has_a_row_for_each_box(metadata, count):
    boxes = np.tile(np.array([_box((50, 20), (10, 10))], np.float32), (count, 1))
    rows = rows_of_boxes(metadata, boxes)
    assert set(rows) == FIELDS
    assert {name: values.shape for name, values in rows.items()} == {
        name: (count, 4) if name == "boxes" else (count,) for name in FIELDS
    }
    assert {name for name in FIELDS if rows[name].dtype == np.int64} == FIELDS - {"boxes", "scores"}
    np.testing.assert_array_equal(rows["boxes"], boxes)
    assert (rows["image_index"] == 0).all()
    assert (rows["labels"] == -1).all()


def test_rows_keep_their_order_and_picture(metadata):
    boxes = np.array([_box((50, 20), (40, 40)), _box((5, 5), (10, 10)), _box((50, 20), (9, 20))], np.float32)
    rows = rows_of_boxes(metadata, boxes, np.array([2, 0, 1]))
    assert rows["image_index"].tolist() == [2, 0, 1]
    assert rows["scale"].tolist() == [0, 1, 1]
    assert rows["cell"].tolist() == [1, 0, 9]
    assert rows["anchor"].tolist() == [0, 0, 1]


def test_classes_are_found_by_name(describe):
    metadata = describe([], [(32, [(10, 10)], "a", "a")], names=("Person", "car", "people", "Car"))
    found = labels_of_names(metadata, ("car", "pedestrian", "objects", "PERSON", "CAR"))
    assert found.tolist() == [1, 0, -1, 0, 1]
    assert labels_of_names(metadata, ()).tolist() == []
