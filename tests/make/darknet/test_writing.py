"""Darknet's own files written by us are read back as what they were."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from darknet_files import TINY, write_network
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.layers import Convolutional, DarknetConfig, Yolo
from lookonce.make.darknet.weights import read_weights
from lookonce.make.darknet.writing import cfg_with, weights_bytes

WITH_YOLO = [name for name, body in TINY.items() if "[region]" not in body]


def rewritten(text: str, folder: Path, **changes) -> tuple[DarknetConfig, DarknetConfig]:
    """The network before and after."""
    before, after = folder / "before.cfg", folder / "after.cfg"
    before.write_text(text)
    network = read_cfg(before)
    after.write_text(cfg_with(text, network, **changes))
    return network, read_cfg(after)


def assert_changed(before: DarknetConfig, after: DarknetConfig, anchors, classes: int) -> None:
    """Nothing but outputs and the convolutions before them is another."""
    heads = {layer.index - 1 for layer in before.outputs}
    assert len(after.layers) == len(before.layers)
    for old, new in zip(before.layers, after.layers, strict=True):
        if isinstance(old.spec, Yolo):
            own = anchors[[layer.index for layer in before.outputs].index(old.index)]
            assert new.spec == replace(old.spec, anchors=tuple(own), classes=classes)
        elif old.index in heads:
            assert isinstance(old.spec, Convolutional)
            following = before.layers[old.index + 1].spec
            assert new.spec == replace(old.spec, filters=len(following.anchors) * (5 + classes))
        else:
            assert new.spec == old.spec
            assert (new.channels, new.height, new.width) == (old.channels, old.height, old.width)


def other_anchors(network: DarknetConfig) -> list[list[tuple[float, float]]]:
    """Sizes that no cfg has."""
    counts = [len(network.output_spec(layer).anchors) for layer in network.outputs]
    return [[(10 * o + n + 0.5, 20.0 * o + n + 3) for n in range(count)] for o, count in enumerate(counts)]


@pytest.mark.parametrize("name", WITH_YOLO)
def test_other_anchors_and_classes_are_read_back(tmp_path, name):
    (tmp_path / "tiny.cfg").write_text(TINY[name])
    anchors = other_anchors(read_cfg(tmp_path / "tiny.cfg"))
    before, after = rewritten(TINY[name], tmp_path, anchors=anchors, classes=7)
    assert_changed(before, after, anchors, 7)
    assert after.size == before.size


@pytest.mark.parametrize("name", ["two-scales", "maxpool-3"])
def test_another_size_is_read_back(tmp_path, name):
    before, after = rewritten(TINY[name], tmp_path, size=(128, 192))
    assert after == replace(read_cfg(tmp_path / "before.cfg", (128, 192)), path=after.path)
    assert [layer.spec for layer in after.layers] == [layer.spec for layer in before.layers]


@pytest.mark.parametrize("name", WITH_YOLO)
def test_nothing_changed_is_nothing_changed(tmp_path, name):
    before, after = rewritten(TINY[name], tmp_path)
    assert replace(after, path=before.path) == before
    assert cfg_with(TINY[name], before).split() == TINY[name].split()


def test_comments_blanks_and_keys_that_are_not_there_do_no_harm(tmp_path):
    text = (
        "# a network\n\n [net] # here\nwidth = 64 # px\nheight=64\n;height=32\nchannels=3\n"
        "[convolutional]\nfilters=4\nsize=3\nstride=2\npad=1\nactivation=leaky\n"
        "[convolutional]\n#filters=99\nfilters = 4\nsize=3\nstride=1\npad=1\nactivation=leaky\n"
        "[convolutional]\nsize=1\n filters = 21 ; seven for each\nactivation=linear\n"
        "[yolo]\nanchors = 8,8, 16,16, 30,30, 60,60\nmask = 0,2,3\nclasses=2\nnum=4\njitter=.3"
    )
    anchors = [[(5.0, 6.0), (7.0, 8.0), (9.5, 10.0)]]
    before, after = rewritten(text, tmp_path, anchors=anchors, classes=3, size=(96, 128))
    assert before.output_spec(before.outputs[0]).anchors == ((8, 8), (30, 30), (60, 60))
    assert after.output_spec(after.outputs[0]).anchors == tuple(anchors[0])
    assert (after.size, after.classes, after.layers[2].channels) == ((96, 128), 3, 24)
    written = (tmp_path / "after.cfg").read_text()
    assert "#filters=99" in written
    assert ";height=32" in written


@pytest.mark.data
@pytest.mark.parametrize(
    "name", ["yolov3", "yolov3-spp", "yolov3-tiny", "yolov3-voc", "yolov4", "yolov4-csp", "yolov4-tiny", "yolov4x-mish"]
)
def test_published_networks_can_be_rewritten(data_folder, tmp_path, name):
    text = (data_folder / "cfg" / f"{name}.cfg").read_text()
    anchors = other_anchors(read_cfg(data_folder / "cfg" / f"{name}.cfg"))
    before, after = rewritten(text, tmp_path, anchors=anchors, classes=5, size=(320, 416))
    before = read_cfg(tmp_path / "before.cfg", (320, 416))
    assert after.size == (320, 416)
    assert_changed(before, after, anchors, 5)


@pytest.mark.parametrize("name", TINY)
def test_weights_are_read_back(tmp_path, name):
    cfg, path = write_network(tmp_path, TINY[name], seed=4)
    config = read_cfg(cfg)
    weights, _ = read_weights(path, config)
    (tmp_path / "again.weights").write_bytes(weights_bytes(dict(reversed(weights.items()))))
    again, _ = read_weights(tmp_path / "again.weights", config)
    assert again.keys() == weights.keys()
    for index, one in weights.items():
        for field in ("kernel", "bias", "scale", "mean", "variance"):
            old, new = getattr(one, field), getattr(again[index], field)
            assert (old is None) == (new is None)
            assert old is None or np.array_equal(old, new)
    # the same file but for the header, which counts the pictures seen
    assert (tmp_path / "again.weights").read_bytes()[20:] == path.read_bytes()[20:]
