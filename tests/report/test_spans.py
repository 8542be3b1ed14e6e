"""Timelines: what bars are drawn."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lookonce.evaluation import TrackingResult
from lookonce.evaluation.tracking.following import follow
from lookonce.report.spans import COLOURS, Clock, Span, identity_lanes, object_rows
from report.scenes import boxes, make_result, make_truth


def rows_of(truth, result, names=None):
    return object_rows(truth, result, follow(truth, result), names or {})


def test_a_bar_ends_where_the_identity_changes_or_the_object_is_missed():
    truth = make_truth({1: [0, 1, 2, 3, 4, 5], 2: [2, 5]}, 6)
    result = make_result([(0, 9, 1), (1, 9, 1), (3, 9, 1), (4, 5, 1), (5, 5, 1), (5, 9, 2)])
    timeline = rows_of(truth, result, {1: "car"})
    first, second = timeline.rows
    assert (first.name, first.label, first.boxes, first.found, first.identities) == ("1", "car", 6, 5, 2)
    assert first.spans == (Span(0, 1, 9), Span(2, 2, -1), Span(3, 3, 9), Span(4, 5, 5))
    assert second.spans == (Span(2, 2, -1), Span(5, 5, 9))  # absent between: no span
    assert timeline.colours[9] != timeline.colours[5]


def test_objects_stand_in_the_order_of_their_first_frame():
    truth = make_truth({1: [4, 5], 2: [0], 12: [0]}, 6)
    assert [row.name for row in rows_of(truth, make_result([])).rows] == ["2", "12", "1"]


def test_long_sequences_are_drawn_in_steps_and_many_objects_are_counted():
    frames = 5000
    truth = make_truth({1: list(range(frames))}, frames)
    result = make_result([(frame, 1 + frame % 2, 1) for frame in range(frames)])
    timeline = rows_of(truth, result)
    assert timeline.step == 7
    assert len(timeline.rows[0].spans) <= timeline.steps <= 800
    assert (timeline.first_frame(1), timeline.last_frame(1), timeline.last_frame(timeline.steps - 1)) == (7, 13, 4999)
    assert timeline.rows[0].identities == 2  # counted before anything is drawn as one
    many = make_truth({one: [0, 1] if one == 170 else [0] for one in range(1, 181)}, 2)
    timeline = rows_of(many, make_result([]))
    assert (len(timeline.rows), timeline.left_out) == (150, 30)
    assert "170" in [row.name for row in timeline.rows]


def test_lanes_hold_all_identities_and_no_two_at_once():
    rng = np.random.default_rng(3)
    rows = []
    for identity in range(1, 60):
        start = int(rng.integers(0, 80))
        rows += [(frame, identity, 1) for frame in range(start, start + int(rng.integers(1, 30)))]
    result = make_result(rows)
    timeline = identity_lanes(np.arange(120), result)
    spans = [span for row in timeline.rows for span in row.spans]
    assert sorted(span.id for span in spans) == list(range(1, 60))
    assert sum(span.last - span.first + 1 for span in spans) == len(result)
    for row in timeline.rows:
        assert all(a.last + 1 < b.first for a, b in pairwise(row.spans))
    most = int(np.bincount(result.row_frames).max())
    assert len(timeline.rows) <= most + 3


def test_identities_beside_each_other_have_different_colours():
    rows = [(frame, 1 + frame, 1) for frame in range(40)]
    timeline = identity_lanes(np.arange(40), make_result(rows), [(1, 30)])
    order = [timeline.colours[1 + frame] for frame in range(0, 40, 2)]
    assert all(a != b for a, b in pairwise(order))
    assert timeline.colours[1] != timeline.colours[30]
    assert set(timeline.colours.values()) == set(range(COLOURS))


def test_nothing_is_a_timeline_too():
    none = make_result([])
    assert identity_lanes(np.zeros(0, np.int64), none).rows == ()
    assert rows_of(make_truth({}, 0), none).steps == 1
    single = TrackingResult(np.array([4]), np.array([2]), boxes([3.0]), np.array([0]))
    assert identity_lanes(np.zeros(0, np.int64), single).rows[0].spans == (Span(0, 0, 2),)


def test_clock_prefers_what_is_stated():
    clock = Clock({4: 9.5}, 10.0)
    assert (clock.seconds(4), clock.seconds(5), Clock({}).seconds(5)) == (9.5, 0.5, None)
