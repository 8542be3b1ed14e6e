"""From Darknet files to a model file: what is written, and what is refused."""

from __future__ import annotations

import hashlib
import os

import pytest

import lookonce
from darknet_files import TINY, write_network
from lookonce.errors import ConfigError, FormatError, LookonceError, OutputError, WeightsError
from lookonce.make.darknet.importer import import_darknet, read_names
from lookonce.model import describe_model


def test_file_describes_itself(tmp_path):
    cfg, weights = write_network(tmp_path, TINY["two-scales"])
    (tmp_path / "some.names").write_text("car\nbig lorry\nvélo\n\n", encoding="utf-8")
    metadata = import_darknet(
        cfg, weights, tmp_path / "new" / "m.onnx", names=tmp_path / "some.names", size=(32, 64), license="MIT"
    )
    assert describe_model(tmp_path / "new" / "m.onnx") == metadata
    assert metadata.names == ("car", "big lorry", "vélo")
    assert (metadata.size, metadata.license) == ((32, 64), "MIT")
    assert [grid.stride_px for grid in metadata.outputs] == [8, 4]
    assert {name for grid in metadata.outputs for name in (grid.near, grid.early)} <= {
        f.name for f in metadata.features
    }
    assert metadata.source == {
        "cfg": "tiny.cfg",
        "weights": "tiny.weights",
        "weights_sha256": hashlib.sha256(weights.read_bytes()).hexdigest(),
    }
    assert metadata.made_by == lookonce.__version__
    assert metadata.descriptor is not None
    assert (metadata.descriptor.kind, metadata.descriptor.size) == ("native", 80)
    assert metadata.descriptor.layers == ("layer_8", "layer_6", "layer_15", "layer_4")
    assert metadata.descriptor.match_threshold is None
    by_name = {f.name: (f.channels, f.stride_px) for f in metadata.features}
    assert by_name == {"layer_8": (24, 8), "layer_6": (20, 8), "layer_15": (20, 4), "layer_4": (16, 4)}
    assert os.listdir(tmp_path / "new") == ["m.onnx"]


def test_classes_without_names_are_numbered(tiny_model):
    assert describe_model(tiny_model("two-scales").path).names == ("class 0", "class 1", "class 2")
    assert describe_model(tiny_model("two-scales", descriptors=False).path).descriptor is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param(b"car\nbus\n", "2 class names, but the network has 3", id="too-few"),
        pytest.param(b"a\nb\nc\nd\n", "4 class names, but the network has 3", id="too-many"),
        pytest.param(b"", "0 class names", id="empty"),
        pytest.param(b"a\n\xff\xfe\nc\n", "not text", id="binary"),
        pytest.param(b"x" * ((1 << 20) + 1), "larger than", id="huge"),
    ],
)
def test_names_that_do_not_fit_are_refused(tmp_path, content, message):
    cfg, weights = write_network(tmp_path, TINY["two-scales"])
    names = tmp_path / "some.names"
    names.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        import_darknet(cfg, weights, tmp_path / "m.onnx", names=names)
    assert str(caught.value).startswith(f"{names}: ")
    assert not (tmp_path / "m.onnx").exists()


def test_missing_names_are_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.names: cannot read the class names"):
        read_names(tmp_path / "none.names")


def test_wrong_inputs_write_nothing(tmp_path):
    cfg, weights = write_network(tmp_path, TINY["two-scales"])
    output = tmp_path / "m.onnx"
    with pytest.raises(ConfigError, match="multiple of 8"):
        import_darknet(cfg, weights, output, size=(63, 64))
    with pytest.raises(FormatError):
        import_darknet(weights, weights, output)
    with pytest.raises(WeightsError):
        import_darknet(cfg, cfg, output)
    assert sorted(os.listdir(tmp_path)) == ["tiny.cfg", "tiny.weights"]


def test_unwritable_output_is_named_and_leaves_no_half_file(tmp_path):
    cfg, weights = write_network(tmp_path, TINY["activation-leaky"])
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    (tmp_path / "folder.onnx").mkdir()
    before = sorted(os.listdir(tmp_path))
    for output in (tmp_path / "file" / "m.onnx", tmp_path / "folder.onnx"):
        with pytest.raises(OutputError, match="cannot write the model file") as caught:
            import_darknet(cfg, weights, output)
        assert str(caught.value).startswith(f"{output}: ")
        assert sorted(os.listdir(tmp_path)) == before


def test_an_earlier_file_stays_whole_when_writing_fails(tmp_path, monkeypatch):
    """The disk is full halfway."""
    cfg, weights = write_network(tmp_path, TINY["activation-leaky"])
    output = tmp_path / "m.onnx"
    output.write_bytes(b"earlier")

    def fail(model, path):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("lookonce.make.export.model_file.ir.save", fail)
    with pytest.raises(OutputError, match="No space left on device"):
        import_darknet(cfg, weights, output)
    assert output.read_bytes() == b"earlier"
    assert sorted(os.listdir(tmp_path)) == ["m.onnx", "tiny.cfg", "tiny.weights"]


@pytest.mark.parametrize("name", TINY)
def test_every_tiny_network_becomes_a_model_that_opens(tiny_model, name):
    lookonce.Model(tiny_model(name).path)


@pytest.mark.data
def test_official_names_fit_the_real_weights(data_folder, tmp_path):
    folder = data_folder / "weights"
    metadata = import_darknet(
        folder / "yolo-fastest-1.1.cfg",
        folder / "yolo-fastest-1.1.weights",
        tmp_path / "m.onnx",
        names=folder / "coco.names",
    )
    assert (len(metadata.names), metadata.names[2], metadata.size) == (80, "car", (320, 320))
    with pytest.raises(LookonceError, match="belongs to another network"):
        import_darknet(folder / "yolo-fastest-1.1.cfg", folder / "yolo-fastest-1.1-xl.weights", tmp_path / "n.onnx")
