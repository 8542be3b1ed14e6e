"""Which detections are trusted, and what that is good for."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.structures import NO_ID
from lookonce.tracking import DefaultConfig, MotionConfig, Tracker, default
from lookonce.tracking.candidates import Frame, Pairs
from lookonce.tracking.doubt import own_shares
from lookonce.tracking.motion import box_states
from lookonce.tracking.overlapping import overlaps_of
from tracking.moving import ids_of, seen

NEAR, APART = 0.4, 0.05  # overlaps
ALL = np.ones(3, np.bool_)


def _frame(object_of):
    count = len(object_of)
    xyxy, yes = np.tile([0.0, 0.0, 20.0, 40.0], (count, 1)), np.ones(count, np.bool_)
    scores, labels = np.full(count, 0.9), np.zeros(count, np.int64)
    overlaps = overlaps_of(xyxy, 0.99)
    taken = np.array(object_of, np.int64)
    states = box_states(xyxy)
    whole = (0.0, 0.0, 100.0, 100.0)
    return Frame(
        xyxy, states, scores, labels, None, yes, yes, overlaps, whole, taken, ~yes, ~yes, xyxy.astype(np.float32)
    )


def _pairs(object_of, rows):
    """Pairs from ``(object, row, gain, overlap)`` of three objects."""
    objects, numbers, gains, overlap = (np.array(column) for column in zip(*rows, strict=True))
    is_taken = np.isin(np.arange(3), object_of)
    return Pairs(objects, numbers, gains, overlap, gains, np.zeros(len(rows), np.bool_), np.zeros((4, 3)), is_taken)


def _shares(object_of, rows, may_be=ALL):
    return own_shares(_frame(object_of), _pairs(object_of, rows), may_be)


@pytest.mark.parametrize(("lead", "share"), [(0.0, 0.5), (np.log(3.0), 0.75), (-5.0, 0.5), (300.0, 1.0)])
def test_an_unseen_object_near_by_may_be_the_one_that_is_shown(lead, share):
    """By the ratio of the likelihoods, but it never counts for more than the object that was chosen."""
    np.testing.assert_allclose(_shares([0], [(0, 0, lead, NEAR), (1, 0, 0.0, NEAR)]), [share])


def test_two_unseen_objects_count_twice():
    np.testing.assert_allclose(_shares([1], [(0, 0, 2.0, NEAR), (1, 0, 2.0, NEAR), (2, 0, 2.0, NEAR)]), [1 / 3])


def test_two_objects_may_have_each_others_boxes():
    """The exchange loses 1 + 2 of 3 + 2: a ratio of exp(-2)."""
    rows = [(0, 0, 3.0, NEAR), (0, 1, 1.0, NEAR), (1, 0, 2.0, NEAR), (1, 1, 2.0, NEAR)]
    np.testing.assert_allclose(_shares([0, 1], rows), np.full(2, 1 / (1 + np.exp(-2))))


def test_an_exchange_needs_both_pairs():
    np.testing.assert_allclose(_shares([0, 1], [(0, 0, 3.0, NEAR), (1, 0, 2.0, NEAR), (1, 1, 2.0, NEAR)]), 1.0)


def test_a_pair_that_the_place_rules_out_is_no_rival_and_no_error():
    rows = [(0, 0, -np.inf, NEAR), (0, 1, -np.inf, NEAR), (1, 0, -np.inf, NEAR), (1, 1, 2.0, NEAR)]
    shares = _shares([0, 1], rows)
    assert ((shares >= 0.5) & (shares <= 1)).all()
    assert shares[1] == 1


@pytest.mark.parametrize(
    "given",
    [
        ([0], [(0, 0, 2.0, NEAR)], ALL),
        ([0], [(0, 0, 2.0, NEAR), (1, 0, 2.0, APART)], ALL),
        ([0], [(0, 0, 2.0, NEAR), (1, 0, 2.0, NEAR)], ~ALL),
        ([NO_ID], [(0, 0, 2.0, NEAR), (1, 0, 2.0, NEAR)], ALL),
    ],
    ids=["alone", "apart", "may not be", "nobody's"],
)
def test_without_rivals_there_is_no_doubt(given):
    assert _shares(*given) is None


def _passing(seed):
    """A person passes one who stands; while they are within 22 px, there is one box half way between."""
    rng, frames = np.random.default_rng(seed), []
    speed = rng.uniform(3, 6)
    for number in range(30):
        one, other = 100 + speed * (number - 15), 100
        places = [one, other] if abs(one - other) >= 22 else [(one + other) / 2]
        frames.append(seen(*[(x + rng.normal(0, 2), 100 + rng.normal(0, 2)) for x in places]))
    return frames


def test_who_passes_another_keeps_its_identity_through_boxes_of_both():
    kept = {}
    for doubt in (0.0, 2.0):
        config = DefaultConfig(appearance=False, motion=MotionConfig(doubt=doubt))
        answers = [ids_of(_passing(seed), config, [number / 7 for number in range(30)]) for seed in range(60)]
        kept[doubt] = sum(ids[2] == ids[-1] == [1, 2] or ids[2] == ids[-1] == [2, 1] for ids in answers)
    assert kept[2.0] >= max(56, kept[0.0] + 3)


def _after(*frames, preset=None):
    """The filters of the first object after the frames, 0.1 s apart."""
    tracker = Tracker(preset or DefaultConfig(appearance=False))
    for number, frame in enumerate(frames):
        tracker.update(frame, number / 10)
    return tracker._rule.objects.motions.values[:, 0]


def test_a_doubtful_box_moves_its_object_less_wherever_its_row_stands():
    """Two meet; before the one box that is left lies a row that is too weak for anybody."""
    meeting = [seen((100 + number, 100), (120 - number, 100)) for number in range(6)]
    alone = _after(*meeting, seen((112, 100)))
    led = _after(*meeting, seen((500, 100), (112, 100), scores=[0.05, 0.9]))
    trusted = _after(*meeting, seen((112, 100)), preset=DefaultConfig(appearance=False, motion=MotionConfig(doubt=0.0)))
    np.testing.assert_array_equal(led, alone)
    assert not np.allclose(alone, trusted)


def test_only_who_is_confirmed_and_was_seen_lately_casts_doubt(monkeypatch):
    """Of four one is there, one not sure enough, one was last seen before two frames, one half a second ago."""
    given = []
    monkeypatch.setattr(default, "own_shares", lambda frame, pairs, may_be: given.append(may_be.tolist()))
    config = DefaultConfig(appearance=False, recent_s=0.3)
    places = (100, 100), (300, 100), (500, 100), (700, 100)
    frames = [seen(*places, scores=[0.9, 0.3, 0.9, 0.9])] * 3
    frames += [seen(*places[:3], scores=[0.9, 0.3, 0.9])] * 3 + [seen(*places[:2], scores=[0.9, 0.3])] * 2
    _after(*frames, preset=config)
    assert given[-1] == [True, True, False, False]
