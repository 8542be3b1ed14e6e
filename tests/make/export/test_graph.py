"""The network inside the graph: the same numbers as PyTorch, the same bytes whatever runs beside it."""

from __future__ import annotations

import cv2
import numpy as np
import onnx
import pytest

from darknet_files import TINY, conv, head, maxpool, net, write_network, write_random_weights, yolo
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.importer import import_darknet
from model_runs import random_pictures, run_file, torch_maps

REAL = ("yolo-fastest-1.1-xl", "yolo-fastest-1.1", "MobileNetV2-YOLOv3-Nano-coco")
DETECTION = ("image_index", "boxes", "scores", "labels")


def _assert_inner_maps_equal(path, cfg, weights, pictures, size=None):
    config = read_cfg(cfg, size)
    inner = [f"layer_{output.index - 1}" for output in config.outputs]
    outputs = run_file(path, pictures, inner=inner)
    raw, _ = torch_maps(cfg, weights, pictures, size)
    for name, expected in zip(inner, raw, strict=True):
        assert outputs[name].shape == expected.shape
        assert 0.3 < np.ptp(expected) < 60
        assert np.abs(outputs[name] - expected).max() <= 1e-5 * np.ptp(expected)


@pytest.mark.parametrize("name", TINY)
def test_raw_maps_equal_pytorch(tiny_model, name):
    """ONNX Runtime optimises the graph as it does for users."""
    model = tiny_model(name)
    pictures = random_pictures(read_cfg(model.cfg).size, count=2)
    _assert_inner_maps_equal(model.path, model.cfg, model.weights, pictures)


def test_padding_of_a_pool_is_not_folded_into_zeros(tmp_path):
    """Values before the stride-1 pool are all negative, as in the darkest corner of yolov3-tiny: a zero would win.

    ONNX Runtime fuses a Pad into the MaxPool behind it; for some paddings that changes the result.
    """
    body = net() + conv(8, stride=2) + maxpool(2, 2) + conv(8, activation="linear", batch_normalize=0) + maxpool(2, 1)
    body += conv(8) + head() + yolo()
    cfg, weights = write_network(tmp_path, body)
    config = read_cfg(cfg)
    values = np.frombuffer(weights.read_bytes()[20:], "<f4").copy()
    values[8 * 4 + 8 * 27 : 8 * 4 + 8 * 27 + 8] = -50.0  # the biases of the convolution before the pool
    weights.write_bytes(weights.read_bytes()[:20] + values.tobytes())
    pictures = random_pictures((64, 64))
    raw, features = torch_maps(cfg, weights, pictures, features=[3])
    assert features[3].max() < -10
    import_darknet(cfg, weights, tmp_path / "tiny.onnx")
    outputs = run_file(tmp_path / "tiny.onnx", pictures, inner=[f"layer_{config.outputs[0].index - 1}"])
    for expected, ours in zip(raw, list(outputs.values())[-1:], strict=True):
        assert np.abs(ours - expected).max() <= 1e-5 * np.ptp(expected)


@pytest.mark.data
@pytest.mark.parametrize("name", REAL)
def test_raw_maps_of_real_weights_equal_pytorch(real_model, name):
    cfg, weights, path, _ = real_model(name)
    _assert_inner_maps_equal(path, cfg, weights, random_pictures((512, 512)), (512, 512))


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("name", ["yolov3-tiny", "yolov4-tiny", "yolov2-tiny"])
def test_raw_maps_of_official_networks_equal_pytorch(data_folder, tmp_path, name):
    cfg, weights, size = data_folder / "cfg" / f"{name}.cfg", tmp_path / "random.weights", (160, 192)
    write_random_weights(weights, read_cfg(cfg))
    import_darknet(cfg, weights, tmp_path / "random.onnx", size=size)
    _assert_inner_maps_equal(tmp_path / "random.onnx", cfg, weights, random_pictures(size), size)


