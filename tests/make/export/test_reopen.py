"""Model files opened again: read at given boxes, and given other descriptors."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import onnx
import pytest

from lookonce.errors import ModelError, OutputError
from lookonce.make.export.detections import NAME_PREFIX, SelectedDetections
from lookonce.make.export.reopen import RowReader, open_describer, replace_descriptors
from lookonce.model import DescriptorInfo, Model, describe_model
from lookonce.model.metadata import METADATA_KEY
from model_runs import random_pictures, run_file, torch_maps

FIELDS = [field.name for field in fields(SelectedDetections)]
DETECTION = ("image_index", "boxes", "scores", "labels")
SETTINGS = {"score_threshold": 0.3, "max_detections": 40}


@pytest.fixture(scope="module")
def model(tiny_model):
    """Two grids; descriptors of kind ``native``, of 80 values."""
    return tiny_model("two-scales")


@pytest.fixture(scope="module")
def pictures():
    pictures = random_pictures((64, 96), count=3)
    pictures[1] = 0
    return pictures


@pytest.fixture(scope="module")
def found(model, pictures):
    """The model's own outputs, and the rows of its detections."""
    outputs = run_file(model.path, pictures, inner=[f"{NAME_PREFIX}{name}" for name in FIELDS], **SETTINGS)
    return outputs, {name: outputs[f"{NAME_PREFIX}{name}"] for name in FIELDS}


def _changed(path, folder, change):
    """A copy of a model file after ``change(onnx model)``."""
    content = onnx.load(path)
    change(content)
    (folder / "changed.onnx").write_bytes(content.SerializeToString())
    return folder / "changed.onnx"


def _rename(old, new):
    """A change that calls a tensor something else, wherever it occurs."""

    def change(content):
        for node in content.graph.node:
            node.input[:] = [new if name == old else name for name in node.input]
            node.output[:] = [new if name == old else name for name in node.output]

    return change


def _describe(**values):
    """A change of the file's own description."""

    def change(content):
        (entry,) = [entry for entry in content.metadata_props if entry.key == METADATA_KEY]
        entry.value = json.dumps(json.loads(entry.value) | values)

    return change


def _read_features(g, rows, features):
    return dict(features)


def _box_sizes(g, rows, features):
    """A head of four values: the box."""
    return g("Identity", rows.boxes)


def _with_head(path, output, write=_box_sizes, size=4):
    described = replace(describe_model(path), descriptor=DescriptorInfo("test", size, ()))
    replace_descriptors(path, write, described, output)
    return output


def test_descriptors_at_the_detections_own_rows_are_the_models_own(model, pictures, found):
    outputs, rows = found
    describer = open_describer(model.path)
    assert describer.metadata == describe_model(model.path)
    described = describer(pictures, rows)
    assert set(described) == {"descriptors"}
    assert len(outputs["descriptors"]) > 10
    np.testing.assert_allclose(described["descriptors"], outputs["descriptors"], atol=1e-6)


def test_given_rows_may_be_any_rows_in_any_order(model, pictures, found):
    outputs, rows = found
    chosen = np.random.default_rng(0).permutation(len(rows["cell"]))[:7]
    chosen = np.append(chosen, chosen[0])
    described = open_describer(model.path)(pictures, {name: values[chosen] for name, values in rows.items()})
    np.testing.assert_allclose(described["descriptors"], outputs["descriptors"][chosen], atol=1e-6)


def test_no_rows_have_no_descriptors(model, pictures, found):
    none = {name: values[:0] for name, values in found[1].items()}
    assert open_describer(model.path)(pictures, none)["descriptors"].shape == (0, 80)


def test_rows_that_are_not_read_need_not_be_given(model, pictures, found):
    rows = {name: found[1][name] for name in ("image_index", "scale", "cell")}
    assert len(open_describer(model.path)(pictures, rows)["descriptors"]) == len(rows["cell"])


def test_features_are_read_by_name(model, pictures):
    read = RowReader(model.path, _read_features)(pictures, {})
    _, expected = torch_maps(model.cfg, model.weights, pictures, features=[4, 6, 8, 15])
    assert set(read) == {f"layer_{index}" for index in expected}
    for index, values in expected.items():
        np.testing.assert_allclose(read[f"layer_{index}"], values, atol=1e-5 * np.ptp(values))


def test_given_rows_can_be_read_as_they_are(model, pictures):
    """A row that was only passed on was no input of the graph, and ONNX Runtime refused the graph."""
    reader = RowReader(model.path, lambda g, rows, features: {"anchor": rows.anchor, "corners": rows.boxes})
    rows = {"anchor": np.array([3, 1]), "boxes": np.arange(8, dtype=np.float32).reshape(2, 4)}
    read = reader(pictures, rows)
    np.testing.assert_array_equal(read["anchor"], rows["anchor"])
    np.testing.assert_array_equal(read["corners"], rows["boxes"])


