"""Switches: those of the figures, and what they mean; doubts where there is no truth."""

from __future__ import annotations

import pytest

from evaluation.tracking.trackeval_oracle import random_frames, values_of
from lookonce.evaluation import evaluate_tracking
from lookonce.evaluation.tracking.following import follow
from lookonce.report.doubts import breaks_of, doubts_of
from lookonce.report.explained import Candidate, Ending, ExplainedRow, Explanation
from lookonce.report.spans import Clock
from lookonce.report.switches import find_switches, reasons_of
from report.scenes import explained, make_result, make_truth


def switches_of(truth, result, protocol="trackeval"):
    return find_switches(truth, result, follow(truth, result, protocol))


@pytest.mark.parametrize(
    ("rows", "kinds"),
    [
        pytest.param([(0, 5, 1), (1, 6, 1)], [("new", None)], id="new"),
        pytest.param([(0, 5, 1), (1, 6, 1), (2, 5, 1)], [("new", None), ("back", None)], id="back"),
        pytest.param([(0, 5, 1), (0, 6, 2), (1, 6, 1)], [("taken", 2)], id="taken"),
        pytest.param([(0, 5, 1), (0, 6, 2), (1, 6, 1), (1, 5, 2)], [("swapped", 2), ("swapped", 1)], id="swapped"),
        pytest.param([(0, 5, 1), (0, 6, 5.5), (1, 6, 1)], [("stray", None)], id="stray"),
        pytest.param([(0, 5, 1), (2, 5, 1)], [], id="none"),
    ],
)
def test_kinds(rows, kinds):
    found = switches_of(make_truth({1: [0, 1, 2], 2: [0, 1, 2]}, 3), make_result(rows))
    assert [(one.kind, one.other) for one in found] == kinds


def test_what_lies_between_is_missed_or_absent():
    truth = make_truth({1: [0, 1, 2, 5, 6]}, 8)
    (one,) = switches_of(truth, make_result([(0, 5, 1), (6, 8, 1)]))
    assert (one.frame_before, one.frame, one.old_id, one.new_id) == (0, 6, 5, 8)
    assert (one.missed, one.absent) == (3, 2)
    assert one.xyxy_before.tolist() == one.xyxy.tolist() == [40, 1, 50, 11]


@pytest.mark.parametrize("protocol", ["trackeval", "detrac"])
def test_as_many_as_the_figures_count(protocol):
    total = 0
    for seed in range(80):
        truth, result = values_of(random_frames(seed))
        scores = evaluate_tracking(truth, result, protocol)
        found = switches_of(truth, result, protocol)
        assert len(found) == (scores.id_switches if protocol == "detrac" else scores.clear.id_switches)
        assert all(one.old_id != one.new_id and one.frame_before < one.frame for one in found)
        assert [one.frame for one in found] == sorted(one.frame for one in found)
        total += len(found)
    assert total > 20


def test_reasons_name_decision_old_identity_and_its_end():
    (switch,) = switches_of(make_truth({1: [0, 1, 2]}, 3), make_result([(0, 5, 1), (2, 8, 1)]))
    old = Candidate(5, cost=0.81, distance=1.2, unseen_s=0.0, refused="too far in appearance")
    told = explained(2, 8, "new", old, reason="nothing fits")
    told = Explanation(told.rows, {}, {5: (Ending(1, "left the picture"),), 8: (Ending(2, "no"),)})
    assert reasons_of(switch, told) == (
        "new: nothing fits",
        "Identity 5 was considered (cost 0.81, descriptor distance 1.2) and refused: too far in appearance.",
        "Identity 5 had ended at frame 1: left the picture.",
    )
    other = explained(2, 8, "kept", Candidate(8, overlap=0.5))
    assert reasons_of(switch, other) == (
        "kept",
        "Identity 8 was chosen (overlap 0.5).",
        "Identity 5 was not considered for it.",
    )
    assert reasons_of(switch, Explanation({})) == ()
    waiting = ExplainedRow(None, (40.004, 1.0, 50.0, 11.0), "waiting", "seen once", ())
    elsewhere = ExplainedRow(None, (0.0, 1.0, 10.0, 11.0), "weak", "", ())
    assert reasons_of(switch, Explanation({2: (elsewhere, waiting)})) == (
        "waiting: seen once",
        "It got identity 8 only later.",
        "Identity 5 was not considered for it.",
    )


def test_doubts_are_close_decisions_and_new_objects_that_may_be_old():
    close = explained(
        3, 1, "kept", Candidate(1, cost=0.5), Candidate(2, cost=0.55), Candidate(3, cost=0.1, refused="x")
    )
    (one,) = doubts_of(close)
    assert (one.frame, one.id, one.other, one.is_new) == (3, 1, 2, False)
    assert one.margin == pytest.approx(0.05)
    (one,) = doubts_of(explained(4, 9, "new", Candidate(2, cost=0.7, refused="too far")))
    assert (one.id, one.other, one.is_new) == (9, 2, True)
    assert "too far" in one.text
    row = explained(4, 9, "new", Candidate(2, cost=0.7, refused="taken")).rows[4][0]
    assert doubts_of(Explanation({4: (row, ExplainedRow(2, None, "kept", "", ()))})) == ()  # the old one went on
    assert doubts_of(explained(4, 9, "new")) == ()
    assert doubts_of(explained(4, None, "weak", Candidate(2, cost=0.1))) == ()
    assert doubts_of(explained(3, 1, "kept", Candidate(1, cost=0.5))) == ()


def test_doubts_about_the_same_two_are_told_once():
    rows = {}
    for frame in range(60):
        first, second = (1, 2) if frame % 2 else (2, 1)
        candidates = Candidate(first, cost=0.5), Candidate(second, cost=0.6 - 0.001 * frame)
        rows |= explained(frame, first, "kept", *candidates).rows
    assert [one.frame for one in doubts_of(Explanation(rows))] == [59, 34, 9]


def test_breaks_are_identities_that_begin_where_another_has_just_ended():
    rows = [(0, 5, 1), (1, 5, 1), (4, 6, 1.1), (4, 7, 3), (40, 8, 1)]
    (one,) = breaks_of(make_result(rows), Clock({}))
    assert (one.frame, one.id, one.other) == (4, 6, 5)
    assert "3 frames earlier" in one.text
    assert breaks_of(make_result(rows), Clock({}, 2.0)) == ()  # three frames are more than a second then
    assert breaks_of(make_result([]), Clock({})) == ()
    assert breaks_of(make_result([(0, 5, 1), (1, 5, 1), (1, 6, 1)]), Clock({})) == ()  # 5 goes on
