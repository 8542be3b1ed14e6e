"""The end of the graph: decoding, suppression, order and limits, against the same rules written plainly."""

from __future__ import annotations

import numpy as np
import pytest

from darknet_files import CLASSES, conv, head, net, section, write_network, yolo
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.importer import import_darknet
from model_runs import random_pictures, run_file, torch_maps
from plain_detector import plain_detections

FORMS = ["two-scales", "region-reorg", "new-coords", "scale-x-y"]


def _assert_equal_detections(outputs, expected_by_image):
    """The same rows in the same order: boxes within 1/1000 px, scores within 1e-5.

    Float32 cannot tell scores apart that differ by less than 1e-6; rows that near may swap.
    """
    expected = [(index, row) for index, rows in enumerate(expected_by_image) for row in rows]
    assert outputs["image_index"].tolist() == [index for index, _ in expected]
    for index, label, score, box in zip(
        *(outputs[n] for n in ("image_index", "labels", "scores", "boxes")), strict=True
    ):
        first = expected[0][1].score
        near = [n for n, (_, row) in enumerate(expected[:20]) if first - row.score < 1e-6 and row.label == label]
        assert near, f"label {label} where {expected[0]} belongs"
        row_index, row = expected.pop(near[0])
        assert row_index == index
        np.testing.assert_allclose(score, row.score, atol=1e-5)
        np.testing.assert_allclose(box, row.box, atol=1e-3, rtol=1e-5)


def _expected(model, pictures, **settings):
    config = read_cfg(model.cfg, model.size)
    raw, _ = torch_maps(model.cfg, model.weights, pictures, model.size)
    return [plain_detections(config, [r[image] for r in raw], **settings) for image in range(len(pictures))]


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({}, id="defaults"),
        pytest.param({"score_threshold": 0.1, "iou_threshold": 0.3}, id="low-thresholds"),
        pytest.param({"score_threshold": 0.3, "iou_threshold": 0.9}, id="much-overlap"),
        pytest.param({"score_threshold": 0.3, "iou_threshold": 0.0}, id="no-overlap"),
        pytest.param({"score_threshold": 0.1, "max_detections": 5}, id="few"),
        pytest.param({"score_threshold": 0.1, "max_detections": 1}, id="one"),
    ],
)
def test_detections_equal_plain_decoding_and_suppression(tiny_model, name, settings):
    model = tiny_model(name)
    pictures = random_pictures(read_cfg(model.cfg).size, count=2)
    expected = _expected(model, pictures, **settings)
    limit = settings.get("max_detections")
    assert all(len(rows) == limit if limit else len(rows) > 1 for rows in expected)
    _assert_equal_detections(run_file(model.path, pictures, **settings), expected)


def test_sizes_other_than_the_cfgs_own_and_not_square(tiny_model):
    for size in [(32, 96), (96, 32), (128, 64)]:
        model = tiny_model("two-scales", size=size)
        pictures = random_pictures(size)
        expected = _expected(model, pictures, score_threshold=0.1)
        assert len(expected[0]) > 5
        _assert_equal_detections(run_file(model.path, pictures, score_threshold=0.1), expected)


def _uniform_model(tmp_path, head_bias):
    """A network whose last convolution has no weights but biases: every cell says the same. 2 x 2 cells."""
    body = net(32, 32) + conv(4, 3, 16, batch_normalize=0) + head() + yolo()
    cfg, weights = write_network(tmp_path, body)
    raw = bytearray(weights.read_bytes())
    count = 3 * (5 + CLASSES)
    values = np.concatenate([np.tile(np.asarray(head_bias, "<f4"), 3), np.zeros(count * 4, "<f4")])
    raw[-values.nbytes :] = values.tobytes()
    weights.write_bytes(raw)
    import_darknet(cfg, weights, tmp_path / "tiny.onnx")
    return cfg, weights, tmp_path / "tiny.onnx"