def test_given_rows_have_the_class_that_the_detector_sees_there(model, pictures):
    """Every anchor of every cell, against the maps of PyTorch."""
    metadata = describe_model(model.path)
    grids = [
        np.indices((3, len(grid.anchors_px), *(n // grid.stride_px for n in metadata.size)))
        for grid in metadata.outputs
    ]
    rows = {
        name: np.concatenate([values(grid).ravel() for grid in grids])
        for name, values in {
            "image_index": lambda grid: grid[0],
            "anchor": lambda grid: grid[1],
            "cell": lambda grid: grid[2] * grid.shape[-1] + grid[3],
        }.items()
    }
    rows["scale"] = np.repeat(np.arange(len(grids)), [grid[0].size for grid in grids])
    rows["labels"] = np.full(len(rows["scale"]), -1)
    reader = RowReader(model.path, lambda g, rows, features: {"labels": rows.labels})
    read = reader(pictures, rows)
    raw, _ = torch_maps(model.cfg, model.weights, pictures, features=[4])
    classes = len(metadata.names)
    expected = [
        values.reshape(3, -1, 5 + classes, *values.shape[2:])[:, :, 5:].argmax(axis=2).ravel() for values in raw
    ]
    assert classes > 1
    assert len(set(read["labels"])) == classes
    assert (read["labels"] == np.concatenate(expected)).mean() > 0.999  # but for ties
    np.testing.assert_array_equal(reader(pictures, rows | {"labels": rows["scale"]})["labels"], rows["scale"])


def test_names_of_what_is_read_are_free(model, pictures):
    """One tensor under two names had only the last; names of other tensors of the graph were taken."""

    def write(g, rows, features):
        return {"images": features["layer_4"], "layer_8": features["layer_4"], "layer_4": features["layer_8"]}

    read = RowReader(model.path, write)(pictures, {})
    assert {name: values.shape[1] for name, values in read.items()} == {"images": 16, "layer_8": 16, "layer_4": 24}
    np.testing.assert_array_equal(read["images"], read["layer_8"])


def test_reading_leaves_the_file_alone(model, pictures, found):
    before = model.path.read_bytes()
    open_describer(model.path)(pictures, found[1])
    assert model.path.read_bytes() == before


def test_replaced_descriptors_come_from_the_new_head(model, pictures, found, tmp_path):
    path = _with_head(model.path, tmp_path / "new" / "m.onnx")
    outputs = run_file(path, pictures, **SETTINGS)
    np.testing.assert_array_equal(outputs["descriptors"], found[0]["boxes"])
    for name in DETECTION:
        assert outputs[name].tobytes() == found[0][name].tobytes()
    described = open_describer(path)(pictures, found[1])
    np.testing.assert_array_equal(described["descriptors"], found[0]["boxes"])
    assert describe_model(path) == replace(describe_model(model.path), descriptor=DescriptorInfo("test", 4, ()))
    Model(path)


def test_the_file_itself_can_be_replaced(model, pictures, found, tmp_path):
    path = tmp_path / "m.onnx"
    path.write_bytes(model.path.read_bytes())
    _with_head(path, path)
    np.testing.assert_array_equal(run_file(path, pictures, **SETTINGS)["descriptors"], found[0]["boxes"])


def _write_wide_head(g, rows, features):
    """A head with constants and operators of its own that reads a feature."""
    mean = g("ReduceMean", features["layer_4"], g.constant([2, 3]), keepdims=0)  # (B, 16)
    return g("Mul", g("Gather", mean, rows.image_index), g.constant(np.linspace(1, 2, 16, dtype=np.float32)))


def test_replacing_again_leaves_nothing_of_the_first_head(model, pictures, found, tmp_path):
    once = _with_head(model.path, tmp_path / "once.onnx")
    between = _with_head(model.path, tmp_path / "between.onnx", _write_wide_head, 16)
    twice = _with_head(between, tmp_path / "twice.onnx")
    graphs = [onnx.load(path).graph for path in (once, between, twice)]
    nodes = [[node.op_type for node in graph.node] for graph in graphs]
    assert nodes[2] == nodes[0]
    assert len(nodes[1]) == len(nodes[0]) + 2
    tensors = [sorted(tensor.SerializeToString() for tensor in graph.initializer) for graph in graphs]
    assert tensors[2] == tensors[0]
    np.testing.assert_array_equal(run_file(twice, pictures, **SETTINGS)["descriptors"], found[0]["boxes"])
    assert run_file(between, pictures, **SETTINGS)["descriptors"].shape == (len(found[0]["boxes"]), 16)


def test_features_that_nothing_reads_stay_for_later_heads(model, pictures, tmp_path):
    """One is not even on the way to the detections."""

    def add_feature(content):
        content.graph.node.append(onnx.helper.make_node("Neg", ["layer_4"], ["extra"]))
        features = json.loads(describe_model(model.path).to_json())["features"]
        _describe(features=[*features, {"name": "extra", "channels": 16, "stride_px": 4}])(content)

    source = _changed(model.path, tmp_path, add_feature)
    path = _with_head(source, tmp_path / "m.onnx")
    before, after = (RowReader(p, _read_features)(pictures, {}) for p in (source, path))
    assert set(after) == {"layer_4", "layer_6", "layer_8", "layer_15", "extra"}
    for name, values in before.items():
        assert after[name].tobytes() == values.tobytes()


def test_a_file_that_only_detects_gets_descriptors(tiny_model, pictures, found, tmp_path):
    source = tiny_model("two-scales", descriptors=False).path
    assert "descriptors" not in run_file(source, pictures)
    path = _with_head(source, tmp_path / "m.onnx")
    np.testing.assert_array_equal(run_file(path, pictures, **SETTINGS)["descriptors"], found[0]["boxes"])


def test_a_file_that_only_detects_has_nothing_to_describe_with(tiny_model):
    path = tiny_model("two-scales", descriptors=False).path
    with pytest.raises(ModelError, match="has no descriptors; train some") as caught:
        open_describer(path)
    _assert_one_line(caught, path)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda content: content.graph.output.pop(), id="promised-but-absent"),
        pytest.param(_describe(descriptor=None), id="there-but-not-described"),
    ],
)
def test_descriptors_and_their_description_go_together(model, tmp_path, change):
    path = _changed(model.path, tmp_path, change)
    with pytest.raises(ModelError, match="has no descriptors") as caught:
        open_describer(path)
    _assert_one_line(caught, path)


