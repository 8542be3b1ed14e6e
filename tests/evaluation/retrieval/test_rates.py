import math

import numpy as np
import pytest

from evaluation.described import make_objects, on_circle, random_objects, split_distances
from lookonce.evaluation import (
    PairDistances,
    equal_error_rate,
    pair_distances,
    rates_at,
    roc_auc,
    threshold_at,
)

SEEDS = range(5)


def _pairs(genuine, impostor):
    return PairDistances(np.array(genuine, np.int64), np.array(impostor, np.int64), 1, 1, 1)


def _binned_equal_error_rate(genuine, impostor, bins=4096):
    """Walk along the edges; where the sign changes, cut the two straight lines."""
    genuine = [min(int(d / 2 * bins), bins - 1) for d in genuine]
    impostor = [min(int(d / 2 * bins), bins - 1) for d in impostor]
    edges = range(bins + 1)
    accepts = [sum(b < edge for b in impostor) / len(impostor) for edge in edges]
    rejects = [sum(b >= edge for b in genuine) / len(genuine) for edge in edges]
    level = [edge for edge in edges if abs(accepts[edge] - rejects[edge]) < 1e-12]
    if level:
        return accepts[level[0]], (level[0] + level[-1]) / bins
    edge = next(edge for edge in edges if accepts[edge] > rejects[edge])
    before, after = accepts[edge - 1] - rejects[edge - 1], accepts[edge] - rejects[edge]
    part = before / (before - after)
    return accepts[edge - 1] + part * (accepts[edge] - accepts[edge - 1]), (edge - 1 + part) * 2 / bins


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_equal_error_rate_matches_its_definition(seed, ties):
    objects = random_objects(seed, ties=ties)
    found = equal_error_rate(pair_distances(objects, 1, 9))
    assert found == pytest.approx(_binned_equal_error_rate(*split_distances(objects, 1, 9)), abs=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_equal_error_rate_is_between_the_steps_of_sorted_distances(seed):
    objects = random_objects(seed)
    genuine, impostor = split_distances(objects, 1, 9)
    rate, threshold = equal_error_rate(pair_distances(objects, 1, 9))
    width = 2 / 4096
    assert sum(d < threshold - width for d in impostor) / len(impostor) <= rate + 1e-9
    assert sum(d < threshold + width for d in impostor) / len(impostor) >= rate - 1e-9
    assert sum(d > threshold + width for d in genuine) / len(genuine) <= rate + 1e-9
    assert sum(d > threshold - width for d in genuine) / len(genuine) >= rate - 1e-9


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_auc_is_the_share_of_pairs_in_the_right_order(seed, ties):
    objects = random_objects(seed, ties=ties)
    genuine, impostor = ([int(d / 2 * 4096) for d in distances] for distances in split_distances(objects, 1, 9))
    right = sum((g < i) + 0.5 * (g == i) for g in genuine for i in impostor)
    assert roc_auc(pair_distances(objects, 1, 9)) == pytest.approx(right / len(genuine) / len(impostor), abs=1e-12)


@pytest.mark.parametrize(
    ("genuine", "impostor", "rate", "threshold", "auc"),
    [
        pytest.param([4, 0, 0, 0], [0, 0, 0, 2], 0, 1.0, 1, id="separated-threshold-in-the-middle"),
        pytest.param([0, 0, 0, 2], [4, 0, 0, 0], 1, 1.0, 0, id="the-wrong-way-round"),
        pytest.param([0, 5, 0, 0], [0, 2, 0, 0], 0.5, 0.75, 0.5, id="all-in-one-bin"),
        pytest.param([1, 1, 1, 1], [1, 1, 1, 1], 0.5, 1.0, 0.5, id="alike"),
        pytest.param([1, 0, 0, 0], [1, 0, 0, 0], 0.5, 0.25, 0.5, id="one-of-each-tied"),
        pytest.param([3, 1], [1, 3], 0.25, 1.0, 0.75, id="two-bins"),
    ],
)
def test_known_histograms(genuine, impostor, rate, threshold, auc):
    pairs = _pairs(genuine, impostor)
    assert equal_error_rate(pairs) == pytest.approx((rate, threshold))
    assert roc_auc(pairs) == pytest.approx(auc)


@pytest.mark.parametrize(("genuine", "impostor"), [([1, 2], [0, 0]), ([0, 0], [1, 2]), ([0, 0], [0, 0])])
def test_a_missing_kind_of_pair_gives_nan(genuine, impostor):
    pairs = _pairs(genuine, impostor)
    assert all(math.isnan(value) for value in (*equal_error_rate(pairs), roc_auc(pairs)))
    accepts, rejects = rates_at(pairs, 1.0)
    assert math.isnan(accepts) == (sum(impostor) == 0) == math.isnan(threshold_at(pairs, 0.1))
    assert math.isnan(rejects) == (sum(genuine) == 0)


def test_a_single_identity_has_no_impostors():
    pairs = pair_distances(make_objects(on_circle([0, 1, 2]), [5, 5, 5], [0, 1, 2]), 1, 2)
    assert (pairs.genuine_count, pairs.impostor_count) == (3, 0)
    assert math.isnan(equal_error_rate(pairs)[0])


@pytest.mark.parametrize("seed", SEEDS)
def test_rates_at_an_edge_are_shares_of_nearer_pairs(seed):
    objects = random_objects(seed)
    genuine, impostor = split_distances(objects, 1, 9)
    pairs = pair_distances(objects, 1, 9)
    for edge in (0, 1000, 2048, 3000, 4096):
        threshold = edge * 2 / 4096
        accepts, rejects = rates_at(pairs, threshold)
        assert accepts == pytest.approx(sum(d < threshold for d in impostor) / len(impostor))
        assert rejects == pytest.approx(sum(d >= threshold for d in genuine) / len(genuine))


@pytest.mark.parametrize(
    ("threshold", "rates"), [(-1, (0, 1)), (0.25, (0.125, 1)), (0.75, (0.25, 0.5)), (9, (1, 0)), (math.inf, (1, 0))]
)
def test_rates_within_a_bin_and_beyond_the_ends(threshold, rates):
    assert rates_at(_pairs([0, 2, 0, 0], [1, 0, 1, 2]), threshold) == pytest.approx(rates)


@pytest.mark.parametrize(
    ("wanted", "threshold"), [(0, 0.5), (0.125, 0.75), (0.25, 1.5), (0.5, 1.5 + 1 / 6), (0.999, 1.999333), (1, 2)]
)
def test_threshold_is_the_largest_with_that_rate(wanted, threshold):
    pairs = _pairs([1, 1, 1, 1], [0, 1, 0, 3])
    assert threshold_at(pairs, wanted) == pytest.approx(threshold, abs=1e-5)
    assert rates_at(pairs, threshold_at(pairs, wanted))[0] == pytest.approx(wanted)


def test_equal_error_threshold_has_equal_rates():
    pairs = pair_distances(random_objects(11), 1, 9)
    rate, threshold = equal_error_rate(pairs)
    assert rates_at(pairs, threshold) == pytest.approx((rate, rate))


def test_values_that_are_no_rate_or_threshold_are_refused():
    pairs = _pairs([1], [1])
    with pytest.raises(ValueError, match="false_accept_rate"):
        threshold_at(pairs, 1.1)
    with pytest.raises(ValueError, match="threshold"):
        rates_at(pairs, math.nan)


def test_large_counts_do_not_overflow():
    pairs = _pairs([10**9, 10**9], [10**9, 10**9])
    assert equal_error_rate(pairs) == (0.5, 1.0)
    assert roc_auc(pairs) == 0.5
