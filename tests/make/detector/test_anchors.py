"""Anchors fitted to objects: planted sizes are found and go to the right outputs."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.make.detector import anchors as anchors_module
from lookonce.make.detector.anchors import fit_anchors, mean_best_overlap
from make.detector.rectangles import network_of, one_grid, two_grids

PLANTED = np.array([[6.0, 9], [14, 12], [24, 40], [60, 34]])


@pytest.fixture
def _at_one_size(monkeypatch):
    monkeypatch.setattr(anchors_module, "_SIZES", (1.0,))


def planted(rng: np.random.Generator, each: int = 60) -> np.ndarray:
    return np.concatenate([size * np.exp(rng.normal(0, 0.03, (each, 2))) for size in PLANTED])


@pytest.mark.usefixtures("_at_one_size")
def test_planted_sizes_are_found_and_small_ones_are_for_the_fine_grid(tmp_path):
    network = network_of(tmp_path, two_grids())
    extents = planted(np.random.default_rng(0))
    coarse, fine = fit_anchors(extents, network, np.random.default_rng(1))
    np.testing.assert_allclose(fine, PLANTED[:2], rtol=0.03)
    np.testing.assert_allclose(coarse, PLANTED[2:], rtol=0.03)
    assert mean_best_overlap(extents, [*coarse, *fine]) > 0.9
    assert all(round(side, 1) == side for shape in (*coarse, *fine) for side in shape)


def test_fitted_anchors_fit_better_than_others(tmp_path):
    network = network_of(tmp_path, two_grids())
    rng = np.random.default_rng(3)
    extents = np.exp(rng.normal([2.5, 3.2], 0.3, (500, 2)))
    found = [shape for own in fit_anchors(extents, network, rng) for shape in own]
    others = [shape for layer in network.outputs for shape in network.output_spec(layer).anchors]
    assert mean_best_overlap(extents, found) > mean_best_overlap(extents, others) + 0.05


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_few_objects_are_enough(tmp_path, count):
    network = network_of(tmp_path, two_grids())
    found = fit_anchors(PLANTED[:count], network, np.random.default_rng(0))
    assert [len(own) for own in found] == [2, 2]
    assert np.isfinite(found).all()
    assert np.min(found) > 0
    areas = [w * h for own in found[::-1] for w, h in own]
    assert areas == sorted(areas)


def test_objects_of_extreme_size_are_kept_within_the_picture(tmp_path):
    network = network_of(tmp_path, one_grid())
    extents = np.array([[0.0, 0], [1e-3, 500], [10_000, 10_000]])
    found = np.array(fit_anchors(extents, network, np.random.default_rng(0)))
    assert (found >= 3).all()
    assert (found <= 80).all()


def test_the_same_numbers_give_the_same_anchors_also_of_many_objects(tmp_path, monkeypatch):
    monkeypatch.setattr(anchors_module, "_MOST_OBJECTS", 100)
    network, extents = network_of(tmp_path, two_grids()), planted(np.random.default_rng(0))
    first, again = (fit_anchors(extents, network, np.random.default_rng(5)) for _ in range(2))
    assert first == again


def test_overlap_is_that_of_the_best_anchor_of_each_object():
    extents = np.array([[10.0, 10], [20, 40]])
    assert mean_best_overlap(extents, [(10, 10), (20, 40)]) == pytest.approx(1)
    assert mean_best_overlap(extents, [(10, 5), (20, 20)]) == pytest.approx((0.5 + 0.5) / 2)
