"""A model file that runs: what comes back for pictures of every shape."""

from __future__ import annotations

import hashlib
import threading

import numpy as np
import pytest

import lookonce.models
from lookonce.errors import ConfigError, ModelError
from lookonce.letterbox import Letterboxer, fit
from lookonce.model import Model, describe_model
from lookonce.models import find_model, shipped_models
from model_runs import run_file


def _pictures(*sizes, seed=0):
    """Coarse noise: blocks of 8 px, so that scaling leaves something to see."""
    rng = np.random.default_rng(seed)
    blocks = [rng.integers(0, 256, (-(-h // 8), -(-w // 8), 3), dtype=np.uint8) for h, w in sizes]
    return [b.repeat(8, 0).repeat(8, 1)[:h, :w].copy() for b, (h, w) in zip(blocks, sizes, strict=True)]


def _bytes(detections):
    fields = (detections.xyxy, detections.scores, detections.labels, detections.descriptors)
    return tuple(None if field is None else field.tobytes() for field in fields)


@pytest.fixture
def model(tiny_model):
    return Model(tiny_model("two-scales").path, threads=1, score_threshold=0.3)


def test_properties_tell_what_the_file_says(tiny_model, model):
    path = tiny_model("two-scales").path
    assert model.path == path
    assert model.metadata == describe_model(path)
    assert (model.size, model.names) == ((64, 96), ("class 0", "class 1", "class 2"))
    assert model.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_detections_are_the_files_outputs_on_the_letterboxed_picture(tiny_model, model):
    (picture,) = _pictures((90, 200))
    canvas, placed = Letterboxer((64, 96))(picture)
    outputs = run_file(tiny_model("two-scales").path, canvas[np.newaxis], score_threshold=0.3)
    found = model.detect(picture)
    boxes = placed.to_source(outputs["boxes"])
    boxes[:, [0, 2]], boxes[:, [1, 3]] = boxes[:, [0, 2]].clip(0, 200), boxes[:, [1, 3]].clip(0, 90)
    rows = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    assert 5 < rows.sum() == len(found) < len(rows)  # some lie in the grey margin only
    np.testing.assert_allclose(found.xyxy, boxes[rows], atol=1e-4)
    for name in ("scores", "labels", "descriptors"):
        np.testing.assert_array_equal(getattr(found, name), outputs[name][rows])


def test_rows_come_by_falling_score(model):
    for picture in _pictures((64, 96), (200, 300), seed=3):
        scores = model.detect(picture).scores
        assert len(scores) > 3
        assert (np.diff(scores) <= 0).all()


@pytest.mark.parametrize("size", [(64, 96), (480, 640), (37, 501), (501, 37), (1, 1), (3, 2), (65, 97)])
def test_boxes_lie_inside_the_picture(model, size):
    (picture,) = _pictures(size)
    found = model.detect(picture)
    assert found.xyxy.dtype == np.float32
    assert (found.xyxy >= 0).all()
    assert (found.xyxy <= np.array([size[1], size[0], size[1], size[0]])).all()
    assert (found.xyxy[:, 2:] > found.xyxy[:, :2]).all()
    assert found.descriptors is not None
    np.testing.assert_allclose(np.linalg.norm(found.descriptors, axis=1), 1, atol=1e-5)


def test_picture_in_a_batch_equals_the_picture_alone(model):
    pictures = _pictures((64, 96), (120, 90), (33, 400), (64, 96))
    together = model.detect_batch(pictures)
    assert [len(d) for d in together] != [0] * 4
    for picture, found in zip(pictures, together, strict=True):
        assert _bytes(model.detect(picture)) == _bytes(found)
    backwards = model.detect_batch(pictures[::-1])[::-1]
    assert [_bytes(d) for d in backwards] == [_bytes(d) for d in together]


def test_arguments_are_left_alone_and_need_not_be_contiguous(model):
    (picture,) = _pictures((64, 96))
    before = picture.copy()
    view = picture[::-1, ::-1]
    assert _bytes(model.detect(view)) == _bytes(model.detect(np.ascontiguousarray(view)))
    np.testing.assert_array_equal(picture, before)


def test_no_pictures_give_no_results(model):
    assert model.detect_batch([]) == []


def test_model_without_descriptors_finds_the_same(tiny_model, model):
    bare = Model(tiny_model("two-scales", descriptors=False).path, threads=1, score_threshold=0.3)
    (picture,) = _pictures((90, 200))
    found, plain = model.detect(picture), bare.detect(picture)
    assert plain.descriptors is None
    assert _bytes(plain)[:3] == _bytes(found)[:3]


def test_nothing_found_keeps_the_descriptor_length(tiny_model):
    found = Model(tiny_model("two-scales").path, score_threshold=1.0).detect(np.zeros((64, 96, 3), np.uint8))
    assert len(found) == 0
    assert found.descriptors is not None
    assert found.descriptors.shape == (0, 80)


def test_settings_reach_the_network(tiny_model):
    path, (picture,) = tiny_model("two-scales").path, _pictures((64, 96))
    many = Model(path, score_threshold=0.2).detect(picture)
    assert len(many) > len(Model(path, score_threshold=0.4).detect(picture)) > 0
    assert (Model(path, score_threshold=0.4).detect(picture).scores > 0.4).all()
    assert len(Model(path, score_threshold=0.2, max_detections=4).detect(picture)) <= 4
    assert len(Model(path, score_threshold=0.2, iou_threshold=0.9).detect(picture)) > len(many)


@pytest.mark.parametrize(
    "image",
    [
        pytest.param(np.zeros((64, 96), np.uint8), id="grey"),
        pytest.param(np.zeros((64, 96, 4), np.uint8), id="four-channels"),
        pytest.param(np.zeros((1, 64, 96, 3), np.uint8), id="batch"),
        pytest.param(np.zeros((64, 96, 3), np.float32), id="floats"),
        pytest.param(np.zeros((3, 64, 96), np.uint8), id="channels-first"),
        pytest.param(np.zeros((0, 96, 3), np.uint8), id="no-rows"),
        pytest.param([[1, 2, 3]], id="list"),
        pytest.param(None, id="none"),
    ],
)
def test_what_is_no_picture_is_a_value_error(model, image):
    with pytest.raises(ValueError, match="image: expected"):
        model.detect(image)
    with pytest.raises(ValueError, match="image: expected"):
        model.detect_batch([np.zeros((8, 8, 3), np.uint8), image])


def test_classes_are_chosen_by_name_or_number(tiny_model):
    model = Model(tiny_model("activation-leaky").path)
    assert model.labels_of([]).tolist() == []
    assert model.labels_of(["class 2", 0, " 1 ", "class 2"]).tolist() == [0, 1, 2]
    assert model.labels_of(["2"]).dtype == np.int64
    for unknown in ("lorry", 3, -1, "1.0", ""):
        with pytest.raises(ConfigError, match=r"is not in .*tiny\.onnx; it has class 0, class 1, class 2") as caught:
            model.labels_of([0, unknown])
        assert f"class '{unknown}'" in str(caught.value)


class _FakeSession:
    """Answers whatever it was given."""

    def __init__(self, *outputs):
        self.outputs = list(outputs)

    def run(self, names, feed):
        return self.outputs[: len(names)]


def test_rows_that_are_not_finite_are_dropped_and_counted(model):
    boxes = np.array([[0, 0, 9, 9], [np.nan, 0, 9, 9], [0, 0, np.inf, 9], [5, 5, 9, 9], [-9, -9, -1, -1]], np.float32)
    scores = np.array([0.9, 0.8, 0.7, np.nan, 0.5], np.float32)
    looks = np.eye(5, 80, dtype=np.float32)
    model._session = _FakeSession(np.zeros(5, np.int64), boxes, scores, np.arange(5), looks)
    found = model.run(np.zeros((1, 64, 96, 3), np.uint8), [fit((64, 96), (64, 96))])[0]
    assert found.labels.tolist() == [0]
    assert found.xyxy.tolist() == [[0, 0, 9, 9]]
    assert model.dropped_rows == 3  # the box outside the picture is no fault of the network


def test_descriptors_without_direction_become_zero(model):
    boxes = np.tile(np.float32([1, 1, 9, 9]), (4, 1))
    looks = np.eye(4, 80, dtype=np.float32)
    looks[1], looks[2] = 0, np.nan
    looks[3] *= 0.5
    outputs = (np.zeros(4, np.int64), boxes, np.float32([0.9, 0.8, 0.7, 0.6]), np.arange(4), looks)
    model._session = _FakeSession(*outputs)
    found = model.run(np.zeros((1, 64, 96, 3), np.uint8), [fit((64, 96), (64, 96))])[0]
    assert found.descriptors is not None
    assert len(found) == 4
    expected = np.zeros_like(looks)
    expected[0, 0] = 1
    np.testing.assert_array_equal(found.descriptors, expected)


def test_failure_of_the_engine_is_our_error(model):
    with pytest.raises(ModelError, match=r"tiny\.onnx: ONNX Runtime failed"):
        model.run(np.zeros((1, 32, 32, 3), np.uint8), [fit((32, 32), (32, 32))])


def test_two_threads_share_a_model(model):
    pictures = _pictures(*[(64, 96)] * 6)
    fits = [fit((64, 96), (64, 96))]
    expected = [_bytes(model.run(p[np.newaxis], fits)[0]) for p in pictures]
    results: dict[int, tuple] = {}

    def work(start):
        for index in range(start, 6, 2):
            results[index] = _bytes(model.run(pictures[index][np.newaxis], fits)[0])

    threads = [threading.Thread(target=work, args=(start,)) for start in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [results[index] for index in range(6)] == expected


def test_model_is_found_by_name_inside_the_package(tmp_path, tiny_model, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "package"
    folder.mkdir()
    monkeypatch.setattr(lookonce.models, "__file__", str(folder / "__init__.py"))
    with pytest.raises(ModelError, match="street: no such model file; give a path, or make one"):
        find_model("street")
    (folder / "street.onnx").write_bytes(tiny_model("two-scales").path.read_bytes())
    assert shipped_models() == {"street": folder / "street.onnx"}
    assert Model("street").size == (64, 96)
    with pytest.raises(ModelError, match=r"stret: no such model file; give a path \(or one of street\)"):
        Model("stret")


def test_path_comes_before_the_name_of_a_shipped_model(tmp_path, tiny_model, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(lookonce.models, "__file__", str(tmp_path / "nowhere" / "__init__.py"))
    (tmp_path / "street").write_bytes(tiny_model("activation-leaky").path.read_bytes())
    assert Model("street").size == (64, 64)
