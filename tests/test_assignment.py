"""Pairs that are in every best choice, found with plain numbers and with arrays."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce import assignment


@pytest.mark.parametrize("tolerance", [0.0, 0.25])
@pytest.mark.parametrize("seed", range(30))
def test_few_pairs_are_settled_as_many_are(monkeypatch, seed, tolerance):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 60))
    rows, columns = np.sort(rng.integers(0, count, count)) + 7, rng.integers(0, count, count)
    weights = rng.integers(1, 9, count) / 4 if seed % 2 else rng.exponential(1.0, count)
    answers = []
    for few in (0, 1000):
        monkeypatch.setattr(assignment, "_FEW", few)
        answers.append(assignment.settle(rows, columns, weights, tolerance))
    for many, plain in zip(*answers, strict=True):
        assert many.dtype == plain.dtype
        assert many.tolist() == plain.tolist()
    assert len(answers[0][0]) + len(answers[0][1]) <= count
