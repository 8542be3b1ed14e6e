"""Kind `paper`: what it reads, and that the network at a detection is the network on the whole map."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from lookonce.errors import ModelError
from lookonce.make.descriptors.paper import PaperHead, PaperKind
from lookonce.make.descriptors.paper_loss import PaperClassifier, paper_loss

THREE = ((8, 10), (14, 20), (30, 24))


@pytest.fixture(scope="module")
def metadata(describe):
    """Three grids: the second has one layer for both, fewer channels and other numbers of anchors."""
    return describe(
        [("a", 5, 32), ("b", 4, 32), ("c", 6, 16), ("d", 3, 8), ("e", 2, 8)],
        [(32, THREE, "a", "b"), (16, (*THREE, (3, 4), (5, 6)), "c", "c"), (8, THREE[:2], "d", "e")],
    )


def every_row(kind, batch=1):
    """A row of detections for every anchor of every cell of every grid of every picture, in shuffled order."""
    rows = [
        (image, scale, cell, anchor)
        for image in range(batch)
        for scale, grid in enumerate(kind.grids)
        for cell in range(grid.rows * grid.columns)
        for anchor in range(grid.anchors)
    ]
    table = np.random.default_rng(0).permutation(np.array(rows, np.int64))
    return {
        "image_index": table[:, 0].copy(),
        "boxes": np.zeros((len(table), 4), np.float32),
        "scores": np.ones(len(table), np.float32),
        "labels": np.zeros(len(table), np.int64),
        "scale": table[:, 1].copy(),
        "cell": table[:, 2].copy(),
        "anchor": table[:, 3].copy(),
    }


def no_rows(rows):
    return {name: values[:0] for name, values in rows.items()}


def as_tensors(reading):
    return [torch.from_numpy(reading[name]) for name in ("patch", "scale", "anchor")]


def maps_of(grid, maps):
    """The near and the early map of one grid, as tensors."""
    names = [feature.name for feature in grid.features]
    return torch.from_numpy(maps[names[0]]), torch.from_numpy(maps[names[-1]])


def test_layout_names_both_layers_of_each_grid(metadata):
    kind = PaperKind.of(metadata)
    assert kind.name == "paper"
    assert kind.layers == ("a", "b", "c", "d", "e")
    assert [[f.name for f in grid.features] for grid in kind.grids] == [["a", "b"], ["c"], ["d", "e"]]
    assert [(g.channels, g.anchors, g.rows, g.columns) for g in kind.grids] == [
        (9, 3, 2, 3),
        (6, 5, 4, 6),
        (5, 2, 8, 12),
    ]
    assert kind.channels == 9


def test_a_layer_that_two_grids_share_is_named_once(describe):
    kind = PaperKind.of(describe([("a", 4, 8)], [(8, THREE, "a", "a"), (8, THREE, "a", "a")]))
    assert kind.layers == ("a",)
    assert len(kind.grids) == 2


@pytest.mark.parametrize(
    "features",
    [
        pytest.param([], id="no-features"),
        pytest.param([("near", 4, 8)], id="one-missing"),
        pytest.param([("near", 4, 8), ("early", 4, 16)], id="other-grid"),
    ],
)
def test_layers_that_are_not_offered_are_named(describe, features):
    with pytest.raises(ModelError, match=r"lacks a layer of the 8 px grid \(near, early\)") as caught:
        PaperKind.of(describe(features, [(8, THREE, "near", "early")]))
    assert "\n" not in str(caught.value)


def test_patch_is_the_3_by_3_cells_around_the_detection(metadata, random_maps, run_reading):
    kind = PaperKind.of(metadata)
    maps, rows = random_maps(metadata, batch=2), every_row(kind, batch=2)
    reading = run_reading(kind, rows, maps)
    assert set(reading) == {"patch", "scale", "anchor"}
    expected = np.zeros((len(rows["cell"]), 9, kind.channels), np.float32)
    for number, (image, scale, cell) in enumerate(zip(rows["image_index"], rows["scale"], rows["cell"], strict=True)):
        grid = kind.grids[scale]
        joined = np.concatenate([maps[feature.name][image] for feature in grid.features])
        for position in range(9):
            row, column = cell // grid.columns + position // 3 - 1, cell % grid.columns + position % 3 - 1
            if 0 <= row < grid.rows and 0 <= column < grid.columns:
                expected[number, position, : grid.channels] = joined[:, row, column]
    np.testing.assert_array_equal(reading["patch"], expected)
    for name in ("scale", "anchor"):
        assert reading[name].dtype == np.int64
        np.testing.assert_array_equal(reading[name], rows[name])


def test_cells_of_other_pictures_and_infinite_neighbours_do_not_leak(metadata, random_maps, run_reading):
    """What is masked is not multiplied by 0: infinity would become NaN."""
    kind = PaperKind.of(metadata)
    maps = random_maps(metadata, batch=2)
    rows = {name: values[every_row(kind, 2)["image_index"] == 1] for name, values in every_row(kind, 2).items()}
    expected = run_reading(kind, rows, maps)["patch"]
    for values in maps.values():
        values[0] = np.inf
    np.testing.assert_array_equal(run_reading(kind, rows, maps)["patch"], expected)
    maps["d"][1, :, 0, 0] = np.inf
    is_far = (rows["scale"] != 2) | (rows["cell"] > 13)
    np.testing.assert_array_equal(run_reading(kind, rows, maps)["patch"][is_far], expected[is_far])


def test_no_detections_give_no_rows(metadata, random_maps, run_reading, run_head, random_head):
    kind = PaperKind.of(metadata)
    head, rows, maps = random_head(kind), no_rows(every_row(kind)), random_maps(metadata, batch=2)
    reading = run_reading(kind, rows, maps)
    assert reading["patch"].shape == (0, 9, 9)
    assert (reading["scale"].shape, reading["anchor"].shape) == ((0,), (0,))
    assert run_head(head, rows, maps).shape == (0, 128)
    assert head(*as_tensors(reading)).shape == (0, 128)


@torch.no_grad()
def test_rows_equal_whole_maps_everywhere(metadata, random_maps, run_reading, random_head):
    kind = PaperKind.of(metadata)
    head, maps, rows = random_head(kind), random_maps(metadata, batch=2), every_row(kind, batch=2)
    found = head(*as_tensors(run_reading(kind, rows, maps)))
    assert found.shape == (len(rows["cell"]), 128)
    for scale, grid in enumerate(kind.grids):
        whole = head.forward_map(scale, *maps_of(grid, maps))
        assert whole.shape == (2, 128, grid.anchors, grid.rows, grid.columns)
        own = rows["scale"] == scale
        image, anchor = rows["image_index"][own], rows["anchor"][own]
        row, column = np.divmod(rows["cell"][own], grid.columns)
        assert {0, grid.rows - 1} <= set(row)
        expected = whole[image, :, anchor, row, column]
        assert expected.std() > 0.05
        torch.testing.assert_close(found[own], expected, atol=1e-5, rtol=0)


@torch.no_grad()
def test_network_is_the_papers(metadata, random_maps, random_head):
    """Joined, three convolutions, a new axis before the channels repeated for the anchors, filters across that axis."""
    kind = PaperKind.of(metadata)
    head, grid = random_head(kind), kind.grids[0]
    near, early = maps_of(grid, random_maps(metadata))
    layers = head.grids[0]
    values = torch.cat([near, early], dim=1)
    for convolution, norm in zip(layers.convolutions, layers.norms, strict=True):
        values = norm(nn.functional.conv2d(values, convolution.weight, padding="same"))
        values = torch.where(values > 0, values, 0.1 * values)
    assert values.shape == (1, 128, 2, 3)
    values = torch.stack([torch.zeros_like(values), *[values] * 3, torch.zeros_like(values)])  # anchors -1 to 3
    kernel = layers.target.weight[:, :, :, 0, 0]
    for anchor in range(3):
        expected = layers.target.bias[:, None, None] + sum(
            torch.einsum("dc,bchw->bdhw", kernel[:, :, place], values[anchor + place]) for place in range(3)
        )
        found = head.forward_map(0, near, early)[:, :, anchor]
        torch.testing.assert_close(found, expected, atol=1e-5, rtol=0)


@torch.no_grad()
def test_graph_equals_pytorch(metadata, random_maps, run_reading, run_head, random_head):
    kind = PaperKind.of(metadata)
    head = random_head(kind)
    for grid in head.grids:
        grid.norms[0].running_var[:9] = 1e-5  # hardly any spread: what batch norm adds to it counts
    rows, maps = every_row(kind, batch=2), random_maps(metadata, batch=2)
    expected = nn.functional.normalize(head(*as_tensors(run_reading(kind, rows, maps)))).numpy()
    found = run_head(head, rows, maps)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("anchors", [1, 2, 3, 5])
@torch.no_grad()
def test_anchors_of_a_cell_differ_where_the_filters_see_an_end(
    describe, random_maps, run_reading, run_head, anchors, random_head
):
    """Each number of anchors has its own sums of slices; beyond three, the middle ones are equal."""
    metadata = describe([("a", 4, 8), ("b", 4, 8)], [(8, [(8, 8)] * anchors, "a", "b")], size=(8, 8))
    kind = PaperKind.of(metadata)
    head, maps, rows = random_head(kind), random_maps(metadata), every_row(kind)
    order = np.argsort(rows["anchor"])
    rows = {name: values[order] for name, values in rows.items()}
    expected = nn.functional.normalize(head(*as_tensors(run_reading(kind, rows, maps)))).numpy()
    np.testing.assert_allclose(run_head(head, rows, maps), expected, atol=1e-5)
    distances = np.linalg.norm(expected[:, None] - expected, axis=2)
    different = {1: 1, 2: 2, 3: 3, 5: 3}[anchors]
    assert len(np.unique(distances[0].round(4))) == different
    assert distances[0, 1:].min(initial=1) > 0.1
    if anchors == 5:
        np.testing.assert_allclose(distances[1:4, 1:4], 0, atol=1e-6)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_row_is_the_same_to_the_byte_whatever_is_beside_it(metadata, random_maps, run_head, threads, random_head):
    kind = PaperKind.of(metadata)
    head, rows, maps = random_head(kind), every_row(kind), random_maps(metadata)
    together = run_head(head, rows, maps, threads)
    for some in (slice(0, 1), slice(3, 5), slice(7, 40), slice(len(together) - 1, None)):
        alone = run_head(head, {name: values[some] for name, values in rows.items()}, maps, threads)
        assert alone.tobytes() == together[some].tobytes()


def test_training_on_rows_is_training_on_whole_maps(metadata, random_maps, run_reading, random_head):
    """Maps whose anchors are all empty but a few: the same loss and the same gradients as those few rows alone."""
    kind = PaperKind.of(metadata)
    head, classifier = random_head(kind), PaperClassifier(4)
    parameters = [*head.parameters(), *classifier.parameters()]
    maps, rows = random_maps(metadata, batch=2), every_row(kind, batch=2)
    chosen = np.concatenate([np.flatnonzero(rows["scale"] == scale)[:3] for scale in range(3)])
    rows = {name: values[chosen] for name, values in rows.items()}
    identity = torch.arange(len(chosen)) % 4
    found = classifier(head(*as_tensors(run_reading(kind, rows, maps))))
    loss = paper_loss(found, nn.functional.one_hot(identity, 4).float())
    gradients = torch.autograd.grad(loss, parameters)

    whole_loss = torch.zeros(())
    for scale, grid in enumerate(kind.grids):
        probabilities = classifier.forward_map(head.forward_map(scale, *maps_of(grid, maps)))
        assert probabilities.shape == (2, 4, grid.anchors, grid.rows, grid.columns)
        probabilities = probabilities.permute(0, 3, 4, 2, 1).reshape(
            -1, grid.anchors, 4
        )  # (cells, anchors, identities)
        labels = torch.zeros_like(probabilities)
        for number in np.flatnonzero(rows["scale"] == scale):
            cell = rows["image_index"][number] * grid.rows * grid.columns + rows["cell"][number]
            labels[cell, rows["anchor"][number], identity[number]] = 1
        whole_loss = whole_loss + paper_loss(probabilities, labels)
    torch.testing.assert_close(whole_loss, loss, rtol=1e-5, atol=1e-6)
    for whole, ours in zip(torch.autograd.grad(whole_loss, parameters), gradients, strict=True):
        torch.testing.assert_close(whole, ours, rtol=1e-4, atol=1e-6)


def test_loss_falls_on_8_identities(metadata):
    """Rows of one identity are found by any grid; its own pattern lies in all of them."""
    kind = PaperKind.of(metadata)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        head, classifier = PaperHead(kind).train(), PaperClassifier(8)
        pattern, identity = torch.randn(8, 9, kind.channels), torch.arange(64) % 8
        patch = pattern[identity] + 0.3 * torch.randn(64, 9, kind.channels)
        scale, anchor = torch.randint(3, (64,)), torch.randint(2, (64,))
    labels = nn.functional.one_hot(identity, 8).float()
    optimizer = torch.optim.Adam([*head.parameters(), *classifier.parameters()], lr=1e-2)
    losses = []
    for _ in range(30):
        loss = paper_loss(classifier(head(patch, scale, anchor)), labels)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.1 * losses[0]


def test_a_single_row_of_a_grid_can_be_trained_on(metadata):
    """Batch norm has no spread of one value and refuses it."""
    head = PaperHead(PaperKind.of(metadata)).train()
    patch = torch.ones(3, 9, head.channels)
    found = head(patch, torch.tensor([0, 1, 1]), torch.tensor([2, 0, 0]))
    found.sum().backward()
    assert torch.isfinite(found).all()


def test_weights_survive_saving(metadata, tmp_path, random_head):
    kind = PaperKind.of(metadata)
    head, other = random_head(kind), random_head(kind, seed=2)
    row = torch.ones(1, 9, kind.channels), torch.tensor([1]), torch.tensor([4])
    assert not torch.equal(head(*row), other(*row))
    torch.save(head.state_dict(), tmp_path / "head.pt")
    other.load_state_dict(torch.load(tmp_path / "head.pt", weights_only=True))
    assert torch.equal(head(*row), other(*row))