def _assert_one_line(caught, path):
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param(_rename("layer_6", "other"), "lacks the feature layer_6; make it again", id="feature-missing"),
        pytest.param(_describe(features=[]), "names no features that descriptors could read", id="no-features"),
        pytest.param(_rename("detection_cell", "other"), "does not name detection_cell; make it again", id="by-hand"),
        pytest.param(
            lambda content: content.graph.input.pop(0), "its first input is not 'images'; make it", id="no-images"
        ),
        pytest.param(
            lambda content: content.graph.node.append(content.graph.node[0]),
            "not an ONNX file, or damaged",
            id="damage",
        ),
        pytest.param(_describe(format_version=99), "format version 99", id="other-version"),
        pytest.param(lambda content: content.ClearField("metadata_props"), "not made by lookonce", id="not-ours"),
    ],
)
def test_files_that_cannot_be_reopened_are_refused_in_one_line(model, tmp_path, change, message):
    path = _changed(model.path, tmp_path, change)
    output = tmp_path / "out.onnx"
    described = replace(describe_model(model.path), descriptor=DescriptorInfo("test", 4, ()))
    for attempt in (
        lambda: RowReader(path, _read_features),
        lambda: open_describer(path),
        lambda: replace_descriptors(path, _box_sizes, described, output),
    ):
        with pytest.raises(ModelError, match=message) as caught:
            attempt()
        _assert_one_line(caught, path)
    assert not output.exists()


def test_a_file_whose_description_hides_the_last_layers_is_refused(model, tmp_path):
    """From these the class of a given box is told."""
    path = _changed(model.path, tmp_path, _describe(features=[{"name": "layer_4", "channels": 16, "stride_px": 4}]))
    with pytest.raises(ModelError, match=r"cannot tell which map the .* grid is decoded from; make it again") as caught:
        open_describer(path)
    _assert_one_line(caught, path)


def test_a_file_that_is_cut_short_or_absent_is_refused(model, tmp_path):
    (tmp_path / "cut.onnx").write_bytes(model.path.read_bytes()[:-100])
    for name in ("cut.onnx", "none.onnx"):
        with pytest.raises(ModelError) as caught:
            open_describer(tmp_path / name)
        _assert_one_line(caught, tmp_path / name)


def test_an_output_that_cannot_be_written_is_named(model, tmp_path):
    (tmp_path / "m.onnx").mkdir()
    with pytest.raises(OutputError, match=r"m\.onnx: cannot write the model file"):
        _with_head(model.path, tmp_path / "m.onnx")
