import numpy as np
import pytest

from evaluation.described import all_pairs, make_objects, on_circle, random_objects
from lookonce.evaluation.retrieval import timeline as module
from lookonce.evaluation.retrieval.timeline import Timeline, spread_evenly


def _pairs(objects, min_gap, max_gap):
    timeline = Timeline.of(objects)
    places = np.arange(len(timeline))
    blocks = list(timeline.pairs(places, timeline.later(places, min_gap, max_gap)))
    return [
        (a, b, d)
        for block in blocks
        for a, b, d in zip(block.queries.tolist(), block.others.tolist(), block.distances.tolist(), strict=True)
    ]


@pytest.mark.parametrize("gaps", [(0, 0), (0, 3), (1, 1), (2, 5), (3, 10**12), (11, 11), (12, 40), (10**12, 10**12)])
@pytest.mark.parametrize(("entries", "queries"), [(1 << 20, 256), (1, 256), (30, 256), (1 << 20, 3), (1, 1)])
def test_every_pair_comes_exactly_once_whatever_the_blocks(monkeypatch, gaps, entries, queries):
    monkeypatch.setattr(module, "_BLOCK_ENTRIES", entries)
    monkeypatch.setattr(module, "_BLOCK_QUERIES", queries)
    objects = random_objects(5)
    found = _pairs(objects, *gaps)
    expected = {(a, b): d for a, b, d, _ in all_pairs(objects, *gaps)}
    assert {(max(a, b), min(a, b)): d for a, b, d in found} == expected
    assert len(found) == len(expected)
    assert all(objects.frames[a] <= objects.frames[b] for a, b, _ in found)


def test_blocks_stay_within_their_size(monkeypatch):
    monkeypatch.setattr(module, "_BLOCK_ENTRIES", 100)
    timeline = Timeline.of(random_objects(1))
    places = np.arange(len(timeline))
    sizes = [len(block.queries) for block in timeline.pairs(places, timeline.later(places, 0, 4))]
    assert len(sizes) > 3
    assert max(sizes) <= 100


def test_pairs_of_one_query_are_together_in_one_block(monkeypatch):
    monkeypatch.setattr(module, "_BLOCK_ENTRIES", 10)
    timeline = Timeline.of(random_objects(2))
    places = np.arange(len(timeline))
    seen = set()
    for block in timeline.pairs(places, timeline.later(places, 0, 12)):
        assert seen.isdisjoint(block.queries.tolist())
        seen |= set(block.queries.tolist())


@pytest.mark.parametrize("count", [0, 1])
def test_none_and_one_object_give_no_pairs(count):
    assert _pairs(make_objects(on_circle(np.zeros(count)), np.zeros(count), np.zeros(count)), 0, 10) == []


def test_last_frame_of_one_sequence_never_meets_the_first_of_the_next():
    last = 2**31 - 1
    objects = make_objects(on_circle([0, 1, 2, 3]), [1, 1, 1, 1], [0, last, 0, last], [4, 4, 5, 5])
    assert sorted((a, b) for a, b, _ in _pairs(objects, 1, 10**15)) == [(0, 1), (2, 3)]


def test_the_nearest_of_equal_descriptors_is_at_exactly_zero():
    vector = np.random.default_rng(0).normal(size=128)
    vector /= np.linalg.norm(vector)
    ((_, _, apart),) = _pairs(make_objects(np.stack([vector, vector]), [1, 2], [0, 1]), 1, 1)
    assert apart == 0


def test_a_distance_does_not_depend_on_the_other_pairs(monkeypatch):
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(60, 128))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    objects = make_objects(vectors, np.arange(60), np.arange(60) // 6)
    together = sorted(_pairs(objects, 0, 10))
    monkeypatch.setattr(module, "_BLOCK_ENTRIES", 1)
    assert sorted(_pairs(objects, 0, 10)) == together
    expected = [np.linalg.norm(objects.descriptors[a].astype(float) - objects.descriptors[b]) for a, b, _ in together]
    np.testing.assert_allclose([d for *_, d in together], expected, atol=1e-6)


@pytest.mark.parametrize("gaps", [(-1, 3), (4, 3)])
def test_gaps_that_are_no_range_are_refused(gaps):
    with pytest.raises(ValueError, match="min_gap_frames <= max_gap_frames"):
        _pairs(random_objects(0), *gaps)


@pytest.mark.parametrize(("count", "most"), [(0, 5), (5, 5), (6, 5), (1000, 10), (10_000, 1), (12_345, 777)])
def test_thinned_places_are_as_many_as_asked_rising_and_spread(count, most):
    places = spread_evenly(count, most)
    assert len(places) == min(count, most)
    assert (np.diff(places) > 0).all()
    assert ((places >= 0) & (places < count)).all()
    if count > most:
        assert np.diff(places, prepend=0, append=count).max() < 5 * count / most


@pytest.mark.parametrize("period", [2, 3, 5, 6, 7, 10])
def test_thinning_does_not_fall_into_step_with_the_objects_of_a_frame(period):
    phases = np.bincount(spread_evenly(6000, 6000 // period) % period, minlength=period)
    assert phases.min() > 0.8 * phases.mean()
