"""Heads of every kind in a model file: the numbers of PyTorch, behind a detector of which nothing has changed."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import onnx
import pytest
import torch
from torch import nn

import lookonce
from lookonce.make.descriptors.compact import CompactKind
from lookonce.make.descriptors.paper import PaperKind
from lookonce.make.export.detections import NAME_PREFIX, SelectedDetections
from lookonce.make.export.reopen import RowReader, replace_descriptors
from lookonce.model import DescriptorInfo, describe_model
from model_runs import random_pictures, run_file

KINDS = {"compact": CompactKind, "paper": PaperKind}
FIELDS = [field.name for field in fields(SelectedDetections)]
DETECTION = ("image_index", "boxes", "scores", "labels")
SETTINGS = {"score_threshold": 0.3, "max_detections": 40}


@pytest.fixture(scope="module", params=KINDS)
def made(request, tiny_model, random_head, tmp_path_factory):
    """The tiny two-scale model, a head of one kind, and the model file that carries it."""
    source = tiny_model("two-scales").path
    metadata = describe_model(source)
    kind = KINDS[request.param].of(metadata)
    head = random_head(kind)
    path = tmp_path_factory.mktemp("made") / "with-head.onnx"
    described = replace(metadata, descriptor=DescriptorInfo(kind.name, 128, kind.layers))
    replace_descriptors(source, head.write, described, path)
    return source, kind, head, path


@pytest.fixture(scope="module")
def pictures():
    """Three pictures with different numbers of detections."""
    pictures = random_pictures((64, 96), count=3)
    pictures[1] = 0
    return pictures


@torch.no_grad()
def test_descriptors_equal_pytorch(made, pictures):
    source, kind, head, path = made
    outputs = run_file(path, pictures, inner=[f"{NAME_PREFIX}{name}" for name in FIELDS], **SETTINGS)
    rows = {name: outputs[f"{NAME_PREFIX}{name}"] for name in FIELDS}
    assert set(rows["scale"]) == set(rows["anchor"]) == {0, 1}
    reading = RowReader(source, kind.write_reading)(pictures, rows)
    expected = nn.functional.normalize(head(**{name: torch.from_numpy(values) for name, values in reading.items()}))
    assert outputs["descriptors"].shape == (len(rows["scale"]), 128)
    np.testing.assert_allclose(outputs["descriptors"], expected.numpy(), atol=1e-5)


def test_detections_are_unchanged_to_the_byte(made, pictures):
    source, _, _, path = made
    before, after = run_file(source, pictures, **SETTINGS), run_file(path, pictures, **SETTINGS)
    assert len(before["boxes"]) > 10
    for name in DETECTION:
        assert after[name].tobytes() == before[name].tobytes()


def _leading_to(path, outputs):
    """The operators and constants from the input to some outputs, by name, as bytes."""
    graph = onnx.load(path).graph
    makers = {output: node for node in graph.node for output in node.output}
    constants = {tensor.name: tensor for tensor in graph.initializer}
    pending, nodes, tensors = list(outputs), {}, {}
    while pending:
        name = pending.pop()
        if name in constants:
            tensors[name] = constants[name].SerializeToString(deterministic=True)
        elif name in makers and name not in nodes:
            nodes[name] = makers[name].SerializeToString(deterministic=True)
            pending += makers[name].input
    return nodes, tensors


def test_all_that_leads_to_detections_is_unchanged_to_the_byte(made):
    """Every weight, every operator and every default threshold."""
    source, _, _, path = made
    nodes, tensors = _leading_to(source, DETECTION)
    assert {"score_threshold", "iou_threshold", "max_detections"} < tensors.keys()
    assert len(nodes) > 40
    assert len(tensors) > 30
    assert sum(map(len, tensors.values())) > 4 * 10_000
    assert _leading_to(path, DETECTION) == (nodes, tensors)


@pytest.mark.parametrize("most", [1, 40])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_picture_in_a_batch_equals_itself_alone_to_the_byte(made, pictures, threads, most):
    settings = SETTINGS | {"max_detections": most, "threads": threads}
    together = run_file(made[3], pictures, **settings)
    counts = np.bincount(together["image_index"], minlength=3)
    assert counts.max() == most
    for image in range(3):
        alone = run_file(made[3], pictures[image : image + 1], **settings)
        assert len(alone["boxes"]) == counts[image]
        for name in ("boxes", "scores", "labels", "descriptors"):
            assert alone[name].tobytes() == together[name][together["image_index"] == image].tobytes()


@pytest.mark.parametrize("count", [1, 3])
def test_no_detections_have_no_descriptors(made, pictures, count):
    """ONNX Runtime fused a transposition into a matrix product, which then refused 0 rows."""
    outputs = run_file(made[3], pictures[:count], score_threshold=1.0)
    assert outputs["descriptors"].shape == (0, 128)
    assert outputs["boxes"].shape == (0, 4)


def test_the_file_opens_and_its_descriptors_are_of_unit_length(made, pictures):
    _, kind, _, path = made
    model = lookonce.Model(path, score_threshold=0.3)
    assert model.metadata.descriptor == DescriptorInfo(kind.name, 128, kind.layers)
    descriptors = model.detect(pictures[0]).descriptors
    assert len(descriptors) > 10
    np.testing.assert_allclose(np.linalg.norm(descriptors, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("kind_of", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("name", ["activation-leaky", "region-reorg", "squeeze-excite"])
def test_other_detectors_can_carry_the_head(tiny_model, random_head, tmp_path, kind_of, name):
    """One grid; one layer for both; anchors in cells."""
    source = tiny_model(name).path
    metadata = describe_model(source)
    kind = kind_of.of(metadata)
    head = random_head(kind)
    described = replace(metadata, descriptor=DescriptorInfo(kind.name, 128, kind.layers))
    replace_descriptors(source, head.write, described, tmp_path / "m.onnx")
    outputs = run_file(tmp_path / "m.onnx", random_pictures((64, 64), count=2), score_threshold=0.2, max_detections=40)
    assert len(outputs["descriptors"]) > 5
    np.testing.assert_allclose(np.linalg.norm(outputs["descriptors"], axis=1), 1, atol=1e-6)
    nothing = run_file(tmp_path / "m.onnx", random_pictures((64, 64)), score_threshold=1.0)
    assert nothing["descriptors"].shape == (0, 128)
