import math

import numpy as np
import pytest

from evaluation.described import distance, gallery, make_objects, on_circle, random_objects, renamed, shuffled
from lookonce.evaluation import mean_average_precision, nearest_distances, rank_gallery, rank_one
from lookonce.evaluation.retrieval import timeline as module

SEEDS = range(4)


@pytest.fixture(params=["one-block", "many-blocks"])
def _blocks(request, monkeypatch):
    if request.param == "many-blocks":
        monkeypatch.setattr(module, "_BLOCK_ENTRIES", 20)


def _slow_rank_one(objects, gap):
    right, chance = [], []
    for query in range(len(objects)):
        later = [row for row in gallery(objects, query, gap, gap) if objects.frames[row] > objects.frames[query]]
        if any(objects.identities[row] == objects.identities[query] for row in later):
            right.append(objects.identities[later[0]] == objects.identities[query])
            chance.append(1 / len(later))
    return np.mean(right), len(right), np.mean(chance)


def _slow_mean_average_precision(objects, min_gap, max_gap):
    precisions, right = [], []
    for query in range(len(objects)):
        is_same = [
            objects.identities[row] == objects.identities[query] for row in gallery(objects, query, min_gap, max_gap)
        ]
        at_hits = [sum(is_same[: rank + 1]) / (rank + 1) for rank in range(len(is_same)) if is_same[rank]]
        if at_hits:
            precisions.append(sum(at_hits) / len(at_hits))
            right.append(is_same[0])
    return np.mean(precisions), np.mean(right), len(right)


@pytest.mark.usefixtures("_blocks")
@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_rank_one_matches_its_definition(seed, ties):
    objects = random_objects(seed, ties=ties)
    for gap in (1, 3):
        found = rank_one(objects, gap)
        assert (found.rate, found.queries, found.chance) == pytest.approx(_slow_rank_one(objects, gap), abs=1e-12)


@pytest.mark.usefixtures("_blocks")
@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("gaps", [(0, 0), (0, 12), (2, 5)])
def test_mean_average_precision_matches_its_definition(seed, ties, gaps):
    objects = random_objects(seed, ties=ties)
    found = mean_average_precision(objects, *gaps)
    values = (found.mean_average_precision, found.rank_one, found.queries)
    if found.queries:
        assert values == pytest.approx(_slow_mean_average_precision(objects, *gaps), abs=1e-12)
    else:
        assert gaps == (0, 0)  # nobody is twice in a frame
        assert math.isnan(found.mean_average_precision)
        assert math.isnan(found.rank_one)


@pytest.mark.usefixtures("_blocks")
@pytest.mark.parametrize("seed", SEEDS)
def test_galleries_and_nearest_distances_match_their_definition(seed):
    objects = random_objects(seed, ties=seed % 2 == 1)
    queries, genuine, impostor = nearest_distances(objects, 2, 6)
    assert sorted(queries.tolist()) == list(range(len(objects)))
    for query, own, other in zip(queries.tolist(), genuine.tolist(), impostor.tolist(), strict=True):
        expected = gallery(objects, query, 2, 6)
        rows, apart = rank_gallery(objects, query, 2, 6)
        assert rows.tolist() == expected
        assert apart.tolist() == [distance(objects, query, row) for row in expected]
        for value, is_same in ((own, True), (other, False)):
            near = [
                distance(objects, query, row)
                for row in expected
                if (objects.identities[row] == objects.identities[query]) == is_same
            ]
            assert value == min(near, default=math.inf)


def test_order_of_rows_and_names_of_identities_change_nothing():
    objects = random_objects(9)
    for other in (shuffled(objects, 4), renamed(objects)):
        one, two = rank_one(objects, 1), rank_one(other, 1)
        assert (one.rate, one.queries, one.chance) == pytest.approx((two.rate, two.queries, two.chance))
        three, four = mean_average_precision(objects, 1, 9), mean_average_precision(other, 1, 9)
        assert three.mean_average_precision == pytest.approx(four.mean_average_precision)
        assert (three.rank_one, three.queries) == pytest.approx((four.rank_one, four.queries))


def test_a_query_counts_only_where_its_object_is_there_later():
    # 1 is alone in frame 2: right of necessity, and so is chance; 2 is gone.
    found = rank_one(make_objects(on_circle([0, 1, 3]), [1, 2, 1], [0, 0, 2]), 2)
    assert (found.rate, found.queries, found.chance) == (1, 1, 1)


def test_of_equally_near_objects_the_lowest_row_decides():
    frames, vectors = [0, 1, 1], on_circle([0, 0.5, 0.5])
    assert rank_one(make_objects(vectors, [1, 1, 2], frames), 1).rate == 1
    assert rank_one(make_objects(vectors, [1, 2, 1], frames), 1).rate == 0
    later_ids_first = make_objects(vectors, [5, 5, 2], frames)
    assert rank_one(later_ids_first, 1).rate == 1
    assert rank_gallery(later_ids_first, 0, 1, 1)[0].tolist() == [1, 2]
    assert mean_average_precision(later_ids_first, 1, 1).rank_one == 1


def test_other_sequences_are_never_in_the_gallery():
    objects = make_objects(on_circle([0, 0, 1]), [1, 1, 2], [0, 1, 1], sequences=[0, 1, 0])
    assert rank_one(objects, 1).queries == 0
    assert mean_average_precision(objects, 0, 5).queries == 0
    assert rank_gallery(objects, 0, 0, 5)[0].tolist() == [2]


@pytest.mark.parametrize("count", [0, 1])
def test_without_pairs_there_are_no_queries(count):
    objects = make_objects(np.ones((count, 1)), np.zeros(count), np.zeros(count))
    one, retrieval = rank_one(objects, 1), mean_average_precision(objects, 0, 9)
    assert (one.queries, retrieval.queries) == (0, 0)
    assert all(math.isnan(v) for v in (one.rate, one.chance, retrieval.rank_one, retrieval.mean_average_precision))
    assert len(nearest_distances(objects, 0, 9)[0]) == count


def test_queries_are_thinned_per_sequence():
    objects = random_objects(0)
    queries, *_ = nearest_distances(objects, 1, 12, most_queries=5)
    assert np.unique(objects.sequences[queries], return_counts=True)[1].tolist() == [5, 5, 5]
    assert mean_average_precision(objects, 1, 12, most_queries=5).queries <= 15


def test_wrong_arguments_are_refused():
    objects = random_objects(0)
    with pytest.raises(ValueError, match="gap_frames"):
        rank_one(objects, 0)
    with pytest.raises(ValueError, match="query_row"):
        rank_gallery(objects, len(objects), 1, 2)
    with pytest.raises(ValueError, match="max_gap_frames"):
        rank_gallery(objects, 0, 3, 2)
    with pytest.raises(ValueError, match="max_gap_frames"):
        mean_average_precision(objects, 3, 2)
    with pytest.raises(ValueError, match="most_queries"):
        mean_average_precision(objects, 1, 2, most_queries=0)