def _rows(outputs, image):
    return {
        name: values[outputs["image_index"] == image].tobytes()
        for name, values in outputs.items()
        if name != "image_index"
    }


def _assert_same_bytes_however_run(path, plain, pictures, **settings):
    """Two runs, 1 and 2 threads, batches of 8 and of 1, with descriptors and without: the same bytes."""
    reference = run_file(path, pictures, **settings)
    assert len(reference["scores"]) >= len(pictures)
    for outputs in (run_file(path, pictures, **settings), run_file(path, pictures, threads=2, **settings)):
        assert {n: v.tobytes() for n, v in outputs.items()} == {n: v.tobytes() for n, v in reference.items()}
    bare = run_file(plain, pictures, threads=2, **settings)
    assert list(bare) == list(DETECTION)
    assert "descriptors" in reference
    for name in DETECTION:
        assert bare[name].tobytes() == reference[name].tobytes()
    for index in range(len(pictures)):
        alone = run_file(path, pictures[index : index + 1], threads=1 + index % 2, **settings)
        assert _rows(alone, 0) == _rows(reference, index)


@pytest.mark.parametrize("name", ["two-scales", "region-reorg", "new-coords", "squeeze-excite", "spp"])
def test_same_bytes_however_it_is_run(tiny_model, name):
    pictures = random_pictures(read_cfg(tiny_model(name).cfg).size, count=8)
    _assert_same_bytes_however_run(
        tiny_model(name).path, tiny_model(name, descriptors=False).path, pictures, score_threshold=0.3
    )


@pytest.mark.data
@pytest.mark.parametrize("name", [REAL[0], *(pytest.param(name, marks=pytest.mark.slow) for name in REAL[1:])])
def test_same_bytes_however_real_weights_are_run(data_folder, real_model, name):
    files = sorted((data_folder / "sequences/PETS09-S2L1/img1").glob("*.jpg"))[::100][:8]
    pictures = np.stack([cv2.resize(cv2.imread(str(file)), (512, 512))[..., ::-1] for file in files])
    assert len(pictures) == 8
    plain = real_model(name, descriptors=False).path
    _assert_same_bytes_however_run(real_model(name).path, plain, pictures, score_threshold=0.1)


def test_same_network_gives_the_same_file(tiny_model, tmp_path):
    model = tiny_model("two-scales")
    import_darknet(model.cfg, model.weights, tmp_path / "again.onnx")
    assert (tmp_path / "again.onnx").read_bytes() == model.path.read_bytes()


def test_graph_is_valid_and_tells_nothing_of_the_machine_that_made_it(tiny_model, tmp_path):
    path = tiny_model("two-scales").path
    onnx.checker.check_model(str(path), full_check=True)
    raw = path.read_bytes()
    for trace in (b"site-packages", b"/tmp", b"/home", str(path.parent).encode(), b".py"):
        assert trace not in raw


def test_files_interface_is_the_published_one(tiny_model):
    """Programs in other languages rely on these names, types and shapes."""
    graph = onnx.load(tiny_model("two-scales").path).graph

    def kind(value):
        tensor = value.type.tensor_type
        dims = [d.dim_value if d.HasField("dim_value") else "any" for d in tensor.shape.dim]
        return value.name, onnx.TensorProto.DataType.Name(tensor.elem_type), dims

    assert [kind(value) for value in graph.input] == [
        ("images", "UINT8", ["any", 64, 96, 3]),
        ("score_threshold", "FLOAT", []),
        ("iou_threshold", "FLOAT", []),
        ("max_detections", "INT64", []),
    ]
    assert [kind(value) for value in graph.output] == [
        ("image_index", "INT64", ["any"]),
        ("boxes", "FLOAT", ["any", 4]),
        ("scores", "FLOAT", ["any"]),
        ("labels", "INT64", ["any"]),
        ("descriptors", "FLOAT", ["any", 24 + 20 + 20 + 16]),
    ]
