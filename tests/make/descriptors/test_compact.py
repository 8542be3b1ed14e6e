"""Kind `compact`: a grid of points over each box, read again in NumPy, and the network on top of it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from lookonce.make.descriptors.compact import CompactHead, CompactKind

ANCHORS = [(10, 14), (30, 24)]
ROWS, COLUMNS = 8, 4
BOXES = np.array(
    [
        [10.3, 5.7, 40.2, 50.9],
        [0, 0, 96, 64],
        [-20, -10, 30, 20],  # cut at the border
        [70, 40, 130, 90],
        [50, 30, 51, 31],  # smaller than a cell
        [95.5, 63.5, 96, 64],
        [20, 20, 20, 20],  # without area
    ],
    np.float32,
)


FEATURES = [("s4", 5, 4), ("s4 wide", 9, 4), ("s8", 6, 8), ("s16", 7, 16), ("s16 near", 3, 16)]
GRIDS = [(16, ANCHORS, "s16 near", "s16")]


@pytest.fixture(scope="module")
def metadata(describe):
    return describe(FEATURES, GRIDS)


@pytest.fixture(scope="module")
def street_metadata(describe):
    """Of a detector that knows people and others."""
    return describe(FEATURES, GRIDS, names=("car", "person", "bus"))


def _rows(boxes, image_index=None, labels=None):
    count = len(boxes)
    whole = np.zeros(count, np.int64)
    image_index = whole if image_index is None else np.asarray(image_index, np.int64)
    return {
        "image_index": image_index,
        "boxes": boxes,
        "scores": np.ones(count, np.float32),
        "labels": whole if labels is None else np.asarray(labels, np.int64),
        "scale": whole,
        "cell": whole,
        "anchor": whole,
    }


def _bilinear(plane, y, x):
    """The plane (C, h, w) between its cells' centres, held constant beyond the outermost ones."""
    height, width = plane.shape[1:]
    y, x = min(max(y, 0.0), height - 1.0), min(max(x, 0.0), width - 1.0)
    top, left = int(y), int(x)
    bottom, right = min(top + 1, height - 1), min(left + 1, width - 1)
    down, along = y - top, x - left
    above = plane[:, top, left] * (1 - along) + plane[:, top, right] * along
    below = plane[:, bottom, left] * (1 - along) + plane[:, bottom, right] * along
    return above * (1 - down) + below * down


def _roi_align(plane, box, stride, samples):
    """(points, C): the box cut into 8 x 4 parts; each the mean of samples x samples points in it."""
    left, top, right, bottom = np.float64(box) / stride - 0.5  # the centre of the first cell is 0
    height, width = (bottom - top) / ROWS, (right - left) / COLUMNS
    points = []
    for row in range(ROWS):
        for column in range(COLUMNS):
            read = [
                _bilinear(
                    plane,
                    top + (row + (i + 0.5) / samples) * height,
                    left + (column + (j + 0.5) / samples) * width,
                )
                for i in range(samples)
                for j in range(samples)
            ]
            points.append(np.mean(read, axis=0))
    return np.array(points)


@pytest.fixture
def points():
    return np.random.default_rng(2).normal(size=(40, 32, 18)).astype(np.float32)


def test_layout_is_the_narrowest_backbone_map_of_each_stride(metadata):
    kind = CompactKind.of(metadata)
    assert (kind.name, kind.layers, kind.channels) == ("compact", ("s4", "s8", "s16"), (5, 6, 7))
    assert kind.size == (64, 96)


def _many_boxes(count=40):
    """Boxes of every size and place in the picture of 96 x 64, some beyond its border."""
    rng = np.random.default_rng(5)
    corner, extent = rng.uniform((-10, -10), (90, 60), (count, 2)), rng.uniform(1, 70, (count, 2))
    return np.concatenate([corner, corner + extent], axis=1).astype(np.float32)


def _graph_and_pytorch(kind, head, rows, maps, run_reading, run_head):
    """Descriptors by the graph that goes into the model file, and by the module on what training sees."""
    reading = {name: torch.from_numpy(values) for name, values in run_reading(kind, rows, maps).items()}
    return run_head(head, rows, maps), head(**reading).numpy()


