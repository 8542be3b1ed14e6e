"""Cfg files as networks: shapes, strictness, the official files, and damage of every kind."""

from __future__ import annotations

import random
import re
import time

import pytest

from darknet_files import TINY, conv, head, maxpool, net, region, route, section, shortcut, upsample, yolo
from lookonce.errors import ConfigError, FormatError, LookonceError
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.features import scale_features
from lookonce.make.darknet.layers import Convolutional, MaxPool, Region, Route, Yolo

HERE = "  # <- here"
END = head() + yolo()


def _read(tmp_path, body, size=None):
    path = tmp_path / "some.cfg"
    path.write_text(body, encoding="utf-8")
    return read_cfg(path, size)


@pytest.mark.parametrize(
    ("layers", "shape"),
    [
        pytest.param(conv(6), (6, 64, 96), id="convolution"),
        pytest.param(conv(6, stride=2), (6, 32, 48), id="convolution-stride"),
        pytest.param(conv(6, 5, pad=0), (6, 60, 92), id="convolution-without-padding"),
        pytest.param(conv(6, 5, pad=0, padding=1), (6, 62, 94), id="convolution-padding"),
        pytest.param(conv(6, 7, 2), (6, 32, 48), id="convolution-size-7"),
        pytest.param(conv(12, groups=4), (12, 64, 96), id="convolution-groups"),
        pytest.param(maxpool(2, 2), (8, 32, 48), id="maxpool"),
        pytest.param(maxpool(2, 1), (8, 64, 96), id="maxpool-stride-1"),
        pytest.param(maxpool(9, 1), (8, 64, 96), id="maxpool-spp"),
        pytest.param(maxpool(3, 2), (8, 32, 48), id="maxpool-size-3"),
        pytest.param(section("maxpool", stride=2), (8, 32, 48), id="maxpool-size-is-stride"),
        pytest.param(section("maxpool", size=3, stride=2, padding=0), (8, 31, 47), id="maxpool-no-padding"),
        pytest.param(section("avgpool"), (8, 1, 1), id="avgpool"),
        pytest.param(conv(4) + route("-1,0"), (12, 64, 96), id="route"),
        pytest.param(route("0", groups=2, group_id=1), (4, 64, 96), id="route-group"),
        pytest.param(conv(8) + shortcut(-2), (8, 64, 96), id="shortcut"),
        pytest.param(upsample(), (8, 128, 192), id="upsample"),
        pytest.param(section("reorg", stride=2), (32, 32, 48), id="reorg"),
        pytest.param(section("dropout", probability=0.5), (8, 64, 96), id="dropout"),
        pytest.param(section("avgpool") + section("scale_channels", from_=0), (8, 64, 96), id="scale-channels"),
    ],
)
def test_layer_has_its_shape(tmp_path, layers, shape):
    """The layer follows a convolution of 8 x 64 x 96; the output reads that convolution, whatever the layer does."""
    config = _read(tmp_path, net(64, 96) + conv(8) + layers + route("0") + END)
    layer = config.layers[layers.count("[")]
    assert (layer.channels, layer.height, layer.width) == shape


