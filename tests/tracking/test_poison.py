"""Rows that cannot be, and second boxes, mixed into a clean scene: nobody else's identity changes."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.tracking import Tracker
from tracking.moving import crowd

OBJECTS, SIZE = 12, 16


def _impossible(rng, rows, count):
    """Rows of which a number is not finite or a size not above 0; (count, 6)."""
    bad = rows[rng.integers(0, len(rows), count)].copy()
    for row in bad:
        kind = rng.integers(0, 4)
        if kind == 0:
            row[rng.integers(0, 6)] = rng.choice([np.nan, np.inf, -np.inf])
        elif kind == 1:
            row[2 + rng.integers(0, 2)] = rng.choice([np.nan, np.inf, 1e39])
        elif kind == 2:
            row[[0, 2]] = row[[2, 0]]
        else:
            row[3] = row[1]
    return bad


def _poisoned(rng, frame):
    """The frame's rows with others among them: rows, descriptors, and (N,) bool which are clean."""
    rows, looks = frame.rows, frame.looks
    twins = rng.integers(0, len(rows), rng.integers(0, 4))
    bad = _impossible(rng, rows, int(rng.integers(0, 5)))
    twin_looks = looks[twins] * (rng.random((len(twins), 1)) < 0.5)  # half of them have none
    bad_looks = rng.normal(size=(len(bad), SIZE))
    bad_looks[rng.random(len(bad)) < 0.3] = np.nan
    usual = rows[rng.integers(0, len(rows), rng.integers(0, 3))]  # whose descriptors cannot be
    unlike = np.full((len(usual), SIZE), rng.choice([np.nan, np.inf]))
    extra = np.concatenate([bad, usual, rows[twins]])
    extra_looks = np.concatenate([bad_looks, unlike, twin_looks])
    # Anywhere, but a second box of the same score comes after its first one.
    place = np.concatenate([rng.uniform(-1, len(rows), len(bad) + len(usual)), twins + 0.5, np.arange(len(rows))])
    order = np.argsort(place, kind="stable")
    every, every_looks = np.concatenate([extra, rows]), np.concatenate([extra_looks, looks])
    return every[order], every_looks[order], order >= len(extra)


def _run(frames):
    """Ids and rows given back of the clean rows, with poison and without, must be the same in every frame."""
    rng, clean, dirty = np.random.default_rng(1), Tracker(), Tracker()
    dropped, known, numbers = 0, 0, []
    for number, frame in enumerate(crowd(OBJECTS, frames, seed=7, size=SIZE)):
        rows, looks, is_clean = _poisoned(rng, frame)
        expected = clean.update(frame.rows, frame.time_s, descriptors=frame.looks)[:, 6]
        found = dirty.update(rows, frame.time_s, descriptors=looks)
        assert found.shape == (len(rows), 7)
        np.testing.assert_array_equal(found[is_clean, 6], expected, err_msg=f"frame {number}")
        assert (found[~is_clean, 6] == -1).all(), f"frame {number}"
        numbers = [*numbers[-300:], np.flatnonzero(is_clean)]
        one, two = clean.given_back, dirty.given_back
        assert (one.frames.tolist(), one.ids.tolist()) == (two.frames.tolist(), two.ids.tolist())
        for back, row, row_there in zip(one.frames.tolist(), one.rows.tolist(), two.rows.tolist(), strict=True):
            if number - back < len(numbers):
                assert numbers[back - number - 1][row] == row_there
        dropped += len(rows) - len(frame.rows)
        known += int((expected > 0).sum())
    assert known > 6 * frames
    assert 0 < dirty.dropped_rows < dropped
    assert clean.dropped_rows == 0


def test_poison_changes_nobody():
    _run(2_000)


@pytest.mark.slow
def test_poison_changes_nobody_for_an_hour():
    _run(100_000)


def test_second_box_without_descriptor_does_not_take_the_place_of_the_first():
    """A copy of a row, of the same score, that stands before it and has no descriptor, was kept in its stead."""
    tracker, box = Tracker(), [100.0, 100, 140, 180, 0.9, 0]
    for number in range(4):
        ids = tracker.update(np.array([box, box]), number * 0.04, descriptors=np.array([[0.0, 0], [1, 0]]))[:, 6]
    assert ids.tolist() == [-1, 1]
