"""What the tracker says of its decisions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lookonce import ConfigError, Detections
from lookonce.tracking import DefaultConfig, MotionConfig, Tracker, default
from lookonce.tracking.doubt import own_shares
from tracking.test_state import crowd


def boxes(*rows: tuple[float, float, float], size: int = 20) -> Detections:
    """Rows ``left top score`` of one size and class, without descriptors."""
    values = np.array(rows, np.float32).reshape(-1, 3)
    xyxy = np.concatenate([values[:, :2], values[:, :2] + [size, 2 * size]], axis=1).astype(np.float32)
    return Detections(xyxy, values[:, 2].copy(), np.zeros(len(values), np.int64))


def decisions(tracker: Tracker, detections: Detections, time_s: float) -> list[str]:
    story = tracker.update(detections, time_s).story
    assert story is not None
    return [row.decision for row in story.rows]


def test_the_life_of_an_object_in_decisions() -> None:
    tracker = Tracker(explain=True)
    assert decisions(tracker, boxes((100, 100, 0.9)), 0.0) == ["new"]
    assert decisions(tracker, boxes((102, 100, 0.9)), 0.1) == ["confirmed"]
    assert decisions(tracker, boxes((104, 100, 0.9), (105, 101, 0.5), (300, 100, 0.05)), 0.2) == [
        "kept",
        "duplicate",
        "weak",
    ]
    assert decisions(tracker, boxes(), 0.3) == []
    assert decisions(tracker, boxes((108, 100, 0.9), (300, 100, 0.15)), 0.4) == ["refound", "weak"]
    for number in range(1, 101):
        story = tracker.update(boxes(), 0.4 + number / 10).story
        if story.ended:
            break
    assert [(one.id, one.why) for one in story.ended] == [(1, "not seen for 8.1 s")]


def test_identities_that_end_with_a_gap_are_told() -> None:
    tracker = Tracker(explain=True)
    for number in range(3):
        tracker.update(boxes((100, 100, 0.9)), number / 10)
    story = tracker.update(boxes(), 60.0).story
    assert [(one.id, one.why) for one in story.ended] == [(1, "nothing came for 59.8 s")]


def test_a_row_of_low_score_waits_while_it_stands_still() -> None:
    tracker = Tracker(explain=True)
    found = [decisions(tracker, boxes((100, 100, 0.4)), number / 10) for number in range(6)]
    assert found == [["new"]] + [["waiting"]] * 5


def test_refusals_name_the_gate() -> None:
    tracker = Tracker(explain=True)
    for number in range(4):
        tracker.update(boxes((100, 100, 0.9), (150, 100, 0.9)), number / 10)
    story = tracker.update(boxes((100, 100, 0.9), (125, 100, 0.2)), 0.4).story
    by_id = {one.id: one.refused for one in story.rows[1].candidates}
    assert by_id
    assert all("has to overlap" in refused for refused in by_id.values())


def test_who_is_not_believed_any_more_keeps_the_id_in_the_story() -> None:
    tracker = Tracker(explain=True)
    for number in range(60):
        tracker.update(boxes((100, 100, 0.9)), number / 10)
    for number in range(60, 120):
        tracks = tracker.update(boxes((100, 100, 0.25)), number / 10)
        if tracks.ids[0] == -1:
            break
    (row,) = tracks.story.rows
    assert row.decision == "waiting"
    assert "continues id 1, which is not believed any more" in row.reason


def test_a_weak_row_on_whom_nobody_has_seen_lately_is_refused_by_name() -> None:
    tracker = Tracker(explain=True)
    for number in range(10):
        tracker.update(boxes((100, 100, 0.9)), number / 10)
    for number in range(10, 42):
        tracker.update(boxes(), number / 10)
    (row,) = tracker.update(boxes((100, 100, 0.3)), 4.2).story.rows
    assert row.candidates[0].refused == "a score of 0.30 is too weak for whom nobody has seen for 2 s"


def test_who_was_missed_once_is_refound_whatever_the_steps() -> None:
    tracker = Tracker(explain=True)
    for number in range(5):
        tracker.update(boxes((100, 100, 0.9)), number * 0.04)
    tracker.update(boxes(), 0.2)
    assert decisions(tracker, boxes((100, 100, 0.9)), 0.3) == ["refound"]


def test_explaining_changes_nothing_and_every_row_has_a_story() -> None:
    quiet, loud = Tracker(), Tracker(explain=True)
    for number, detections in enumerate(crowd(30)):
        ours, theirs = quiet.update(detections, number / 10), loud.update(detections, number / 10)
        assert ours.ids.tolist() == theirs.ids.tolist()
        assert ours.story is None
        assert [row.row for row in theirs.story.rows] == list(range(len(detections)))
        for row, identity in zip(theirs.story.rows, theirs.ids.tolist(), strict=True):
            assert (row.decision in ("kept", "refound", "confirmed")) == (identity > 0)
            gains = [one.gain for one in row.candidates if one.gain is not None]
            assert len(row.candidates) <= 8
            assert gains[1:] == sorted(gains[1:], reverse=True)


def test_the_preset_paper_cannot() -> None:
    with pytest.raises(ConfigError, match="paper"):
        Tracker("paper", explain=True)


def test_a_box_that_may_be_of_another_is_told() -> None:
    """Two meet, and one box is left between them."""
    for doubt in (2.0, 0.0):
        tracker = Tracker(DefaultConfig(appearance=False, motion=MotionConfig(doubt=doubt)), explain=True)
        for number in range(5):
            tracker.update(boxes((100 + number, 100, 0.9), (120 - number, 100, 0.9)), number / 10)
        (row,) = tracker.update(boxes((110, 100, 0.9)), 0.5).story.rows
        assert ("by its place only 50% sure, so it moves the object less" in row.reason) == (doubt > 0)


@pytest.mark.parametrize(("apart", "least", "most", "told"), [(13, 0.9, 0.999, False), (9, 0.65, 0.85, True)])
def test_only_doubts_that_matter_are_told(
    monkeypatch: pytest.MonkeyPatch, apart: int, least: float, most: float, told: bool
) -> None:
    """Of two beside each other one is hidden, farther away or nearer."""
    found: list[NDArray[np.float64]] = []

    def spy(*given: Any) -> NDArray[np.float64] | None:
        shares = own_shares(*given)
        found.append(np.ones(1) if shares is None else shares)
        return shares

    monkeypatch.setattr(default, "own_shares", spy)
    tracker = Tracker("iou", explain=True)
    for number in range(20):
        tracker.update(boxes((100, 100, 0.9), (max(120 - 2 * number, 100 + apart), 100, 0.9)), number / 10)
    (row,) = tracker.update(boxes((100, 100, 0.9)), 2.0).story.rows
    assert least < found[-1][0] < most
    assert ("sure" in row.reason) == told
