"""Files that are no model files, or not safe ones: one line that names the file, and nothing is run."""

from __future__ import annotations

import json
import os
import random

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper

from lookonce.errors import ConfigError, LookonceError, ModelError
from lookonce.model import Model, describe_model
from lookonce.model.metadata import METADATA_KEY
from lookonce.model.onnx_file import read_metadata


def _refused(path, message=""):
    with pytest.raises(ModelError) as caught:
        Model(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert len(text) < 500
    assert message in text, text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param(b"", "the file is empty", id="empty"),
        pytest.param(b"[net]\nwidth=32\nheight=32\n", "not an ONNX file", id="cfg"),
        pytest.param(b"hello\n", "not an ONNX file", id="text"),
        pytest.param(b"<!DOCTYPE html><html><body>404</body></html>", "not an ONNX file", id="web-page"),
        pytest.param(b"PK\x03\x04" + bytes(60), "not an ONNX file", id="zip"),
        pytest.param(b"\x80\x02}q\x00.", "not an ONNX file", id="pickle"),
        pytest.param(bytes(64), "not an ONNX file", id="zeros"),
        pytest.param(b"\x08" + b"\xff" * 20, "not an ONNX file", id="endless-number"),
        pytest.param(b"\x3a\xff\xff\xff\xff\x0f\x00", "not an ONNX file", id="length-beyond-the-end"),
        pytest.param(b"\x08\x0a", "not made by lookonce", id="onnx-without-anything"),
    ],
)
def test_other_files_are_refused(tmp_path, content, message):
    path = tmp_path / "other.onnx"
    path.write_bytes(content)
    _refused(path, message)


def test_missing_file_and_folder_are_refused(tmp_path):
    _refused(tmp_path / "nothing.onnx", "no such model file")
    _refused(tmp_path, "not a model file")


def test_random_bytes_are_refused(tmp_path):
    rng = random.Random(4)
    path = tmp_path / "noise.onnx"
    for _ in range(200):
        path.write_bytes(rng.randbytes(rng.randrange(1, 200)))
        _refused(path)


def test_truncated_file_is_refused(tmp_path, tiny_model):
    raw = tiny_model("activation-leaky").path.read_bytes()
    path = tmp_path / "cut.onnx"
    rng = random.Random(5)
    for length in [1, 2, len(raw) // 2, len(raw) - 1, *(rng.randrange(len(raw)) for _ in range(60))]:
        path.write_bytes(raw[:length])
        _refused(path)


def test_damaged_file_raises_nothing_but_our_errors(tmp_path, tiny_model, capfd):
    """Flipped bits; some hit weights and do no visible harm. ONNX Runtime's own fallback once wrote to stdout."""
    raw = tiny_model("activation-leaky").path.read_bytes()
    path = tmp_path / "damaged.onnx"
    rng = random.Random(6)
    messages = []
    for _ in range(200):
        damaged = bytearray(raw)
        for _ in range(rng.randint(1, 8)):
            damaged[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            Model(path, threads=1)
        except LookonceError as error:
            messages.append(str(error))
    assert 20 < len(messages) < 200
    assert [text for text in messages if str(path) not in text or "\n" in text] == []
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("good", [b"iou_threshold", b"labels", b"images"])
def test_name_that_is_not_utf8_is_refused(tmp_path, tiny_model, good):
    """ONNX Runtime hands out such names as UnicodeDecodeError, which is no sentence for a user."""
    name = good[:-1] + b"\xe8"
    raw = tiny_model("activation-leaky").path.read_bytes()
    assert good in raw
    path = tmp_path / "damaged.onnx"
    path.write_bytes(raw.replace(good, name))
    _refused(path)


def _foreign_model():
    images = helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3])
    result = helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 3])
    graph = helper.make_graph([helper.make_node("Relu", ["images"], ["y"])], "g", [images], [result])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)


