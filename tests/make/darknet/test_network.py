"""The PyTorch network against OpenCV's importer, against arithmetic by hand, and against its own declarations."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch
from torch.nn import functional

from darknet_files import TINY, conv, head, net, route, section, write_network, write_random_weights, yolo
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.layers import MaxPool
from lookonce.make.darknet.network import DarknetNetwork, _max_pool, _reorg
from lookonce.make.darknet.weights import read_weights
from opencv_oracle import opencv_raw_maps

TOLERANCE = 1e-4  # of the range of the output; about 1e-6 is reached
UNKNOWN_TO_OPENCV = {"activation-relu6"}
REAL = ("yolo-fastest-1.1-xl", "yolo-fastest-1.1", "MobileNetV2-YOLOv3-Nano-coco")
OFFICIAL = (
    "yolov2-tiny yolov2 yolov3-spp yolov3-tiny yolov3-voc yolov3 yolov4-csp yolov4-tiny yolov4 yolov4x-mish"
).split()


def _network(cfg, weights, size=None, features=()):
    network = DarknetNetwork(read_cfg(cfg, size), features).eval()
    network.load_weights_(read_weights(weights, network.config)[0])
    return network


@torch.no_grad()
def _run(network, images):
    raw, features = network(torch.from_numpy(images))
    return [r.numpy() for r in raw], {index: f.numpy() for index, f in features.items()}


def _random_images(size, count=1, seed=1):
    return np.random.default_rng(seed).random((count, 3, *size), dtype=np.float32)


def _assert_equal_maps(ours, theirs, most=30.0):
    """Equal shapes, a spread that lets errors show and does not hide them, and the difference within the tolerance."""
    assert len(ours) == len(theirs) > 0
    for a, b in zip(ours, theirs, strict=True):
        assert a.shape == b.shape
        assert 0.3 < np.ptp(b)
        assert np.abs(b).max() < most
        assert np.abs(a - b).max() <= TOLERANCE * np.ptp(b)


@pytest.mark.parametrize("name", [name for name in TINY if name not in UNKNOWN_TO_OPENCV])
def test_layers_agree_with_opencv(tmp_path, name):
    cfg, weights = write_network(tmp_path, TINY[name])
    network = _network(cfg, weights)
    images = _random_images(network.config.size)
    ours, _ = _run(network, images)
    _assert_equal_maps(ours, opencv_raw_maps(cfg, weights, network.config, images), most=10)


def test_networks_left_out_of_the_comparison_are_unknown_to_opencv(tmp_path):
    for name in UNKNOWN_TO_OPENCV:
        cfg, weights = write_network(tmp_path, TINY[name])
        with pytest.raises(cv2.error):
            opencv_raw_maps(cfg, weights, read_cfg(cfg), _random_images((64, 64)))


@pytest.mark.data
@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("kind", ["photo", "noise"])
def test_real_weights_agree_with_opencv(data_folder, name, kind):
    cfg, weights = (data_folder / "weights" / f"{name}.{end}" for end in ("cfg", "weights"))
    network = _network(cfg, weights, (320, 320))
    images = _random_images((320, 320))
    if kind == "photo":
        picture = cv2.imread(str(data_folder / "sequences/PETS09-S2L1/img1/000001.jpg"))
        images = cv2.dnn.blobFromImage(picture, 1 / 255, (320, 320), swapRB=True)
    ours, _ = _run(network, images)
    _assert_equal_maps(ours, opencv_raw_maps(cfg, weights, network.config, images))


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("name", OFFICIAL)
def test_official_network_with_random_weights_agrees_with_opencv(data_folder, tmp_path, name):
    cfg, weights = data_folder / "cfg" / f"{name}.cfg", tmp_path / "random.weights"
    write_random_weights(weights, read_cfg(cfg))
    network = _network(cfg, weights, (160, 160))
    images = _random_images((160, 160))
    ours, _ = _run(network, images)
    theirs = opencv_raw_maps(cfg, weights, network.config, images)
    weights.unlink()
    _assert_equal_maps(ours, theirs)


def test_relu6_stops_at_six(tmp_path):
    cfg = tmp_path / "tiny.cfg"
    body = net(32, 32) + conv(1, 1, activation="relu6", batch_normalize=0) + head() + yolo()
    cfg.write_text(body, encoding="utf-8")
    config = read_cfg(cfg)
    network = DarknetNetwork(config, [0]).eval()
    values = np.zeros(config.parameter_count, np.float32)
    values[0], values[1] = -3.0, 12.0  # bias, then the red channel's weight
    path = tmp_path / "tiny.weights"
    path.write_bytes(np.array([0, 2, 0, 0, 0], "<i4").tobytes() + values.tobytes())
    network.load_weights_(read_weights(path, config)[0])
    images = np.zeros((1, 3, 32, 32), np.float32)
    images[0, 0] = np.linspace(0, 1, 32)
    feature = _run(network, images)[1][0]
    np.testing.assert_allclose(feature[0, 0], np.clip(12 * images[0, 0] - 3, 0, 6), atol=1e-5)
    assert feature.max() == 6


def test_reorg_is_darknets_own_order():
    """The buffer (C, H, W) is read as if it were (C / 4, 2 H, 2 W), as Darknet does, not channel by channel."""
    channels, height, width, stride = 8, 4, 6, 2
    x = np.arange(2 * channels * height * width, dtype=np.float32).reshape(2, channels, height, width)
    depth, flat = channels // stride**2, x.reshape(2, -1)
    expected = np.empty((2, channels * height * width), np.float32)
    for k in range(channels):
        for j in range(height):
            for i in range(width):
                offset, c = divmod(k, depth)
                row, column = j * stride + offset // stride, i * stride + offset % stride
                source = column + width * stride * (row + height * stride * c)
                expected[:, i + width * (j + height * k)] = flat[:, source]
    result = _reorg(torch.from_numpy(x), stride)
    assert result.shape == (2, channels * 4, height // 2, width // 2)
    assert result.numpy().ravel().tolist() == expected.ravel().tolist()


@pytest.mark.parametrize(("height", "width"), [(8, 8), (7, 9), (5, 6)])
@pytest.mark.parametrize(
    "spec",
    [
        *(MaxPool(2, 2, 1), MaxPool(2, 1, 1), MaxPool(3, 2, 2), MaxPool(3, 1, 2), MaxPool(5, 1, 4), MaxPool(9, 1, 8)),
        *(MaxPool(2, 2, 0), MaxPool(3, 2, 0), MaxPool(4, 2, 3), MaxPool(3, 3, 2), MaxPool(2, 2, 2), MaxPool(3, 1, 4)),
    ],
    ids=lambda spec: f"size{spec.size}-stride{spec.stride}-padding{spec.padding}",
)
def test_maxpool_pads_with_minus_infinity(spec, height, width):
    """All inputs are negative: padding with zeros would win."""
    x = -np.random.default_rng(3).uniform(1, 2, (1, 2, height, width)).astype(np.float32)
    rows, columns = ((n + spec.padding - spec.size) // spec.stride + 1 for n in (height, width))
    expected = np.full((1, 2, rows, columns), -np.inf, np.float32)
    for i in range(rows):
        for j in range(columns):
            for a in range(spec.size):
                for b in range(spec.size):
                    y, z = i * spec.stride + a - spec.padding // 2, j * spec.stride + b - spec.padding // 2
                    if 0 <= y < height and 0 <= z < width:
                        expected[:, :, i, j] = np.maximum(expected[:, :, i, j], x[:, :, y, z])
    np.testing.assert_array_equal(_max_pool(torch.from_numpy(x), spec).numpy(), expected)


@pytest.mark.parametrize("name", ["two-scales", "region-reorg", "squeeze-excite", "new-coords"])
def test_picture_alone_equals_its_row_in_a_batch(tmp_path, name):
    network = _network(*write_network(tmp_path, TINY[name]))
    images = _random_images(network.config.size, count=3)
    together, _ = _run(network, images)
    for index in range(3):
        alone, _ = _run(network, images[index : index + 1])
        for a, b in zip(alone, together, strict=True):
            np.testing.assert_allclose(a[0], b[index], atol=1e-6 * np.ptp(b))


@pytest.mark.parametrize("name", TINY)
def test_declared_shapes_are_the_real_ones(tmp_path, name):
    """Channels, grid and stride of every layer, asked for as a feature."""
    cfg, weights = write_network(tmp_path, TINY[name])
    config = read_cfg(cfg)
    network = _network(cfg, weights, features=range(len(config.layers)))
    raw, features = _run(network, _random_images(config.size, count=2))
    assert list(features) == list(range(len(config.layers)))
    for layer in config.layers:
        assert features[layer.index].shape == (2, layer.channels, layer.height, layer.width)
        if layer.height > 1:
            assert config.size[0] == config.stride(layer) * layer.height
            assert config.size[1] == config.stride(layer) * layer.width
    for output, values in zip(config.outputs, raw, strict=True):
        np.testing.assert_array_equal(values, features[output.index - 1])


def test_features_are_the_layers_asked_for(tmp_path):
    """A route says which layers it joins: their features must be found in it."""
    cfg, weights = write_network(tmp_path, TINY["two-scales"])
    network = _network(cfg, weights, features=(14, 4, 13))
    raw, features = _run(network, _random_images((64, 96)))
    assert list(features) == [14, 4, 13]
    np.testing.assert_array_equal(features[14], np.concatenate([features[13], features[4]], axis=1))
    plain, none = _run(_network(cfg, weights), _random_images((64, 96)))
    assert none == {}
    for a, b in zip(raw, plain, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", [name for name in TINY if name != "no-batch-norm"])
def test_folding_batch_norm_changes_nothing(tmp_path, name):
    network = _network(*write_network(tmp_path, TINY[name]))
    images = _random_images(network.config.size, count=2)
    before, _ = _run(network, images)
    network.fuse_()
    assert not any(isinstance(module, torch.nn.BatchNorm2d) for module in network.modules())
    after, _ = _run(network, images)
    for a, b in zip(after, before, strict=True):
        assert np.abs(a - b).max() <= 1e-5 * np.ptp(b)


def test_shortcut_and_gate_are_arithmetic(tmp_path):
    """Sums and products with an activation after them, which OpenCV reads as linear whatever the cfg says."""
    body = net() + conv(8, stride=2) + conv(8) + section("shortcut", from_=-2, activation="leaky") + section("avgpool")
    body += section("scale_channels", from_=2, activation="logistic") + conv(8) + head() + yolo()
    network = _network(*write_network(tmp_path, body), features=range(5))
    _, f = _run(network, _random_images((64, 64)))
    total = torch.from_numpy(f[0] + f[1])
    np.testing.assert_allclose(f[2], functional.leaky_relu(total, 0.1).numpy(), atol=1e-6)
    np.testing.assert_allclose(f[3], f[2].mean(axis=(2, 3), keepdims=True), atol=1e-6)
    np.testing.assert_allclose(f[4], 1 / (1 + np.exp(-f[3] * f[2])), atol=1e-6)


def test_route_group_is_a_slice(tmp_path):
    body = net() + conv(8, stride=2) + conv(12) + route("0,1", groups=4, group_id=2) + head() + yolo()
    network = _network(*write_network(tmp_path, body), features=range(3))
    _, f = _run(network, _random_images((64, 64)))
    np.testing.assert_array_equal(f[2], np.concatenate([f[0][:, 4:6], f[1][:, 6:9]], axis=1))
