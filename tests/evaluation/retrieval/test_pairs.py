import numpy as np
import pytest

from evaluation.described import make_objects, on_circle, random_objects, renamed, shuffled, split_distances
from lookonce.evaluation import PairDistances, pair_distances

BINS = 4096


def _histogram(distances):
    counts = [0] * BINS
    for distance in distances:
        counts[min(int(distance / 2 * BINS), BINS - 1)] += 1
    return counts


def _same(a, b):
    assert a.genuine.tolist() == b.genuine.tolist()
    assert a.impostor.tolist() == b.impostor.tolist()
    assert (a.identities, a.share) == (b.identities, b.share)


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_counts_equal_those_of_all_pairs(seed, ties):
    objects = random_objects(seed, ties=ties)
    genuine, impostor = split_distances(objects, 2, 6)
    pairs = pair_distances(objects, 2, 6)
    assert pairs.genuine.tolist() == _histogram(genuine)
    assert pairs.impostor.tolist() == _histogram(impostor)
    assert (pairs.genuine_count, pairs.impostor_count) == (len(genuine), len(impostor))
    assert pairs.share == 1


def test_order_of_rows_and_names_of_identities_change_nothing():
    objects = random_objects(7)
    expected = pair_distances(objects, 1, 8)
    _same(pair_distances(shuffled(objects, 0), 1, 8), expected)
    _same(pair_distances(renamed(objects), 1, 8), expected)


def test_same_number_in_two_sequences_is_never_compared():
    objects = make_objects(on_circle([0, 0]), [1, 1], [0, 1], sequences=[0, 1])
    pairs = pair_distances(objects, 0, 10)
    assert (pairs.genuine_count, pairs.impostor_count, pairs.identities) == (0, 0, 0)


def test_opposite_descriptors_are_in_the_last_bin():
    pairs = pair_distances(make_objects(on_circle([0, np.pi]), [1, 1], [0, 1]), 1, 1)
    assert pairs.genuine[-1] == 1


def test_identities_are_those_with_a_genuine_pair():
    objects = make_objects(on_circle([0] * 6), [1, 1, 2, 2, 3, 1], [0, 1, 0, 5, 0, 1], [0, 0, 0, 0, 0, 9])
    assert pair_distances(objects, 1, 1).identities == 1
    assert pair_distances(objects, 1, 5).identities == 2


@pytest.mark.parametrize("count", [0, 1])
def test_without_pairs_the_counts_are_zero(count):
    pairs = pair_distances(make_objects(np.ones((count, 1)), np.zeros(count), np.zeros(count)), 1, 10)
    assert (pairs.genuine_count, pairs.impostor_count, pairs.identities, pairs.share) == (0, 0, 0, 1)


def test_more_pairs_than_allowed_are_thinned_evenly_and_reported():
    rng = np.random.default_rng(0)
    identities, frames = np.tile(np.arange(6), 300), np.repeat(np.arange(300), 6)
    vectors = rng.normal(size=(1800, 8)) + rng.normal(size=(6, 8))[identities]
    objects = make_objects(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), identities, frames)
    whole = pair_distances(objects, 1, 50)
    some = pair_distances(objects, 1, 50, most_pairs=100_000)
    compared = some.genuine_count + some.impostor_count
    assert compared == pytest.approx(100_000, rel=0.05)
    assert some.share == compared / (whole.genuine_count + whole.impostor_count)
    assert some.genuine_count / compared == pytest.approx(1 / 6, abs=1e-9)
    assert some.identities == 6
    mean = [float(p.impostor @ np.arange(BINS) / p.impostor_count) for p in (whole, some)]
    assert mean[1] == pytest.approx(mean[0], rel=0.01)
    _same(pair_distances(shuffled(objects, 1), 1, 50, most_pairs=100_000), some)


def test_a_cap_below_one_query_still_compares_one():
    pairs = pair_distances(random_objects(3), 1, 12, most_pairs=1)
    assert 0 < pairs.share < 0.2
    with pytest.raises(ValueError, match="most_pairs"):
        pair_distances(random_objects(3), 1, 12, most_pairs=0)


@pytest.mark.parametrize(
    ("genuine", "impostor", "message"),
    [
        pytest.param(np.zeros(3, np.int64), np.zeros(4, np.int64), "impostor: expected", id="lengths"),
        pytest.param(np.zeros(0, np.int64), np.zeros(0, np.int64), "genuine: expected", id="no-bins"),
        pytest.param(np.zeros(3), np.zeros(3), "got .* float64", id="dtype"),
        pytest.param(np.zeros(3, np.int64), np.array([0, -1, 0]), "negative", id="negative"),
    ],
)
def test_counts_that_are_none_are_refused(genuine, impostor, message):
    with pytest.raises(ValueError, match=message):
        PairDistances(genuine, impostor, 1, 1, 2)