def test_ties_go_to_the_lowest_class_then_the_first_anchor(tmp_path):
    """All cells, anchors and two classes have equal scores: the order is class, anchor, row, column."""
    cfg, weights, path = _uniform_model(tmp_path, [0, 0, -1.5, -1.5, 4, 2, -9, 2])
    pictures = random_pictures((32, 32), count=2)
    outputs = run_file(path, pictures, iou_threshold=1.0)
    raw, _ = torch_maps(cfg, weights, pictures)
    config = read_cfg(cfg)
    expected = [plain_detections(config, [r[i] for r in raw], iou_threshold=1.0) for i in range(2)]
    _assert_equal_detections(outputs, expected)
    assert outputs["labels"].tolist() == ([0] * 12 + [2] * 12) * 2
    centres = (outputs["boxes"][:12, :2] + outputs["boxes"][:12, 2:]) / 2
    np.testing.assert_allclose(centres, [[8, 8], [24, 8], [8, 24], [24, 24]] * 3, atol=1e-3)
    np.testing.assert_allclose(
        np.ptp(outputs["boxes"][::4][:3, [0, 2]], axis=1), np.exp(-1.5) * np.array([8, 14, 30]), 1e-5
    )

    cut = run_file(path, pictures, iou_threshold=1.0, max_detections=5)
    for name, values in cut.items():
        np.testing.assert_array_equal(values[:5], outputs[name][:5])
        np.testing.assert_array_equal(values[5:], outputs[name][24:29])


def test_suppression_is_per_class(tmp_path):
    """Boxes of one cell overlap fully; of each class one is left, and the classes do not touch each other."""
    _, _, path = _uniform_model(tmp_path, [0, 0, -5, -5, 4, 2, -9, 2])
    outputs = run_file(path, random_pictures((32, 32)), iou_threshold=0.01)
    assert outputs["labels"].tolist() == [0] * 4 + [2] * 4


def test_score_equal_to_the_threshold_is_not_above_it(tmp_path):
    """Detections *above* the threshold are kept."""
    _, _, path = _uniform_model(tmp_path, [0, 0, 0, 0, 4, 2, -9, 2])
    pictures = random_pictures((32, 32))
    score = run_file(path, pictures)["scores"][0]
    assert len(run_file(path, pictures, score_threshold=float(score))["scores"]) == 0
    assert len(run_file(path, pictures, score_threshold=float(np.nextafter(score, np.float32(0))))["scores"]) > 0


@pytest.mark.parametrize("count", [1, 3])
def test_nothing_found_gives_empty_outputs_of_the_right_kind(tiny_model, count):
    model = tiny_model("two-scales")
    outputs = run_file(model.path, random_pictures((64, 96), count), score_threshold=1.0)
    kinds = {name: (values.shape, values.dtype.name) for name, values in outputs.items()}
    width = kinds["descriptors"][0][1]
    assert kinds == {
        "image_index": ((0,), "int64"),
        "boxes": ((0, 4), "float32"),
        "scores": ((0,), "float32"),
        "labels": ((0,), "int64"),
        "descriptors": ((0, width), "float32"),
    }
    assert width > 0


def test_images_with_and_without_detections_share_a_batch(tmp_path):
    """One grey level lights the objectness, the other does not; each row keeps its image, whatever the order."""
    body = net(32, 32) + conv(1, 1, 16, activation="linear", batch_normalize=0) + conv(4, 1, batch_normalize=0)
    body += head(1) + section("yolo", mask=0, anchors="8,8", classes=CLASSES, num=1)
    cfg, weights = write_network(tmp_path, body)
    values = np.zeros(read_cfg(cfg).parameter_count, "<f4")
    values[0], values[1:4] = -3.0, 2.0  # bias, red, green, blue: grey level * 6 - 3
    values[8:12] = 1.0  # the four filters behind it
    values[12:20] = [0, 0, 0, 0, -3, 3, -9, -9]
    values[20 + 4 * 4] = 3.0  # objectness reads the first filter
    weights.write_bytes(weights.read_bytes()[:20] + values.tobytes())
    import_darknet(cfg, weights, tmp_path / "tiny.onnx")
    pictures = np.zeros((5, 32, 32, 3), np.uint8)
    pictures[1] = 255
    pictures[3, :16, 16:] = 255
    outputs = run_file(tmp_path / "tiny.onnx", pictures)
    assert outputs["image_index"].tolist() == [1, 1, 1, 1, 3]
    np.testing.assert_allclose(outputs["boxes"][-1], [20, 4, 28, 12], atol=1e-4)
    for index in range(5):
        alone = run_file(tmp_path / "tiny.onnx", pictures[index : index + 1])
        for name in ("boxes", "scores", "labels", "descriptors"):
            assert alone[name].tobytes() == outputs[name][outputs["image_index"] == index].tobytes()


def test_thresholds_may_be_left_out(tiny_model):
    model = tiny_model("scale-x-y")
    pictures = random_pictures((64, 64))
    plain = run_file(model.path, pictures)
    explicit = run_file(model.path, pictures, score_threshold=0.25, iou_threshold=0.45, max_detections=1000)
    for name, values in plain.items():
        assert values.tobytes() == explicit[name].tobytes()
