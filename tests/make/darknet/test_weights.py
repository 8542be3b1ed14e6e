"""Weights files: the header's forms, the order of the numbers, and that not one byte may be missing or left over."""

from __future__ import annotations

import hashlib
import struct

import numpy as np
import pytest

from darknet_files import conv, head, net, yolo
from lookonce.errors import WeightsError
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.weights import read_weights

HEADERS = {
    "0.1": struct.pack("<iii", 0, 1, 0) + struct.pack("<I", 1234),
    "0.2": struct.pack("<iii", 0, 2, 0) + struct.pack("<Q", 1234),
    "0.2.5": struct.pack("<iii", 0, 2, 5) + struct.pack("<Q", 32_013_312),
    "1.0": struct.pack("<iii", 1, 0, 0) + struct.pack("<Q", 1),
}


@pytest.fixture
def config(tmp_path):
    """Convolutions of 2 filters with batch norm and groups, and 24 without: 2 * 4 + 2 * 3 + ... numbers."""
    path = tmp_path / "tiny.cfg"
    path.write_text(net() + conv(6) + conv(2, groups=2) + head() + yolo(), encoding="utf-8")
    return read_cfg(path)


def _floats(config) -> np.ndarray:
    return np.arange(config.parameter_count, dtype="<f4")


@pytest.mark.parametrize("header", HEADERS)
def test_numbers_come_as_bias_scale_mean_variance_kernel(tmp_path, config, header):
    path = tmp_path / "tiny.weights"
    path.write_bytes(HEADERS[header] + _floats(config).tobytes())
    weights, digest = read_weights(path, config)
    assert digest == hashlib.sha256(path.read_bytes()).hexdigest()
    assert list(weights) == [0, 1, 2]

    first = weights[0]
    for number, array in enumerate((first.bias, first.scale, first.mean, first.variance)):
        assert array is not None
        assert array.tolist() == list(range(6 * number, 6 * number + 6))
    assert first.kernel.shape == (6, 3, 3, 3)
    assert first.kernel.ravel().tolist() == list(range(24, 24 + 162))
    assert first.kernel[1, 2, 0, 1] == 24 + 27 + 2 * 9 + 1

    grouped, start = weights[1], 24 + 162
    assert grouped.bias.tolist() == [start, start + 1]
    assert grouped.variance is not None
    assert grouped.variance.tolist() == [start + 6, start + 7]
    assert grouped.kernel.shape == (2, 3, 3, 3)
    assert grouped.kernel.ravel().tolist() == list(range(start + 8, start + 8 + 54))

    last, start = weights[2], start + 8 + 54
    assert (last.scale, last.mean, last.variance) == (None, None, None)
    assert last.bias.tolist() == list(range(start, start + 24))
    assert last.kernel.shape == (24, 2, 1, 1)
    assert last.kernel.ravel().tolist() == list(range(start + 24, start + 72))
    assert config.parameter_count == start + 72
    assert all(array.dtype == np.float32 for array in (first.kernel, first.bias, last.bias))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        pytest.param(lambda raw: raw[:-1], "1 short", id="one-byte-short"),
        pytest.param(lambda raw: raw + b"\0", "1 too many", id="one-byte-long"),
        pytest.param(lambda raw: raw[:-4], "4 short", id="one-number-short"),
        pytest.param(lambda raw: raw + bytes(4), "4 too many", id="one-number-long"),
        pytest.param(lambda raw: raw + bytes(1 << 20), "1,048,576 too many", id="much-too-long"),
        pytest.param(lambda raw: b"", "0 bytes are too few", id="empty"),
        pytest.param(lambda raw: raw[:20], "short", id="header-only"),
        pytest.param(lambda raw: raw[:19], "19 bytes are too few", id="half-a-header"),
        pytest.param(lambda raw: b"[net]\nwidth=32\nheight=32\nchannels=3\n", "not Darknet's", id="text"),
        pytest.param(lambda raw: b"<!DOCTYPE html><html>Not found</html>", "not Darknet's", id="web-page"),
        pytest.param(lambda raw: struct.pack("<iii", -1, 2, 0) + raw[12:], "not Darknet's", id="negative-version"),
        pytest.param(lambda raw: struct.pack("<iii", 0, 1, 0) + raw[12:], "4 too many", id="header-of-other-length"),
        pytest.param(lambda raw: raw[:20] + struct.pack("<f", np.nan) + raw[24:], "NaN or infinity", id="nan"),
        pytest.param(lambda raw: raw[:-4] + struct.pack("<f", -np.inf), "NaN or infinity", id="infinity"),
    ],
)
def test_damaged_file_is_refused_by_name(tmp_path, config, damage, message):
    path = tmp_path / "damaged.weights"
    path.write_bytes(damage(HEADERS["0.2.5"] + _floats(config).tobytes()))
    with pytest.raises(WeightsError) as caught:
        read_weights(path, config)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder_are_named(tmp_path, config):
    with pytest.raises(WeightsError, match=r"nothing\.weights: cannot read the weights file \(No such file"):
        read_weights(tmp_path / "nothing.weights", config)
    with pytest.raises(WeightsError) as caught:
        read_weights(tmp_path, config)
    assert str(caught.value).startswith(f"{tmp_path}: ")


def test_weights_of_another_network_are_refused(tmp_path, config):
    other = tmp_path / "other.cfg"
    other.write_text(net() + conv(8) + conv(2, groups=2) + head() + yolo(), encoding="utf-8")
    path = tmp_path / "tiny.weights"
    path.write_bytes(HEADERS["0.2.5"] + _floats(config).tobytes())
    with pytest.raises(WeightsError, match="belongs to another network") as caught:
        read_weights(path, read_cfg(other))
    assert str(other) in str(caught.value)
