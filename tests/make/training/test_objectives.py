"""The contrastive loss against the formula, written with loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from lookonce.make.training.objectives import contrastive_loss


def on_sphere(count: int, size: int = 6, seed: int = 0) -> np.ndarray:
    rows = np.random.default_rng(seed).normal(size=(count, size))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def by_loops(descriptors, identity, is_comparable, temperature) -> float:
    """Khosla et al., equation (2): for each anchor i with partners P(i), the mean over p of -log softmax."""
    count, losses = len(identity), []
    for i in range(count):
        partners = [p for p in range(count) if p != i and identity[p] == identity[i]]
        others = [a for a in range(count) if a != i and (is_comparable[i, a] or identity[a] == identity[i])]
        if not partners:
            continue
        total = sum(math.exp(descriptors[i] @ descriptors[a] / temperature) for a in others)
        terms = [math.log(math.exp(descriptors[i] @ descriptors[p] / temperature) / total) for p in partners]
        losses.append(-sum(terms) / len(partners))
    return sum(losses) / len(losses)


def loss_of(descriptors, identity, is_comparable, temperature=0.2) -> float:
    return float(
        contrastive_loss(torch.tensor(descriptors), torch.tensor(identity), torch.tensor(is_comparable), temperature)
    )


@pytest.mark.parametrize("temperature", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("excluded", [0.0, 0.4])
@pytest.mark.parametrize("seed", range(3))
def test_loss_equals_the_formula(temperature, excluded, seed):
    rng = np.random.default_rng(seed)
    descriptors, identity = on_sphere(17, seed=seed), rng.integers(0, 6, 17)
    pairs = rng.random((17, 17)) >= excluded
    is_comparable = (pairs & pairs.T) | np.eye(17, dtype=bool)
    expected = by_loops(descriptors, identity, is_comparable, temperature)
    assert loss_of(descriptors, identity, is_comparable, temperature) == pytest.approx(expected, rel=1e-9)


def test_pairs_that_are_left_out_do_not_matter():
    """Two groups that are comparable only within themselves: each gives what it gives alone."""
    identity, descriptors = np.array([0, 0, 1, 1, 2, 2, 3, 3, 3]), on_sphere(9)
    group = np.array([0, 0, 0, 0, 1, 1, 1, 1, 1])
    together = loss_of(descriptors, identity, group[:, None] == group)
    alone = [
        loss_of(descriptors[rows], identity[rows], np.ones((rows.sum(),) * 2, bool))
        for rows in (group == 0, group == 1)
    ]
    assert together == pytest.approx((4 * alone[0] + 5 * alone[1]) / 9)
    assert together < loss_of(descriptors, identity, np.ones((9, 9), bool))


def test_nothing_flows_through_pairs_that_are_left_out():
    identity = torch.tensor([0, 0, 1])
    descriptors = torch.tensor(on_sphere(3), requires_grad=True)
    is_comparable = torch.tensor([[True, True, False], [True, True, False], [False, False, True]])
    contrastive_loss(descriptors, identity, is_comparable, 0.1).backward()
    assert descriptors.grad is not None
    assert (descriptors.grad == 0).all()


def test_the_order_of_the_rows_does_not_matter():
    identity = np.array([0, 0, 1, 1, 2])
    descriptors, order = on_sphere(5), np.array([3, 1, 4, 0, 2])
    every = np.ones((5, 5), bool)
    assert loss_of(descriptors, identity, every) == pytest.approx(loss_of(descriptors[order], identity[order], every))


@pytest.mark.parametrize("count", [0, 1, 4])
def test_without_partners_the_loss_is_nothing_and_has_a_gradient(count):
    descriptors = torch.tensor(on_sphere(count), requires_grad=True)
    loss = contrastive_loss(descriptors, torch.arange(count), torch.ones(count, count, dtype=torch.bool), 0.1)
    loss.backward()
    assert loss.item() == 0
    assert descriptors.grad is not None
    assert (descriptors.grad == 0).all()


def test_rows_without_a_partner_are_others_to_all():
    """They have no term of their own, but push."""
    identity, descriptors = np.array([0, 0, 1]), on_sphere(3)
    every = np.ones((3, 3), bool)
    assert loss_of(descriptors, identity, every) > loss_of(descriptors[:2], identity[:2], every[:2, :2]) == 0
