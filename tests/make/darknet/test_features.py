"""Which layers descriptors may read."""

from __future__ import annotations

import pytest

from darknet_files import TINY, conv, head, maxpool, net, route, section, shortcut, yolo
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.features import backbone_layers, scale_features


def _read(tmp_path, body, size=None):
    path = tmp_path / "some.cfg"
    path.write_text(body, encoding="utf-8")
    return read_cfg(path, size)


def _indices(config):
    return [(scale.output.index, scale.near.index, scale.early.index) for scale in scale_features(config)]


@pytest.mark.parametrize("size", [None, (32, 32), (96, 64)])
def test_each_scale_reads_a_layer_near_the_output_and_one_of_the_backbone(tmp_path, size):
    config = _read(tmp_path, TINY["two-scales"], size)
    assert _indices(config) == [(10, 8, 6), (17, 15, 4)]
    assert {stride: layer.index for stride, layer in backbone_layers(config).items()} == {4: 4, 8: 6}


def test_residual_sum_is_preferred_on_the_coarsest_grid(tmp_path):
    body = net() + conv(8, stride=2) + conv(12, stride=2) + conv(12) + shortcut(-2) + conv(30) + conv(8, 1)
    assert _indices(_read(tmp_path, body + head() + yolo())) == [(7, 5, 3)]


def test_dropout_is_passed_over(tmp_path):
    assert _indices(_read(tmp_path, TINY["dropout"])) == [(6, 3, 1)]


def test_channel_gate_is_no_coarse_grid(tmp_path):
    """The one-cell grid of an average pool is neither the end of the backbone nor a stride of its own."""
    config = _read(tmp_path, TINY["squeeze-excite"])
    assert list(backbone_layers(config)) == [4]
    assert _indices(config) == [(8, 6, 1)]


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        pytest.param(conv(8) + conv(8) + head() + yolo(), [(3, 1, 1)], id="stride-1"),
        pytest.param(conv(8, stride=2) + conv(8) + head() + yolo(), [(3, 1, 1)], id="stride-2"),
        pytest.param(section("dropout") + head() + yolo(), None, id="dropout-first"),
        pytest.param(
            conv(8) + maxpool(2, 2) + conv(8) + maxpool(2, 2) + conv(8) + route("0") + head() + yolo(),
            [(7, 5, 5)],
            id="output-beside-the-backbone",
        ),
    ],
)
def test_grid_without_backbone_layer_reads_the_near_layer_twice(tmp_path, body, expected):
    """Outputs on grids finer than 4 px used to end in a KeyError."""
    config = _read(tmp_path, net() + body)
    for scale in scale_features(config):
        assert (scale.near.height, scale.near.width) == (scale.early.height, scale.early.width)
        assert (scale.early.height, scale.early.width) == (scale.output.height, scale.output.width)
    assert expected is None or _indices(config) == expected


def test_layers_do_not_depend_on_the_size_down_to_one_cell(tmp_path):
    """A coarsest grid of one cell was taken for an average pool, and its stride was missing."""
    for body in TINY.values():
        config = _read(tmp_path, body)
        stride = config.largest_stride
        assert _indices(_read(tmp_path, body, (stride, stride))) == _indices(config)
        assert _indices(_read(tmp_path, body, (stride, 3 * stride))) == _indices(config)