def test_somebody_elses_model_is_refused(tmp_path):
    path = tmp_path / "foreign.onnx"
    onnx.save(_foreign_model(), path)
    onnxruntime.InferenceSession(path)
    _refused(path, "not made by lookonce; make one with 'lookonce import'")


def test_model_that_only_claims_to_be_ours_is_refused(tmp_path, tiny_model):
    ours = onnx.load(tiny_model("activation-leaky").path)
    model = _foreign_model()
    model.metadata_props.extend(ours.metadata_props)
    path = tmp_path / "claims.onnx"
    onnx.save(model, path)
    _refused(path, "lacks inputs or outputs that its description promises")


def _with_description(tiny_model, path, change, name="activation-leaky"):
    model = onnx.load(tiny_model(name).path)
    (entry,) = (p for p in model.metadata_props if p.key == METADATA_KEY)
    content = json.loads(entry.value)
    change(content, model)
    entry.value = json.dumps(content) if content else "{damaged"
    onnx.save(model, path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param(lambda c, m: c.update(format_version=99), "format version 99", id="other-version"),
        pytest.param(lambda c, m: c.clear(), "its description is damaged", id="damaged-json"),
        pytest.param(lambda c, m: c.pop("names"), "lacks 'names'", id="missing-field"),
        pytest.param(lambda c, m: c.update(size=[64, 96]), "not as described", id="other-size"),
        pytest.param(lambda c, m: m.graph.output.pop(), "lacks inputs or outputs", id="promised-output-is-missing"),
        pytest.param(lambda c, m: c["descriptor"].update(size=5), "not as described", id="other-descriptor-size"),
        pytest.param(lambda c, m: m.metadata_props.pop(), "not made by lookonce", id="no-description"),
    ],
)
def test_description_that_does_not_fit_is_refused(tmp_path, tiny_model, change, message):
    path = tmp_path / "changed.onnx"
    _with_description(tiny_model, path, change)
    _refused(path, message)


def _external(tensor):
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="weights.bin")
    return tensor


def _tensor(name="t"):
    return onnx.numpy_helper.from_array(np.ones(3, np.float32), name)


def _in_initializer(model):
    _external(model.graph.initializer[0])


def _in_constant(model):
    model.graph.node.insert(0, helper.make_node("Constant", [], ["extra"], value=_external(_tensor())))


def _in_branch(model):
    """A Constant of a branch of an If: three messages deep."""
    constant = helper.make_node("Constant", [], ["inside"], value=_external(_tensor()))
    result = helper.make_tensor_value_info("inside", TensorProto.FLOAT, [3])
    branch = helper.make_graph([constant], "branch", [], [result])
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.array(True), "yes"))
    model.graph.node.insert(0, helper.make_node("If", ["yes"], ["extra"], then_branch=branch, else_branch=branch))


def _in_branch_initializer(model):
    result = helper.make_tensor_value_info("inside", TensorProto.FLOAT, [3])
    branch = helper.make_graph([], "branch", [], [result], initializer=[_external(_tensor("inside"))])
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.array(True), "yes"))
    model.graph.node.insert(0, helper.make_node("If", ["yes"], ["extra"], then_branch=branch, else_branch=branch))


def _in_tensor_list(model):
    node = helper.make_node("Constant", [], ["extra"])
    node.attribute.add(name="values", type=onnx.AttributeProto.TENSORS).tensors.append(_external(_tensor()))
    model.graph.node.insert(0, node)


def _in_function(model):
    constant = helper.make_node("Constant", [], ["y"], value=_external(_tensor()))
    opset = [helper.make_opsetid("", 18)]
    model.functions.append(helper.make_function("local", "Three", [], ["y"], [constant], opset))


def _in_sparse_initializer(model):
    values, indices = _external(_tensor("s")), onnx.numpy_helper.from_array(np.arange(3), "i")
    model.graph.sparse_initializer.append(helper.make_sparse_tensor(values, indices, [9]))


def _location_only(model):
    """The file names a place without saying that the data is external."""
    model.graph.initializer[0].external_data.add(key="location", value="/etc/passwd")


