"""Tracks from unlabelled video: pure before long."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.make.training.linking import link_detections
from make.training.scenes import make_detections

FAR = 200.0


def moving(start: float, step: float, index: int, *, size: float = 20, top: float = 0) -> list[float]:
    left = start + step * index
    return [left, top, left + size, top + size]


def in_frames(*detections):
    return [(index, index / 10, found) for index, found in enumerate(detections)]


def boxes_by_track(links) -> dict[int, list[float]]:
    """The left edge of each row, by track."""
    found: dict[int, list[float]] = {}
    for row in links.rows:
        found.setdefault(row.track, []).append(float(row.xyxy[0]))
    return found


def test_two_far_objects_give_two_tracks():
    scene = [make_detections([moving(0, 2, n), moving(FAR, -3, n)]) for n in range(8)]
    links = link_detections(in_frames(*scene))
    assert (links.tracks, links.ambiguous, links.short) == (2, 0, 0)
    assert boxes_by_track(links) == {0: [2.0 * n for n in range(8)], 1: [FAR - 3.0 * n for n in range(8)]}
    assert [row.frame for row in links.rows] == sorted(row.frame for row in links.rows)
    assert links.rows[-1].time_s == pytest.approx(0.7)


def test_order_of_the_detections_does_not_matter():
    scene = [make_detections([moving(0, 2, n), moving(FAR, -3, n)]) for n in range(8)]
    turned = [found[::-1] if n % 2 else found for n, found in enumerate(scene)]
    tracks = boxes_by_track(link_detections(in_frames(*turned)))
    assert sorted(tracks.values()) == sorted(boxes_by_track(link_detections(in_frames(*scene))).values())


def test_objects_that_cross_are_cut_and_counted():
    """Where they overlap nobody knows which is which, so no track reaches from before to behind."""
    scene = [make_detections([moving(0, 5, n), moving(100, -5, n, top=4)]) for n in range(21)]
    links = link_detections(in_frames(*scene))
    assert links.tracks == 4
    assert links.ambiguous > 0
    for lefts in boxes_by_track(links).values():
        steps = set(np.diff(lefts))
        assert steps in ({5.0}, {-5.0})
        first = {0: lefts[0] // 5, 1: (100 - lefts[0]) // 5}[int(steps == {-5.0})]
        assert first + len(lefts) <= 11 or first >= 10  # ends before they are at one place, or begins there


def test_two_candidates_end_the_track():
    before = [make_detections([[0, 0, 20, 20]])] * 5
    after = [make_detections([[0, 0, 20, 12], [0, 13, 20, 20]])] * 5
    links = link_detections(in_frames(*before, *after))
    assert links.ambiguous == 2
    assert [len(track) for track in boxes_by_track(links).values()] == [5, 5, 5]


def test_one_object_in_place_of_two_ends_both_tracks():
    before = [make_detections([[0, 0, 20, 12], [0, 13, 20, 20]])] * 5
    after = [make_detections([[0, 0, 20, 20]])] * 5
    links = link_detections(in_frames(*before, *after))
    assert links.ambiguous == 1
    assert [len(track) for track in boxes_by_track(links).values()] == [5, 5, 5]


def test_an_object_that_is_overlapped_is_not_linked():
    """Something new stands before it: the box may be that of either."""
    before = [make_detections([[0, 0, 20, 20]])] * 5
    after = [make_detections([[6, 0, 26, 20], [17, 0, 37, 20]])] + [make_detections([[6, 0, 26, 20]])] * 5
    links = link_detections(in_frames(*before, *after))
    assert (links.ambiguous, links.short) == (2, 2)  # when it comes, and when it is gone again
    assert list(boxes_by_track(links).values()) == [[0.0] * 5, [6.0] * 5]


def test_a_jump_with_little_overlap_ends_the_track():
    scene = [make_detections([moving(0, 0, n)]) for n in range(5)] + [
        make_detections([moving(8, 0, n)]) for n in range(5)
    ]
    links = link_detections(in_frames(*scene))
    assert (links.tracks, links.ambiguous) == (2, 1)


def test_short_tracks_are_dropped_and_counted():
    seen = [make_detections([moving(0, 1, n), moving(FAR, 1, n)]) for n in range(4)]
    alone = [make_detections([moving(0, 1, n)]) for n in range(4, 8)]
    links = link_detections(in_frames(*seen, *alone))
    assert (links.tracks, links.ambiguous, links.short) == (1, 0, 4)
    assert {row.track for row in links.rows} == {0}


def test_classes_are_not_mixed():
    scene = [make_detections([[0, 0, 20, 20]], labels=[0 if n < 5 else 1]) for n in range(10)]
    links = link_detections(in_frames(*scene))
    assert [[row.label for row in links.rows if row.track == track] for track in range(2)] == [[0] * 5, [1] * 5]


@pytest.mark.parametrize(
    "scene",
    [pytest.param([], id="no frames"), pytest.param([make_detections([])] * 3, id="no detections")],
)
def test_nothing_seen_gives_no_tracks(scene):
    links = link_detections(in_frames(*scene))
    assert (links.rows, links.tracks, links.ambiguous, links.short) == ((), 0, 0, 0)


def test_an_empty_frame_ends_all_tracks():
    scene = [make_detections([moving(0, 0, n)]) for n in range(5)]
    links = link_detections(in_frames(*scene, make_detections([]), *scene))
    assert (links.tracks, links.ambiguous) == (2, 0)


@pytest.mark.parametrize("first_score", [0.6, 0.9])
def test_an_object_that_is_reported_twice_is_one_track(first_score):
    """A duplicate box of another class would make every frame ambiguous; the box with the better score counts."""
    scene = [
        make_detections([moving(0, 1, n), moving(1, 1, n)], labels=[0, 1], scores=[first_score, 0.8]) for n in range(8)
    ]
    links = link_detections(in_frames(*scene))
    assert (links.tracks, links.ambiguous, links.short) == (1, 0, 0)
    assert {row.label for row in links.rows} == {0 if first_score > 0.8 else 1}
    assert len(links.rows) == 8


def test_a_duplicate_does_not_take_others_with_it():
    """Of three boxes in a row the middle one goes; the outer two do not overlap enough to be one object."""
    boxes = [[0, 0, 20, 20], [4, 0, 24, 20], [8, 0, 28, 20]]
    scene = [make_detections(boxes, scores=[0.9, 0.8, 0.7])] * 6
    links = link_detections(in_frames(*scene))
    assert all(row.xyxy[0] != 4 for row in links.rows)
    assert links.ambiguous > 0


def test_every_third_frame_is_as_good_as_every_frame():
    scene = [(3 * n, 0.3 * n, make_detections([moving(0, 2, n)])) for n in range(6)]
    links = link_detections(scene)
    assert links.tracks == 1
    assert [row.frame for row in links.rows] == [0, 3, 6, 9, 12, 15]


def test_the_same_input_gives_the_same_tracks():
    rng = np.random.default_rng(2)
    scene = in_frames(*[make_detections(np.add([[0, 0, 30, 30]] * 6, rng.uniform(0, 90, (6, 1)))) for _ in range(9)])
    assert boxes_by_track(link_detections(scene)) == boxes_by_track(link_detections(iter(scene)))
