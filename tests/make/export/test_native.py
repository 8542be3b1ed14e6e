"""Descriptors of kind `native`: the features at the detection's own cell, read again in NumPy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from darknet_files import conv, head, net, route, write_network, yolo
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.features import scale_features
from lookonce.make.darknet.importer import import_darknet
from model_runs import random_pictures, run_file, torch_maps
from plain_detector import plain_detections


def _unit(vector):
    return vector / np.linalg.norm(vector)


def _assert_descriptors_equal_features(cfg, weights, path, pictures, size=None, **settings):
    """Each row is its grid's block: near and early layer at its cell, each to unit length, joined, to unit length."""
    config = read_cfg(cfg, size)
    scales = scale_features(config)
    indices = sorted({layer.index for scale in scales for layer in (scale.near, scale.early)})
    raw, features = torch_maps(cfg, weights, pictures, size, indices)
    outputs = run_file(path, pictures, **settings)
    widths = [scale.near.channels + scale.early.channels for scale in scales]
    start = np.cumsum([0, *widths])
    assert outputs["descriptors"].shape[1] == start[-1]
    found_by = set()
    row = 0
    for image in range(len(pictures)):
        for detection in plain_detections(config, [r[image] for r in raw], **settings):
            scale = scales[detection.scale]
            cell = (image, slice(None), detection.row, detection.column)
            block = [_unit(np.float64(features[layer.index][cell])) for layer in (scale.near, scale.early)]
            expected = np.zeros(start[-1])
            expected[start[detection.scale] : start[detection.scale + 1]] = _unit(np.concatenate(block))
            np.testing.assert_allclose(outputs["descriptors"][row], expected, atol=2e-5)
            found_by.add(detection.scale)
            row += 1
    assert row == len(outputs["descriptors"]) > 0
    assert found_by == set(range(len(scales)))
    np.testing.assert_allclose(np.linalg.norm(outputs["descriptors"], axis=1), 1, atol=1e-6)
    return outputs


@pytest.mark.parametrize("name", ["two-scales", "region-reorg", "squeeze-excite", "dropout"])
def test_descriptor_is_the_features_at_the_detections_cell(tiny_model, name):
    model = tiny_model(name)
    pictures = random_pictures(read_cfg(model.cfg).size, count=3)
    pictures[1] = 0  # another picture, so that images have different numbers of rows
    outputs = _assert_descriptors_equal_features(
        model.cfg, model.weights, model.path, pictures, score_threshold=0.3, max_detections=60
    )
    assert len(set(np.bincount(outputs["image_index"], minlength=3))) > 1 or name != "two-scales"


def test_size_other_than_the_cfgs_own(tiny_model):
    model = tiny_model("two-scales", size=(96, 32))
    pictures = random_pictures((96, 32), count=2)
    _assert_descriptors_equal_features(
        model.cfg, model.weights, model.path, pictures, (96, 32), score_threshold=0.2, max_detections=60
    )


@pytest.mark.parametrize(
    "body",
    [
        pytest.param(
            net() + conv(8, stride=4) + conv(12) + head() + yolo() + route("-3") + head() + yolo(), id="shared-layer"
        ),
        pytest.param(net() + conv(8, stride=2) + conv(8) + head() + yolo(), id="stride-2"),
        pytest.param(
            net() + conv(8, stride=4) + head() + yolo() + route("1") + head() + yolo(), id="near-layer-is-a-raw-map"
        ),
    ],
)
def test_layers_that_play_two_parts(tmp_path, body):
    cfg, weights = write_network(tmp_path, body)
    metadata = import_darknet(cfg, weights, tmp_path / "tiny.onnx")
    assert metadata.descriptor is not None
    pictures = random_pictures((64, 64))
    outputs = _assert_descriptors_equal_features(cfg, weights, tmp_path / "tiny.onnx", pictures, score_threshold=0.2)
    assert outputs["descriptors"].shape[1] == metadata.descriptor.size


def test_detections_of_different_grids_are_far_apart(tiny_model):
    outputs = run_file(tiny_model("two-scales").path, random_pictures((64, 96)))
    rows = outputs["descriptors"]
    coarse = (rows[:, :44] != 0).any(axis=1)
    assert 0 < coarse.sum() < len(rows)
    assert not (rows[coarse][:, 44:] != 0).any()
    assert (rows[coarse] @ rows[~coarse].T == 0).all()


def test_file_without_descriptors_has_none(tiny_model):
    outputs = run_file(tiny_model("two-scales", descriptors=False).path, random_pictures((64, 96)))
    assert list(outputs) == ["image_index", "boxes", "scores", "labels"]


@pytest.mark.data
def test_descriptors_of_real_weights(data_folder, real_model):
    cfg, weights, path, size = real_model("yolo-fastest-1.1-xl")
    photo = cv2.imread(str(data_folder / "sequences/PETS09-S2L1/img1/000001.jpg"))
    pictures = cv2.resize(photo, size)[np.newaxis, ..., ::-1].copy()
    _assert_descriptors_equal_features(cfg, weights, path, pictures, size, score_threshold=0.05)