@pytest.mark.parametrize(
    "hide",
    [
        _in_initializer,
        _in_constant,
        _in_branch,
        _in_branch_initializer,
        _in_tensor_list,
        _in_function,
        _in_sparse_initializer,
        _location_only,
    ],
)
def test_external_data_is_refused_wherever_it_hides(tmp_path, tiny_model, hide):
    model = onnx.load(tiny_model("activation-leaky").path)
    path = tmp_path / "external.onnx"
    path.write_bytes(model.SerializeToString())
    read_metadata(path)  # the copy itself is sound
    hide(model)
    path.write_bytes(model.SerializeToString())
    (tmp_path / "weights.bin").write_bytes(bytes(1 << 16))
    for refuse in (Model, describe_model):
        with pytest.raises(ModelError, match=r"external\.onnx: keeps weights in other files, which lookonce refuses"):
            refuse(path)


def test_model_saved_with_external_data_is_refused(tmp_path, tiny_model):
    model = onnx.load(tiny_model("activation-leaky").path)
    path = tmp_path / "external.onnx"
    onnx.save(model, path, save_as_external_data=True, location="weights.bin", size_threshold=0)
    assert (tmp_path / "weights.bin").exists()
    _refused(path, "keeps weights in other files")


def test_deep_nesting_is_refused(tmp_path):
    """Graphs inside attributes inside nodes inside graphs: reading must end, and without recursion."""
    raw = b"\x0a\x00"
    for number in [*([6, 5, 1] * 200), 7]:
        length, size = len(raw), b""
        while length >= 128:
            size, length = size + bytes([length & 127 | 128]), length >> 7
        raw = bytes([number << 3 | 2]) + size + bytes([length]) + raw
    path = tmp_path / "deep.onnx"
    path.write_bytes(raw)
    _refused(path, "not an ONNX file")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        pytest.param({"provider": "tpu"}, "provider 'tpu': expected one of cpu, cuda, openvino", id="provider"),
        pytest.param({"threads": 0}, "threads=0: expected 1 to 1024", id="no-threads"),
        pytest.param({"threads": -1}, "threads=-1", id="negative-threads"),
        pytest.param({"score_threshold": 2}, "score_threshold=2: expected 0 to 1", id="score-2"),
        pytest.param({"score_threshold": float("nan")}, "score_threshold=nan", id="score-nan"),
        pytest.param({"iou_threshold": -0.1}, "iou_threshold=-0.1", id="iou"),
        pytest.param({"max_detections": 0}, "max_detections=0", id="no-detections"),
    ],
)
def test_wrong_setting_is_refused(tiny_model, settings, message):
    with pytest.raises(ConfigError) as caught:
        Model(tiny_model("activation-leaky").path, **settings)
    assert message in str(caught.value)


def test_provider_that_is_not_installed_is_refused_with_the_remedy(tiny_model, monkeypatch):
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    for provider, package in (("cuda", "onnxruntime-gpu"), ("openvino", "onnxruntime-openvino")):
        with pytest.raises(ConfigError, match=f"pip install {package} in place of onnxruntime"):
            Model(tiny_model("activation-leaky").path, provider=provider)


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="needs a list of this process's open files")
def test_no_file_stays_open(tmp_path, tiny_model):
    def open_files():
        links = (os.path.join("/proc/self/fd", number) for number in os.listdir("/proc/self/fd"))
        return [os.readlink(link) for link in links if os.path.islink(link)]

    good, bad = tmp_path / "good.onnx", tmp_path / "bad.onnx"
    good.write_bytes(tiny_model("activation-leaky").path.read_bytes())
    bad.write_bytes(good.read_bytes()[:-5])
    model = Model(good)
    assert len(model.sha256) == 64
    _refused(bad)
    describe_model(good)
    assert not [name for name in open_files() if str(tmp_path) in name]
    good.unlink()
    assert len(model.detect(np.zeros((64, 64, 3), np.uint8)).scores) >= 0
