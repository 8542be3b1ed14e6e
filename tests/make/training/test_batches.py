"""Which rows a step sees: the same for the same seed and step, of every source, never held-out ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lookonce.make.training.batches import BatchSampler
from make.training.scenes import make_readings


def batches(sampler: BatchSampler, count: int = 20) -> list[list[int]]:
    return [sampler(step).tolist() for step in range(count)]


def test_the_same_seed_and_step_give_the_same_rows():
    readings = make_readings(30, sources=3)
    first, second = (BatchSampler(readings, 12, 4, seed=5) for _ in range(2))
    assert second(7).tolist() == first(7).tolist()  # whatever was asked before
    assert batches(first) == batches(second)
    assert batches(first) != batches(BatchSampler(readings, 12, 4, seed=6))
    assert len({tuple(rows) for rows in batches(first)}) > 15


def test_held_out_rows_are_never_drawn():
    readings = make_readings(12, held_out=5)
    for rows in batches(BatchSampler(readings, 8, 3, seed=0), 50):
        assert not readings.held_out[readings.identity[rows]].any()


def test_rows_are_drawn_once_and_in_order():
    for rows in batches(BatchSampler(make_readings(20, sources=2), 10, 3, seed=0)):
        assert rows == sorted(set(rows))


def test_identities_with_one_row_are_not_drawn():
    """They have no partner, so nothing would pull them anywhere."""
    readings = make_readings(10, rows=4, held_out=2)
    kept = np.flatnonzero((readings.identity != 3) | (readings.frame == 0))
    readings = replace(
        readings,
        identity=readings.identity[kept],
        source=readings.source[kept],
        frame=readings.frame[kept],
        height_px=readings.height_px[kept],
        values={name: values[kept] for name, values in readings.values.items()},
    )
    drawn = {int(readings.identity[row]) for rows in batches(BatchSampler(readings, 6, 2, 0), 40) for row in rows}
    assert drawn == set(range(8)) - {3}


def test_all_sources_and_identities_appear():
    readings = make_readings(60, sources=4, held_out=4)
    drawn = np.concatenate([BatchSampler(readings, 10, 2, 0)(step) for step in range(60)])
    assert set(readings.source[drawn].tolist()) == {0, 1, 2, 3}
    assert len(np.unique(readings.identity[drawn])) == 56


def test_a_small_source_is_not_drowned_by_a_large_one():
    """Half of a batch is drawn source by source: so a short sequence is seen more often than it is long."""
    readings = make_readings(104, sources=1, held_out=4)
    source = np.where(readings.identity < 6, 1, 0)
    readings = replace(readings, source=source, scene=np.where(np.arange(104) < 6, 1, 0), kinds=("sequences",) * 2)
    sampler = BatchSampler(readings, 24, 2, 0)
    share = np.mean([(readings.source[sampler(step)] == 1).mean() for step in range(100)])
    assert share > 2 * 6 / 100


def test_kinds_of_scenes_have_their_part_however_many_sources_they_have():
    """Sequences together have as much as all the rest, and of that a rendered crowd has more than sets of stills."""
    readings = make_readings(220, sources=11, held_out=0)
    readings = replace(readings, kinds=(*["sequences"] * 5, *["stills"] * 5, "rendered people"))
    sampler = BatchSampler(readings, 66, 2, 0)
    source = np.concatenate([readings.source[sampler(step)] for step in range(300)])
    shares = np.bincount(source, minlength=11) / len(source)
    sequences, stills, rendered = shares[:5].sum(), shares[5:10].sum(), shares[10]
    assert sequences > 1.3 * stills
    assert rendered > 2 * shares[5:10].max()


@pytest.mark.parametrize("kinds", [("sequences",) * 2, ("rendered people",) * 2, ("stills", "clips")])
def test_any_kinds_alone_are_drawn_whole(kinds):
    sampler = BatchSampler(replace(make_readings(40, sources=2, held_out=0), kinds=kinds), 10, 2, 0)
    assert len(np.unique(np.concatenate([sampler(step) for step in range(40)]))) > 100


def test_batches_are_about_as_large_as_asked():
    readings = make_readings(100, rows=8)
    sizes = [len(np.unique(readings.identity[rows])) for rows in batches(BatchSampler(readings, 20, 3, 0))]
    assert max(sizes) <= 20 + 16
    assert min(sizes) >= 10
    for rows in batches(BatchSampler(readings, 20, 3, 0)):
        assert np.bincount(readings.identity[rows]).max() <= 3


def test_scenes_with_one_identity_are_no_obstacle():
    readings = make_readings(8, held_out=2)
    readings = replace(readings, scene=np.arange(8))
    assert all(len(rows) > 0 for rows in batches(BatchSampler(readings, 6, 2, 0)))


@pytest.mark.parametrize(
    "readings", [make_readings(4, rows=1, held_out=0), make_readings(4, held_out=4), make_readings(0)]
)
def test_nothing_to_draw_is_seen_beforehand(readings):
    assert len(BatchSampler(readings, 6, 2, 0).groups) == 0
