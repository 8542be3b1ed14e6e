"""The model file's description of itself: there and back, and every damage refused in one line."""

from __future__ import annotations

import json

import pytest

from lookonce.errors import ModelError
from lookonce.model.metadata import DescriptorInfo, Feature, ModelMetadata, OutputGrid

FULL = ModelMetadata(
    names=("car", "Straßenbahn", 'quote " and \\ and \u00e9'),
    size=(288, 512),
    outputs=(
        OutputGrid(32, ((81.0, 82.0), (135.0, 169.0)), "layer_1", "layer_1"),
        OutputGrid(16, ((10.0, 14.0), (23.0, 27.5)), "layer_2", "layer_1"),
    ),
    descriptor=DescriptorInfo("native", 608, ("layer_1", "layer_2"), 0.75),
    features=(Feature("layer_1", 96, 32), Feature("layer_2", 512, 16)),
    license="MIT",
    source={"cfg": "a.cfg"},
    training={"data": "none"},
    made_by="0.1.0",
)
BARE = ModelMetadata(names=("car",), size=(64, 64), outputs=(OutputGrid(8, ((4.0, 4.0),), "a", "a"),))


@pytest.mark.parametrize("metadata", [FULL, BARE], ids=["full", "bare"])
def test_description_survives_the_way_through_the_file(metadata):
    assert ModelMetadata.from_json("m.onnx", metadata.to_json()) == metadata


def test_description_is_plain_json():
    content = json.loads(FULL.to_json())
    assert content["format_version"] == 1
    assert content["descriptor"]["match_threshold"] == 0.75
    assert content["names"] == list(FULL.names)


def _changed(**changes):
    return json.dumps({**json.loads(FULL.to_json()), **changes})


def _output(**changes):
    return {**json.loads(FULL.to_json())["outputs"][0], **changes}


def _descriptor(**changes):
    return {**json.loads(FULL.to_json())["descriptor"], **changes}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("", "damaged", id="empty"),
        pytest.param("{", "damaged", id="cut"),
        pytest.param("[]", "damaged", id="list"),
        pytest.param("3", "damaged", id="number"),
        pytest.param('"format_version"', "damaged", id="text"),
        pytest.param("{}", "damaged", id="nothing"),
        pytest.param("[" * 100_000, "damaged", id="deep"),
        pytest.param(_changed(format_version=2), "format version 2, but this lookonce reads version 1", id="newer"),
        pytest.param(_changed(format_version=None), "format version None", id="no-version"),
        pytest.param(_changed(format_version="x" * 500), "format version xxx", id="endless-version"),
        pytest.param(_changed(names=[]), "damaged", id="no-names"),
        pytest.param(_changed(names=["a", 3]), "expected a short text", id="name-is-number"),
        pytest.param(_changed(names=["x" * 20_000]), "expected a short text", id="endless-name"),
        pytest.param(_changed(names="car"), "expected a list", id="names-are-text"),
        pytest.param(_changed(size=[64]), "expected a list of 2", id="size-of-one"),
        pytest.param(_changed(size=[64, 64.5]), "expected a whole number", id="size-of-fractions"),
        pytest.param(_changed(size=[0, 64]), "from 1 to 4096, got 0", id="size-zero"),
        pytest.param(_changed(size=[64, True]), "expected a whole number", id="size-true"),
        pytest.param(_changed(size=[64, 10**30]), "expected a whole number", id="size-huge"),
        pytest.param(_changed(outputs=[]), "expected a list", id="no-outputs"),
        pytest.param(_changed(outputs=[3]), "expected an output grid", id="output-is-number"),
        pytest.param(_changed(outputs=[_output(stride_px=0)]), "expected a whole number", id="stride-zero"),
        pytest.param(_changed(outputs=[_output(anchors_px=[])]), "expected a list", id="no-anchors"),
        pytest.param(_changed(outputs=[_output(anchors_px=[[1]])]), "list of 2 to 2", id="anchor-of-one-number"),
        pytest.param(_changed(outputs=[_output(anchors_px=[[1, -2]])]), "anchors_px: expected", id="negative-anchor"),
        pytest.param(_changed(outputs=[_output(near=7)]), "expected a short text", id="near-is-number"),
        pytest.param(_changed(names=["a\nb"]), "on one line", id="name-with-line-break"),
        pytest.param(_changed(names=["\x1b[31m"]), "on one line", id="name-with-escape-code"),
        pytest.param(_changed(descriptor=[]), "expected a descriptor", id="descriptor-list"),
        pytest.param(_changed(descriptor={}), "lacks 'match_threshold'", id="descriptor-empty"),
        pytest.param(_changed(descriptor=_descriptor(size=-1)), "expected a whole number", id="descriptor-size"),
        pytest.param(_changed(descriptor=_descriptor(match_threshold=-1.0)), "positive", id="threshold-negative"),
        pytest.param(_changed(descriptor=_descriptor(match_threshold=float("nan"))), "positive", id="threshold-nan"),
        pytest.param(_changed(descriptor=_descriptor(match_threshold="1")), "positive", id="threshold-text"),
        pytest.param(_changed(features=[3]), "expected a feature", id="feature-number"),
        pytest.param(_changed(features=[{"name": "a", "channels": 3}]), "lacks 'stride_px'", id="feature-cut"),
        pytest.param(_changed(source={"a": 1}), "expected a short text", id="source-of-numbers"),
        pytest.param(_changed(source=[]), "expected named texts", id="source-list"),
        pytest.param(_changed(made_by=None), "expected a short text", id="made-by-nobody"),
    ],
)
def test_damaged_description_is_refused_in_one_line(text, message):
    with pytest.raises(ModelError) as caught:
        ModelMetadata.from_json("some.onnx", text)
    assert str(caught.value).startswith("some.onnx: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("key", [key for key in json.loads(BARE.to_json()) if key != "format_version"])
def test_missing_field_is_named(key):
    content = json.loads(BARE.to_json())
    del content[key]
    with pytest.raises(ModelError, match=f"lacks '{key}'"):
        ModelMetadata.from_json("some.onnx", json.dumps(content))