@torch.no_grad()
@pytest.mark.parametrize(
    ("features", "outputs", "expected"),
    [
        pytest.param([("near", 4, 32)], [(32, "near", "near")], ("near",), id="only-near-layers"),
        pytest.param(
            [("n32", 9, 32), ("n16", 4, 16)], [(32, "n32", "n32"), (16, "n16", "n16")], ("n16",), id="two-near-layers"
        ),
        pytest.param(
            [("n", 4, 16), ("b16", 8, 16), ("b32", 9, 32)], [(16, "n", "b16"), (32, "n", "b32")], ("b16",), id="coarse"
        ),
        pytest.param(
            [("near", 4, 32), ("b32", 8, 32), ("b64", 9, 64)],
            [(32, "near", "b32")],
            ("b32", "b64"),
            id="no-known-stride",
        ),
        pytest.param(
            [("l3", 32, 4), ("l5", 64, 8), ("l8", 256, 16), ("l12", 1024, 32), ("l14", 512, 32), ("l21", 256, 16)],
            [(32, "l14", "l12"), (16, "l21", "l8")],
            ("l3", "l5", "l8"),
            id="yolov3-tiny",
        ),
    ],
)
def test_layout_where_few_layers_are_offered(
    describe, random_maps, run_reading, run_head, features, outputs, expected, random_head
):
    metadata = describe(features, [(stride, ANCHORS, near, early) for stride, near, early in outputs], (64, 128))
    kind = CompactKind.of(metadata)
    assert kind.layers == expected
    rows, maps = _rows(BOXES[:2]), random_maps(metadata)
    assert run_reading(kind, rows, maps)["points"].shape == (2, 32, sum(kind.channels))
    found, by_pytorch = _graph_and_pytorch(kind, random_head(kind), rows, maps, run_reading, run_head)
    assert found.shape == (2, 128)
    np.testing.assert_allclose(found, by_pytorch, atol=1e-5)


def test_reading_is_roi_align(metadata, random_maps, run_reading):
    """The finest map has 2 x 2 samples a point, the others one."""
    kind = CompactKind.of(metadata)
    maps = random_maps(metadata, batch=3)
    image_index = np.arange(len(BOXES)) % 3
    found = run_reading(kind, _rows(BOXES, image_index), maps)["points"]
    assert found.shape == (len(BOXES), ROWS * COLUMNS, 18)
    cut = np.clip(BOXES, 0, [96, 64, 96, 64])
    for row, (image, box) in enumerate(zip(image_index, cut, strict=True)):
        expected = [
            _roi_align(np.float64(maps[feature.name][image]), box, feature.stride_px, samples)
            for feature, samples in zip(kind.features, (2, 1, 1), strict=True)
        ]
        np.testing.assert_allclose(found[row], np.concatenate(expected, axis=1), atol=1e-5)


def test_no_detections_give_no_rows(metadata, random_maps, run_reading, run_head, random_head):
    kind, rows, maps = CompactKind.of(metadata), _rows(BOXES[:0]), random_maps(metadata, batch=2)
    reading = run_reading(kind, rows, maps)
    assert reading["points"].shape == (0, 32, 18)
    assert run_head(random_head(kind), rows, maps).shape == (0, 128)
    read = {name: torch.from_numpy(values) for name, values in reading.items()}
    assert random_head(kind)(**read).shape == (0, 128)


@torch.no_grad()
def test_graph_equals_pytorch(metadata, random_maps, run_reading, run_head, random_head):
    """Whatever is computed on whole maps before it is read: the numbers are those of the reading behind training."""
    kind = CompactKind.of(metadata)
    boxes = np.concatenate([BOXES, _many_boxes()])
    rows = _rows(boxes, np.arange(len(boxes)) % 3)
    found, expected = _graph_and_pytorch(
        kind, random_head(kind), rows, random_maps(metadata, batch=3), run_reading, run_head
    )
    np.testing.assert_allclose(found, expected, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-6)
    assert np.linalg.norm(found[:, None] - found, axis=2)[~np.eye(len(found), dtype=bool)].min() > 1e-3


@pytest.mark.parametrize(
    ("names", "groups"),
    [
        pytest.param(("person", "bus", "car"), (1, 0, 0), id="both"),
        pytest.param(("car", "Person", "bicycle", "motorbike"), (0, 1, 1, 1), id="riders-are-people"),
        pytest.param(("bicycle", "car"), (0, 0), id="riders-without-people"),
        pytest.param(("person", "bicycle"), (0, 0), id="nothing-else"),
        pytest.param(("Pedestrian", "PEOPLE", "car"), (1, 1, 0), id="any-letters"),
        pytest.param(("car", "bus"), (0, 0), id="no-people"),
        pytest.param(("person", "people"), (0, 0), id="only-people"),
    ],
)
def test_people_have_a_network_of_their_own_beside_others(describe, names, groups, random_head):
    kind = CompactKind.of(describe(FEATURES, GRIDS, names=names))
    assert kind.groups == groups
    assert len(random_head(kind).networks) == 1 + max(groups)


