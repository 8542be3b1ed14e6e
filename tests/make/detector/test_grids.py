"""Decoding in training is that of the model file; encoding is its inverse; anchors are numbered as they are."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from darknet_files import TINY
from lookonce.make.darknet.importer import write_detector
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.detector.grids import AnchorGrids, decode, encode
from make.detector.rectangles import network_of, one_grid, two_grids
from model_runs import random_pictures, run_file

CPU = torch.device("cpu")


def bodies() -> list:
    return [
        pytest.param(one_grid(), id="one grid"),
        pytest.param(two_grids(scale_x_y=1.2), id="scale_x_y"),
        pytest.param(TINY["two-scales"], id="oblong"),
    ]


@pytest.mark.parametrize("body", bodies())
def test_boxes_are_those_of_the_model_file(tmp_path, body):
    torch.manual_seed(3)
    config = network_of(tmp_path, body)
    network = DarknetNetwork(config).eval()
    with torch.no_grad():
        for layer in config.outputs:
            network.blocks[str(layer.index - 1)].convolution.bias.normal_()
    names = tuple(map(str, range(config.classes)))
    write_detector(network, names, tmp_path / "net.onnx", descriptors=False, license="unknown", source={})
    pictures = random_pictures(config.size)
    found = run_file(
        tmp_path / "net.onnx", pictures, score_threshold=0.0, iou_threshold=1.0, max_detections=config.classes * 1000
    )
    with torch.no_grad():
        raw, _ = network(torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255)
    grids = AnchorGrids(config, CPU)
    outputs = grids.outputs(raw)[0]
    boxes = decode(outputs, grids.facts).numpy()
    scores = (torch.sigmoid(outputs[:, 4:5]) * torch.sigmoid(outputs[:, 5:])).numpy()
    assert len(found["scores"]) == scores.size
    for label in range(config.classes):
        theirs = found["labels"] == label
        ours = np.argsort(-scores[:, label], kind="stable")
        np.testing.assert_allclose(found["scores"][theirs], scores[ours, label], atol=1e-5)
        apart = np.abs(found["boxes"][theirs][:, None] - boxes[None]).max(axis=2)
        alike = np.abs(found["scores"][theirs][:, None] - scores[None, :, label]) < 1e-5
        assert np.where(alike, apart, np.inf).min(axis=1).max() < 2e-3
        assert np.where(alike, apart, np.inf).min(axis=0).max() < 2e-3


@pytest.mark.parametrize("body", bodies())
def test_encoding_is_the_inverse_of_decoding(tmp_path, body):
    grids = AnchorGrids(network_of(tmp_path, body), CPU)
    outputs = torch.randn(len(grids), 4, generator=torch.Generator().manual_seed(1))
    position, size = encode(decode(outputs, grids.facts), grids.facts)
    torch.testing.assert_close(position, torch.sigmoid(outputs[:, :2]), atol=1e-4, rtol=0)
    torch.testing.assert_close(size, outputs[:, 2:], atol=1e-4, rtol=1e-4)


def test_encoding_stays_in_range_for_centres_elsewhere_and_boxes_without_size(tmp_path):
    grids = AnchorGrids(network_of(tmp_path, one_grid()), CPU)
    position, size = encode(torch.tensor([[60.0, 60, 60, 60]]).expand(len(grids), 4), grids.facts)
    assert ((position >= 0) & (position <= 1)).all()
    assert torch.isfinite(size).all()


def test_anchors_are_numbered_by_grid_anchor_row_and_column(tmp_path):
    config = network_of(tmp_path, two_grids(classes=3))
    grids = AnchorGrids(config, CPU)
    shapes = [(4, 6), (8, 12)]
    assert len(grids) == sum(2 * rows * columns for rows, columns in shapes)
    assert [(grid.rows, grid.columns, grid.stride_px) for grid in grids.grids] == [(4, 6, 16), (8, 12, 8)]
    assert [grid.first for grid in grids.grids] == [0, 48]
    # every value of the raw maps says where it is
    raw = []
    for number, (rows, columns) in enumerate(shapes):
        place = np.stack(np.meshgrid(np.arange(16), np.arange(rows), np.arange(columns), indexing="ij"))
        raw.append(torch.from_numpy(place[0] * 10_000 + place[1] * 100 + place[2] + number * 1e6).float()[None])
    outputs = grids.outputs(raw)[0].numpy()
    expected = [
        [number * 1e6 + (anchor * 8 + attribute) * 10_000 + row * 100 + column for attribute in range(8)]
        for number, (rows, columns) in enumerate(shapes)
        for anchor in range(2)
        for row in range(rows)
        for column in range(columns)
    ]
    np.testing.assert_array_equal(outputs, np.array(expected, np.float32))
    facts = grids.facts.numpy()
    np.testing.assert_array_equal(facts[:, 0], outputs[:, 0] % 100)
    np.testing.assert_array_equal(facts[:, 1], outputs[:, 0] % 10_000 // 100)
    anchors = config.outputs[0].spec.anchors, config.outputs[1].spec.anchors
    np.testing.assert_array_equal(facts[[0, 24, 48, 144], 3:5], np.array([*anchors[0], *anchors[1]]))


def test_extreme_outputs_give_finite_boxes(tmp_path):
    grids = AnchorGrids(network_of(tmp_path, one_grid()), CPU)
    for value in (-1e30, -100.0, 100.0, 1e30):
        assert torch.isfinite(decode(torch.full((len(grids), 4), value), grids.facts)).all()