def test_values_of_layers_are_read(tmp_path):
    body = net() + conv(8, 5, 2, activation="mish", pad=0, padding=1, groups=1, batch_normalize=0)
    body += maxpool(3, 2) + conv(16) + route("-1,2", groups=4, group_id=3) + conv(18, 1, activation="linear")
    body += section("yolo", mask="2,0", anchors="1,2, 3,4, 5.5,6,", classes=4, num=3, scale_x_y=1.05)
    config = _read(tmp_path, body)
    specs = [layer.spec for layer in config.layers]
    assert specs[0] == Convolutional(8, 5, 2, 1, 1, False, "mish")
    assert specs[1] == MaxPool(3, 2, 2)
    assert specs[3] == Route((2, 2), 4, 3)
    assert specs[5] == Yolo(4, ((5.5, 6.0), (1.0, 2.0)), 1.05, False)
    assert (config.classes, config.size, config.largest_stride) == (4, (64, 64), 64 // config.layers[1].height)
    assert config.outputs == (config.layers[5],)


def test_region_is_read(tmp_path):
    config = _read(tmp_path, TINY["region-reorg"])
    assert config.output_spec(config.outputs[0]) == Region(3, ((1.0, 1.2), (2.1, 3.0), (3.5, 1.9)))


def test_parameters_are_counted_by_hand(tmp_path):
    body = net() + conv(8, stride=2) + conv(8, groups=8) + head(classes=3) + yolo()
    first, depthwise, last = 8 * 3 * 9 + 4 * 8, 8 * 1 * 9 + 4 * 8, 24 * 8 + 24
    assert _read(tmp_path, body).parameter_count == first + depthwise + last


WRONG = [
    pytest.param(
        net() + conv(8) + f"[convolutional]\nfliters=8{HERE}\n" + END, "did you mean filters?", id="wrong-key"
    ),
    pytest.param(net() + f"[convolutional]\nfilters=8\nxyzzy=1{HERE}\n" + END, "unknown key 'xyzzy'", id="strange-key"),
    pytest.param(net() + f"[conv]\nfilters=8\nfilters=8{HERE}\n" + END, "'filters' is given twice", id="key-twice"),
    pytest.param(f"width=32{HERE}\n" + net() + END, "before the first [section]", id="key-before-section"),
    pytest.param(f"[convolutional]{HERE}\n" + END, "expected [net]", id="no-net"),
    pytest.param("[net]\nwidth=64\nheight=64\nchannels=1" + HERE + "\n" + END, "RGB networks", id="grey-network"),
    pytest.param("[net]" + HERE + "\nwidth=64\n" + END, "needs the key 'height'", id="no-height"),
    pytest.param("[net]\nheight=64\nwidth=100000" + HERE + "\n" + END, "expected 32 to 4096", id="huge-picture"),
    pytest.param(net() + conv(8) + f"[route]\nlayers=5{HERE}\n" + END, "not before layer 1", id="forward-route"),
    pytest.param(net() + conv(8) + f"[route]\nlayers=1{HERE}\n" + END, "not before layer 1", id="route-to-itself"),
    pytest.param(net() + conv(8) + f"[route]\nlayers=-2{HERE}\n" + END, "points to layer -1", id="route-before-start"),
    pytest.param(net() + conv(8) + f"[route]{HERE}\n" + END, "needs the key 'layers'", id="route-to-nothing"),
    pytest.param(
        net() + conv(8) + conv(8, stride=2) + f"[route]\nlayers=0,1{HERE}\n" + END, "different grids", id="route-grids"
    ),
    pytest.param(
        net() + conv(9) + f"[route]{HERE}\nlayers=-1\ngroups=2\n" + END, "does not divide the 9", id="route-groups"
    ),
    pytest.param(
        net() + conv(8) + f"[route]\nlayers=-1\ngroups=2\ngroup_id=2{HERE}\n" + END, "expected 0 to 1", id="group-id"
    ),
    pytest.param(
        net() + conv(8) + conv(9) + f"[shortcut]\nfrom=-2{HERE}\n" + END, "another shape", id="shortcut-of-other-shape"
    ),
    pytest.param(net() + f"[shortcut]\nfrom=-1{HERE}\n" + END, "points to layer -1", id="shortcut-first"),
    pytest.param(
        net() + conv(8) + f"[shortcut]\nfrom=-1\nactivation=tanhh{HERE}\n" + END, "expected one of", id="activation"
    ),
    pytest.param(
        net() + conv(8) + section("avgpool") + f"[scale_channels]\nfrom=0\nscale_wh=1{HERE}\n" + END,
        "not supported",
        id="scale-wh",
    ),
    pytest.param(
        net() + conv(8) + conv(9) + section("avgpool") + f"[scale_channels]{HERE}\nfrom=0\n" + END,
        "expected 8 x 1 x 1",
        id="scale-other-channels",
    ),
    pytest.param(net() + f"[conv]\nfilters=999999999{HERE}\n" + END, "expected 1 to 16384", id="huge-filter-count"),
    pytest.param(net(4096, 4096) + f"[conv]{HERE}\nfilters=16384\n" + END, "beyond the limit", id="huge-output"),
    pytest.param(
        net() + conv(8) + section("upsample", stride=16) + f"[upsample]{HERE}\nstride=16\n" + END,
        "beyond the limit",
        id="huge-upsampling",
    ),
    pytest.param(net() + f"[conv]\nfilters=-8{HERE}\n" + END, "expected 1 to 16384", id="negative-filters"),
    pytest.param(
        net() + conv(8) + f"[conv]{HERE}\nfilters=9\ngroups=3\n" + END, "groups=3 must divide 8", id="groups-of-input"
    ),
    pytest.param(
        net() + conv(9) + f"[conv]{HERE}\nfilters=8\ngroups=3\n" + END, "and 8 filters", id="groups-of-filters"
    ),
    pytest.param(net() + f"[conv]{HERE}\nsize=63\nstride=2\n" * 2 + END, "no cell of the grid", id="nothing-left"),
    pytest.param(net() + conv(8) + f"[reorg]{HERE}\nstride=3\n" + END, "stride=3 does not divide", id="reorg-stride"),
    pytest.param(net() + f"[local]{HERE}\n" + END, "not a layer that lookonce supports", id="unknown-layer"),
    pytest.param(net() + f"[]{HERE}\n" + END, "not a layer", id="nameless-layer"),
    pytest.param(net() + head() + f"[yolo]{HERE}\nclasses=4\nnum=1\nanchors=1,2\n", "needs 9 channels", id="channels"),
    pytest.param(net() + f"[yolo]{HERE}\nclasses=1\nnum=1\nanchors=1,2\n", "needs 6 channels", id="only-yolo"),
    pytest.param(
        net() + head() + f"[yolo]\nclasses=3\nnum=3\nanchors=1,2,3,4,5{HERE}\nmask=0\n",
        "expected 6 numbers for num=3, got 5",
        id="anchor-count",
    ),
    pytest.param(
        net() + head() + f"[yolo]\nclasses=3\nnum=3\nanchors=1,2,3,4,5,6\nmask=0,1,3{HERE}\n",
        "mask=3: expected 0 to 2",
        id="mask-out-of-range",
    ),
    pytest.param(
        net() + conv(24, 1) + section("dropout") + f"[yolo]{HERE}\nclasses=3\nnum=3\n" + "anchors=1,2,3,4,5,6\n",
        "expected a [convolutional] before",
        id="no-convolution-before",
    ),
    pytest.param(
        net() + conv(8) + head() + yolo().replace("[yolo]", f"[yolo]{HERE}").strip() + "\nnew_coords=1\n",
        "go together",
        id="new-coords-without-logistic",
    ),
    pytest.param(
        net() + conv(8) + head(activation="logistic") + yolo().replace("[yolo]", f"[yolo]{HERE}"),
        "go together",
        id="logistic-without-new-coords",
    ),
    pytest.param(
        net() + conv(8) + head() + region().replace("softmax=1", f"softmax=0{HERE}"), "softmax=1", id="region-logistic"
    ),
    pytest.param(
        net() + conv(8) + head() + region().replace("coords=4", f"coords=5{HERE}"), "coords=4", id="region-coords"
    ),
    pytest.param(
        net() + conv(8) + END + route("0") + head() + region().replace("[region]", f"[region]{HERE}"),
        "of one kind",
        id="two-kinds",
    ),
    pytest.param(
        net() + head() + yolo().replace("[yolo]", f"[yolo]{HERE}"), "two layers of the same grid", id="one-layer"
    ),
    pytest.param(
        net() + conv(8) + head().replace("stride=1", "stride=2") + yolo().replace("[yolo]", f"[yolo]{HERE}"),
        "two layers of the same grid",
        id="stride-in-the-last-convolution",
    ),
    pytest.param(
        net() + conv(8) + END + f"[convolutional]{HERE}\nfilters=8\n" + END, "reads an output layer", id="reads-yolo"
    ),
    pytest.param(net() + conv(8) + END + f"[route]{HERE}\nlayers=0,-1\n" + END, "reads an output", id="route-to-yolo"),
    pytest.param(
        net() + conv(8) + END + f"[shortcut]{HERE}\nfrom=1\n" + END, "reads an output layer", id="shortcut-on-yolo"
    ),
    pytest.param(net() + conv(8), "no [yolo] or [region] layer", id="no-output"),
    pytest.param(net(), "no [yolo] or [region] layer", id="only-net"),
    pytest.param(net(33, 64) + conv(8, stride=2) + conv(8, stride=2) + END, "not a multiple", id="own-size"),
    pytest.param(
        net() + (conv(16_384, 1, 16) + conv(16_384, 1)) * 2 + conv(8, 1) + END, "parameters", id="too-many-parameters"
    ),
]


@pytest.mark.parametrize(("body", "message"), WRONG)
def test_wrong_network_is_refused_with_path_and_line(tmp_path, body, message):
    """The line is the one that carries the mark; without a mark the fault has no line of its own."""
    with pytest.raises(FormatError) as caught:
        _read(tmp_path, body)
    text = str(caught.value)
    marked = [number for number, line in enumerate(body.splitlines(), start=1) if line.endswith(HERE)]
    path = tmp_path / "some.cfg"
    if marked and caught.value.line not in marked:
        pytest.fail(f"names line {caught.value.line} instead of {marked}: {text}")
    assert text.startswith(f"{path}:{caught.value.line}: " if marked else f"{path}: ")
    assert message in text
    assert "\n" not in text


@pytest.mark.parametrize(
    "size",
    [(60, 64), (64, 60), (0, 64), (-64, 64), (8192, 64), (64, 33)],
    ids=lambda size: f"{size[0]}x{size[1]}",
)
def test_unsuitable_size_is_a_config_error(tmp_path, size):
    with pytest.raises(ConfigError, match="multiple of 8 px"):
        _read(tmp_path, TINY["two-scales"], size)


def test_another_size_changes_grids_and_keeps_parameters(tmp_path):
    own, other = _read(tmp_path, TINY["two-scales"]), _read(tmp_path, TINY["two-scales"], (96, 32))
    assert other.size == (96, 32)
    assert [(o.height, o.width) for o in own.outputs] == [(8, 12), (16, 24)]
    assert [(o.height, o.width) for o in other.outputs] == [(12, 4), (24, 8)]
    assert own.parameter_count == other.parameter_count


OFFICIAL = {
    "cfg/yolov2-tiny.cfg": (None, None),
    "cfg/yolov2.cfg": (50_983_561, None),
    "cfg/yolov3-spp.cfg": (None, None),
    "cfg/yolov3-tiny.cfg": (8_858_734, ((14, 12), (21, 8))),
    "cfg/yolov3-voc.cfg": (None, ((80, 74), (92, 61), (104, 36))),
    "cfg/yolov3.cfg": (62_001_757, ((80, 74), (92, 61), (104, 36))),
    "cfg/yolov4-csp.cfg": (None, None),
    "cfg/yolov4-tiny.cfg": (None, None),
    "cfg/yolov4.cfg": (None, None),
    "cfg/yolov4x-mish.cfg": (None, None),
    "weights/MobileNetV2-YOLOv3-Nano-coco.cfg": (891_070, None),
    "weights/yolo-fastest-1.1-xl.cfg": (923_486, ((119, 108), (128, 81))),
    "weights/yolo-fastest-1.1.cfg": (346_062, None),
}


@pytest.mark.data
@pytest.mark.parametrize("name", OFFICIAL)
def test_official_network_is_read(data_folder, name):
    parameters, features = OFFICIAL[name]
    config = read_cfg(data_folder / name)
    assert config.classes == (20 if "voc" in name else 80)
    if parameters is not None:
        assert config.parameter_count == parameters
    scales = scale_features(config)
    if features is not None:
        assert tuple((s.near.index, s.early.index) for s in scales) == features
    for scale in scales:
        grids = {(layer.height, layer.width) for layer in (scale.output, scale.near, scale.early)}
        assert len(grids) == 1
        assert scale.early.index < scale.near.index < scale.output.index


def _mutate(text: bytes, rng: random.Random) -> bytes:
    lines = text.split(b"\n")
    for _ in range(rng.randint(1, 3)):
        row = rng.randrange(len(lines))
        match rng.randrange(6):
            case 0:
                raw = bytearray(lines[row] or b"x")
                raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
                lines[row] = bytes(raw)
            case 1 if len(lines) > 1:
                del lines[row]
            case 2:
                lines.insert(row, lines[rng.randrange(len(lines))])
            case 3:
                number = rng.choice(
                    [b"0", b"-1", b"-7", b"99999999999999999999", b"1e308", b"-2147483649", b"nan", b"3"]
                )
                lines[row] = re.sub(rb"\d+", number, lines[row], count=1)
            case 4:
                lines[row] = lines[row][: rng.randrange(len(lines[row]) + 1)]
            case _:
                other = rng.randrange(len(lines))
                lines[row], lines[other] = lines[other], lines[row]
    return b"\n".join(lines)


@pytest.mark.parametrize("name", ["two-scales", "region-reorg", "squeeze-excite", "route-groups"])
def test_damaged_cfg_raises_nothing_but_our_errors(tmp_path, name):
    """300 mutants of each network: either a readable network with usable features, or one line of explanation."""
    rng = random.Random(name)
    path = tmp_path / "damaged.cfg"
    messages = []
    start = time.monotonic()
    for _ in range(300):
        path.write_bytes(_mutate(TINY[name].encode(), rng))
        try:
            config = read_cfg(path)
            scale_features(config)
        except LookonceError as error:
            messages.append(str(error))
    assert 30 < len(messages) < 300
    assert [text for text in messages if str(path) not in text or "\n" in text] == []
    assert time.monotonic() - start < 10