@torch.no_grad()
@pytest.mark.parametrize(
    "labels",
    [
        pytest.param(np.arange(40) * 7 % 3, id="mixed"),
        pytest.param(np.full(40, 1), id="people-only"),
        pytest.param(np.full(40, 2), id="no-people"),
    ],
)
def test_each_row_is_read_by_the_network_of_its_class(
    street_metadata, random_maps, run_reading, run_head, random_head, labels
):
    kind = CompactKind.of(street_metadata)
    head, maps = random_head(kind), random_maps(street_metadata, batch=3)
    rows = _rows(_many_boxes(), np.arange(40) % 3, labels)
    found, by_pytorch = _graph_and_pytorch(kind, head, rows, maps, run_reading, run_head)
    np.testing.assert_allclose(found, by_pytorch, atol=1e-5)
    points = torch.from_numpy(run_reading(kind, rows, maps)["points"])
    others, people = (head.describe_by(number, points).numpy() for number in (0, 1))
    np.testing.assert_allclose(found, np.where((labels == 1)[:, None], people, others), atol=1e-5)
    assert np.linalg.norm(people - others, axis=1).min() > 0.1


@torch.no_grad()
@pytest.mark.parametrize(("embedding", "gate"), [(4, 5), (96, 32)])
def test_an_embedding_and_a_gate_of_any_width_are_written_as_they_were_trained(
    street_metadata, random_maps, run_reading, run_head, random_head, embedding, gate
):
    kind = CompactKind.of(street_metadata)
    head = random_head(kind, embedding=embedding, gate=gate)
    assert [network.project.in_features for network in head.networks] == [8 * embedding] * 2
    rows = _rows(_many_boxes(), labels=np.arange(40) % 2)
    found, by_pytorch = _graph_and_pytorch(kind, head, rows, random_maps(street_metadata), run_reading, run_head)
    np.testing.assert_allclose(found, by_pytorch, atol=1e-5)


@pytest.mark.parametrize("label", [0, 1])
def test_no_detections_of_two_networks_give_no_rows(street_metadata, random_maps, run_head, random_head, label):
    """Of neither, then of one of them."""
    head, maps = random_head(CompactKind.of(street_metadata)), random_maps(street_metadata)
    assert run_head(head, _rows(BOXES[:0]), maps).shape == (0, 128)
    assert run_head(head, _rows(BOXES[:1], labels=[label]), maps).shape == (1, 128)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("labels", [np.zeros(40), np.arange(40) % 2], ids=["one-network", "two-networks"])
def test_a_row_is_the_same_to_the_byte_whatever_is_beside_it(
    street_metadata, random_maps, run_head, threads, random_head, labels
):
    head, maps = random_head(CompactKind.of(street_metadata)), random_maps(street_metadata)
    rows = _rows(_many_boxes(), labels=labels)
    together = run_head(head, rows, maps, threads)
    for some in (slice(0, 1), slice(3, 5), slice(7, 30), slice(39, 40)):
        alone = run_head(head, {name: values[some] for name, values in rows.items()}, maps, threads)
        assert alone.tobytes() == together[some].tobytes()


def test_reading_of_a_picture_is_the_same_to_the_byte_in_a_batch(metadata, random_maps, run_reading):
    kind, maps = CompactKind.of(metadata), random_maps(metadata, batch=3)
    image_index = np.repeat([0, 1, 2], [1, 4, 2])
    together = run_reading(kind, _rows(BOXES, image_index), maps)["points"]
    for image in range(3):
        one = {name: values[image : image + 1] for name, values in maps.items()}
        alone = run_reading(kind, _rows(BOXES[image_index == image]), one)["points"]
        assert alone.tobytes() == together[image_index == image].tobytes()


@torch.no_grad()
def test_channels_that_never_change_are_harmless(metadata, points):
    kind = CompactKind.of(metadata)
    head = CompactHead(kind, np.zeros(18, np.float32), np.zeros(18, np.float32), 48, 16)
    assert torch.isfinite(head(torch.from_numpy(points), torch.zeros(len(points), dtype=torch.int64))).all()


def test_loss_falls_on_8_identities(metadata, random_head):
    """Supervised contrastive loss (Khosla et al. 2020, equation 2): near to all others of one's identity."""
    generator = torch.Generator().manual_seed(0)
    identity = torch.arange(64) % 8
    points = torch.randn(8, 32, 18, generator=generator)[identity]
    points = points + torch.randn(points.shape, generator=generator)
    head = random_head(CompactKind.of(metadata)).train()
    torch.manual_seed(0)  # of the points that training hides: with another seed each run the loss was 2.14 once
    optimizer = torch.optim.Adam(head.parameters(), lr=1e-2)
    is_self = torch.eye(64, dtype=torch.bool)
    is_same = (identity[:, None] == identity) & ~is_self
    losses = []
    for _ in range(40):
        descriptors = head.describe_by(0, points)
        similarity = (descriptors @ descriptors.T / 0.1).masked_fill(is_self, -torch.inf)
        loss = -similarity.log_softmax(dim=1)[is_same].mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.7 * losses[0]
    assert losses[-1] < 2.1  # log 7 = 1.95 is the least that can be reached
