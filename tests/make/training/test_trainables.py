"""Which rows teach which network of a head of kind `compact`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from lookonce.make.descriptors.compact import CompactKind
from lookonce.make.training.config import FitConfig
from lookonce.make.training.trainables import settled, trainable_for
from lookonce.model.metadata import Feature
from make.training.scenes import make_readings

BOTH = CompactKind((Feature("a", 3, 4), Feature("b", 2, 8)), (64, 64), (0, 1))


def _readings(kind: str):
    """Twelve identities of a source of some kind; every second one is of the second network's class."""
    readings = make_readings(12, points=32)
    group = readings.identity % 2
    return replace(readings, kinds=(kind,), values={**readings.values, "group": group})


def _taught(kind: str, groups: tuple[int, ...]) -> list[bool]:
    """Which networks get a gradient from a batch of rows of some groups."""
    readings = _readings(kind)
    head = trainable_for(BOTH, readings, FitConfig())
    rows = np.flatnonzero(np.isin(readings.values["group"], groups))
    head.loss({name: torch.from_numpy(values[rows]) for name, values in readings.values.items()}, rows).backward()
    return [network.embedding.weight.grad is not None for network in head.module.networks]


@pytest.mark.parametrize("kind", ["sequences", "rendered people"])
def test_sources_of_one_class_teach_its_network_alone(kind):
    assert _taught(kind, (0,)) == [True, False]
    assert _taught(kind, (1,)) == [False, True]
    assert _taught(kind, (0, 1)) == [True, True]


@pytest.mark.parametrize("kind", ["stills", "clips"])
@pytest.mark.parametrize("group", [0, 1])
def test_sources_of_any_class_teach_both(kind, group):
    assert _taught(kind, (group,)) == [True, True]


def test_the_loss_is_the_sum_over_the_networks():
    readings = _readings("sequences")
    head = trainable_for(BOTH, readings, FitConfig())
    head.module.eval()  # hides no points

    def loss(rows):
        return head.loss({name: torch.from_numpy(values[rows]) for name, values in readings.values.items()}, rows)

    group = readings.values["group"]
    apart = [loss(np.flatnonzero(group == number)) for number in (0, 1)]
    torch.testing.assert_close(loss(np.arange(len(readings))), sum(apart))


@pytest.mark.parametrize(
    ("kind", "weight", "is_held"),
    [("stills", 0.5, True), ("clips", 0.5, True), ("sequences", 0.5, False), ("stills", 0, False)],
)
def test_sources_of_any_class_hold_the_spaces_of_the_networks_together(kind, weight, is_held):
    readings = _readings(kind)
    values, rows = {n: torch.from_numpy(v) for n, v in readings.values.items()}, np.arange(len(readings))
    head = trainable_for(BOTH, readings, FitConfig(shared_space=weight))
    head.module.eval()  # hides no points
    one, other = head.module.networks
    other.load_state_dict(one.state_dict())
    together = head.loss(values, rows).item()
    with torch.no_grad():
        other.project.weight.neg_()
        other.project.bias.neg_()  # the opposite descriptors: by itself the network is as good as before
    apart = head.loss(values, rows).item()
    assert apart > together + 0.5 if is_held else apart == pytest.approx(together, rel=1e-5)


def test_the_widths_of_embedding_and_gate_are_settings():
    head = trainable_for(BOTH, _readings("stills"), FitConfig(embedding=7, gate=5))
    assert [network.embedding.out_features for network in head.module.networks] == [7, 7]
    assert [network.gate[0].out_features for network in head.module.networks] == [5, 5]


def test_rows_are_described_by_the_network_of_their_class():
    readings = _readings("stills")
    head = trainable_for(BOTH, readings, FitConfig())
    head.module.eval()
    values = {name: torch.from_numpy(array) for name, array in readings.values.items()}
    each = [head.module.describe_by(number, values["points"]) for number in (0, 1)]
    torch.testing.assert_close(head.describe(values), torch.where(values["group"][:, None] == 1, each[1], each[0]))


def test_an_identity_is_of_the_class_that_most_of_its_rows_are_seen_as():
    readings = make_readings(4, rows=5, points=32, sources=2)  # identities 0 and 2 of the first source
    seen = np.array([[0, 0, 0, 1, 1], [1, 0, 1, 0, 0], [1, 1, 1, 0, 0], [0, 0, 0, 0, 0]])
    readings = replace(readings, kinds=("stills", "rendered people"), values={**readings.values, "group": seen.ravel()})
    found = settled(BOTH, readings)
    assert found.values["group"].reshape(4, 5).tolist() == [[0] * 5, [1] * 5, [1] * 5, [1] * 5]
    assert found.values["points"] is readings.values["points"]
    only_people = replace(BOTH, groups=(0,))
    none = replace(readings, values={**readings.values, "group": np.zeros(20, np.int64)})
    assert (settled(only_people, none).values["group"] == 0).all()
