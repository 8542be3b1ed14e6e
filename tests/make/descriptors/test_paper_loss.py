"""Equation (1), and the classifier behind it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from lookonce.make.descriptors.paper_loss import PaperClassifier, paper_loss


def _equation_1(predicted, labels):
    """The equation written out: regions, anchors, classes."""
    regions, anchors, classes = predicted.shape
    loss = 0.0
    for region in range(regions):
        for anchor in range(anchors):
            row_error = 0.0
            row_label = 0.0
            for j in range(classes):
                row_error += (labels[region, anchor, j] - predicted[region, anchor, j]) ** 2
                row_label += labels[region, anchor, j]
            loss += row_error * row_label
    return loss


def _random_case(seed, empty=0.5):
    """Probabilities and labels (cells, anchors, identities); about half the anchors are empty."""
    rng = np.random.default_rng(seed)
    regions, anchors, classes = rng.integers(2, 6, 3)
    predicted = rng.dirichlet(np.ones(classes), (regions, anchors)).astype(np.float32)
    labels = np.eye(classes, dtype=np.float32)[rng.integers(classes, size=(regions, anchors))]
    labels[rng.random((regions, anchors)) < empty] = 0
    return predicted, labels


@pytest.mark.parametrize("seed", range(20))
def test_loss_is_equation_1(seed):
    predicted, labels = _random_case(seed)
    found = paper_loss(torch.from_numpy(predicted), torch.from_numpy(labels)).item()
    np.testing.assert_allclose(found, _equation_1(np.float64(predicted), np.float64(labels)), rtol=1e-6)


def test_rows_are_as_good_as_cells():
    predicted, labels = (torch.from_numpy(array) for array in _random_case(4))
    rows = paper_loss(predicted.flatten(0, 1), labels.flatten(0, 1))
    torch.testing.assert_close(rows, paper_loss(predicted, labels))


def test_gradient_of_an_empty_anchor_is_exactly_zero():
    predicted, labels = _random_case(7)
    values = torch.from_numpy(predicted).requires_grad_()
    paper_loss(values, torch.from_numpy(labels)).backward()
    is_empty = labels.sum(axis=2) == 0
    assert 0 < is_empty.sum() < is_empty.size
    assert (values.grad.numpy()[is_empty] == 0).all()
    assert (np.abs(values.grad.numpy()[~is_empty]).sum(axis=1) > 0).all()


def test_nothing_costs_nothing():
    assert paper_loss(torch.zeros(0, 5), torch.zeros(0, 5)).item() == 0
    predicted, labels = _random_case(1, empty=2)
    assert paper_loss(torch.from_numpy(predicted), torch.from_numpy(labels)).item() == 0


def test_other_shapes_are_refused():
    with pytest.raises(ValueError, match=r"labels: expected \(2, 5\), got \(5,\)"):
        paper_loss(torch.zeros(2, 5), torch.zeros(5))


@torch.no_grad()
def test_classifier_gives_rows_and_maps_the_same_probabilities():
    classifier = PaperClassifier(7)
    maps = torch.randn(2, 128, 3, 4, 5, generator=torch.Generator().manual_seed(0))
    whole = classifier.forward_map(maps)
    rows = classifier(maps.permute(0, 2, 3, 4, 1).reshape(-1, 128))
    assert whole.shape == (2, 7, 3, 4, 5)
    torch.testing.assert_close(rows, whole.permute(0, 2, 3, 4, 1).reshape(-1, 7), atol=1e-6, rtol=0)
    torch.testing.assert_close(rows.sum(dim=1), torch.ones(len(rows)))
    assert classifier(torch.zeros(0, 128)).shape == (0, 7)
