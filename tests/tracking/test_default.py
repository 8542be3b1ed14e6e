"""The rule of the preset `default`, a tiny scene for each of its sentences."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lookonce.structures import NO_ID
from lookonce.tracking import DefaultConfig, EvidenceConfig, MotionConfig, Tracker, candidates
from tracking.moving import STEP_S, ids_of, seen
from tracking.scenes import at_angle

LEFT, RIGHT = (100.0, 100.0), (400.0, 100.0)
ONE, OTHER = at_angle(0)[0], at_angle(90)[0]
CONFIG = DefaultConfig(  # the scenes are made for these numbers, whatever the defaults are tuned to
    appearance_weight=3.0,
    low_score=0.1,
    birth_score=0.2,
    high_score=0.4,
    low_overlap=0.4,
    recent_s=0.3,
    clean_overlap=0.4,
    memory_s=8.0,
    evidence=EvidenceConfig(
        hits=2, score=0.7, score_mean_s=0.0, score_memory_s=3.0, travel=0.5, travels=2, travel_memory_s=3.0
    ),
    motion=MotionConfig(
        place_noise=0.12,
        size_noise=0.3,
        acceleration=0.25,
        acceleration_share=0.25,
        new_speed=2.0,
        jump_speed=16.0,
        jump_share=0.3,
    ),
)
BOXES = replace(CONFIG, appearance=False)
CROWD = [
    (x, y) for x in range(-300, 301, 120) for y in range(-300, 301, 120)
]  # who stands in a grid, three boxes apart


def _ids(frames, preset=CONFIG, times=None):
    return ids_of(frames, preset, times)


def _last(frames, preset=CONFIG, times=None):
    return _ids(frames, preset, times)[-1]


def _moving(frames, speed=4.0, start=LEFT, **fields):
    """An object that moves right, beside one that stands still far away."""
    return [seen((start[0] + speed * number, start[1]), (900, 100), **fields) for number in range(frames)]


# --- keeping an object -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", ["default", "iou"])
def test_objects_that_overlap_from_frame_to_frame_keep_their_ids(preset):
    assert _ids([seen((100 + 3 * n, 100), (300 - 5 * n, 200)) for n in range(6)], preset) == [[1, 2]] * 6


def test_fast_object_is_followed_although_its_boxes_never_overlap():
    """15 px a frame, then 30: a box is 20 px wide."""
    assert _ids(_moving(8, speed=15)) == [[1, 2]] * 8
    assert _ids(_moving(8, speed=22)) == [[1, 2]] * 8


@pytest.mark.parametrize("preset", ["default", "iou"])
@pytest.mark.parametrize("gap_s", [0.2, 1.0, 2.0])
def test_moving_object_is_kept_through_a_gap(preset, gap_s):
    """It comes back where its speed says, up to two seconds and 2.5 boxes later."""
    before, gone = 12, round(gap_s / STEP_S)
    frames = [*_moving(before, 2.0), *[seen((900, 100))] * gone, _moving(before + gone + 1, 2.0)[-1]]
    answers = _ids(frames, preset)
    assert answers[-1] == [1, 2]
    assert answers[before : before + gone] == [[2]] * gone


def test_unseen_object_is_told_with_its_expected_box():
    tracker = Tracker(CONFIG)
    for number, frame in enumerate([*_moving(12, 2.0), seen((900, 100)), seen((900, 100))]):
        tracks = tracker.update(frame, number * STEP_S)
        assert tracks.unseen_ids.tolist() == ([1] if number >= 12 else [])
    np.testing.assert_allclose(tracks.unseen_xyxy, [[116, 80, 136, 120]], atol=1.5)


def test_object_unseen_for_longer_than_the_memory_is_a_new_one():
    there, away = seen(LEFT, (900, 100), looks=[ONE, OTHER]), seen((900, 100), looks=[OTHER])
    times = [0.0, 0.1, 0.5, 1.0, 1.5, 2.0, 2.05, 2.15, 2.2]
    config = replace(CONFIG, memory_s=2.0)
    assert _ids([there, there, *[away] * 4, there, there, there], config, times)[-3:] == [[1, 2]] * 3
    assert _ids([there, there, *[away] * 6, there, there], config, [*times, 2.3])[-2:] == [[3, 2]] * 2


def test_memory_does_not_depend_on_how_far_apart_the_frames_are():
    """Seen at 0.1 s and again at 13 s: it was found again, because nothing had been looked at after 6 s."""
    there, away = seen(LEFT, (900, 100), looks=[ONE, OTHER]), seen((900, 100), looks=[OTHER])
    assert _last([there, there, away, there, there], times=[0.0, 0.1, 6.0, 13.0, 13.1]) == [3, 2]


def test_appearance_finds_who_is_who_after_a_gap_where_places_would_mislead():
    """Two stand beside each other, are hidden for a second, and have changed places."""
    beside, hidden = [(100, 100), (114, 100)], [seen((500, 100), looks=[[1, 1]])] * 25
    before = [seen(*beside, (500, 100), looks=[ONE, OTHER, [1, 1]])] * 5
    after = seen(*beside, (500, 100), looks=[OTHER, ONE, [1, 1]])
    assert _last([*before, *hidden, after]) == [2, 1, 3]
    assert _last([*before, *hidden, after], BOXES) == [1, 2, 3]


def test_object_is_found_again_by_any_of_its_views():
    """Seen from the front, then from behind; two come, as near to its place, of which one looks as it did at first."""
    views = [0, 0, 0, 0, 120, 120, 120, 120]
    times = [*(0.3 * number for number in range(len(views))), 5.0, 5.1]
    before = [seen(LEFT, (900, 100), looks=[*at_angle(angle), OTHER]) for angle in views]
    after = seen((88, 100), (112, 100), (900, 100), looks=[*at_angle(-100, 0), OTHER])
    assert _last([*before, after, after], times=times) == [3, 1, 2]
    assert _last([*before, after, after], replace(CONFIG, views=0), times) != [3, 1, 2]


def test_appearance_is_not_asked_where_boxes_are_safe():
    """One box over the other and nobody near: whatever the descriptors say."""
    frames = [seen(LEFT, RIGHT, looks=[ONE, OTHER]), seen(LEFT, RIGHT, looks=[OTHER, ONE])] * 3
    assert _ids(frames) == [[1, 2]] * 6


def test_appearance_alone_cannot_make_an_object_jump_across_the_picture():
    assert _ids([seen(LEFT, looks=[ONE])] * 3 + [seen((2000, 100), looks=[ONE])] * 2) == [[1]] * 3 + [[2]] * 2


@pytest.mark.parametrize("step_s", [1.2, 2.0, 4.0])
@pytest.mark.parametrize(("preset", "looks"), [(CONFIG, [ONE, OTHER]), (CONFIG, None), (BOXES, None)])
def test_objects_are_followed_at_any_frame_rate(preset, looks, step_s):
    """One walks half a box a second, another stands; the filters soon are wider than the crowd."""
    places = [((100 + 20 * step_s * n, 100), (500, 300)) for n in range(6)]
    frames = [seen(*two, looks=looks) for two in places]
    assert _ids(frames, preset, [step_s * n for n in range(6)]) == [[1, 2]] * 6


@pytest.mark.parametrize(("step_s", "limit", "followed"), [(1.2, 1.4, True), (4.0, 1.4, True), (4.0, 10.0, False)])
def test_in_a_crowd_too_objects_are_followed_at_any_frame_rate(step_s, limit, followed):
    """One walks between those who stand: there somebody else could be as near, and the place has to have a limit."""
    frames = [seen((-200 + 20 * step_s * n, 0), *CROWD) for n in range(6)]
    answers = _ids(frames, replace(BOXES, place_limit=limit), [step_s * n for n in range(6)])
    assert [ids[0] for ids in answers] == [1 if followed else NO_ID] * 6


@pytest.mark.parametrize("looks", [[ONE, OTHER], None])
@pytest.mark.parametrize(("step_s", "boxes"), [(0.04, 1.0), (0.25, 2.0), (0.25, 4.0), (1.0, 6.0)])
def test_who_is_alone_may_be_as_fast_as_it_likes(looks, step_s, boxes):
    """From the second frame on, and when it is missed; in a crowd that would be anybody."""
    frames = [seen((100 + 40 * boxes * n, 100), (9000, 100), looks=looks) for n in range(9)]
    frames[6] = seen((9000, 100), looks=None if looks is None else looks[1:])
    answers = _ids(frames, CONFIG, [step_s * n for n in range(9)])
    assert answers == [*[[1, 2]] * 6, [2], *[[1, 2]] * 2]
    if step_s == 0.25:
        crowd = [seen((-250 + 40 * boxes * n, 0), *CROWD) for n in range(3)]
        assert _last(crowd, CONFIG, [step_s * n for n in range(3)])[0] == NO_ID


def test_the_story_says_that_another_speed_was_believed():
    tracker = Tracker(BOXES, explain=True)
    for number in range(3):
        row = tracker.update(seen((100 + 70 * number, 100), (9000, 100)), number / 4).story.rows[0]
        assert ("at another speed than was believed" in row.reason) == (number == 1)


def test_room_is_that_of_the_others_in_the_picture_and_of_one_in_all():
    """A square of 200 px around (50, 500), of which the left quarter is outside the picture."""
    border = (0.0, 0.0, 1000.0, 1000.0)

    def room(count, x=50.0):
        place, reach, side = np.array([[x], [500.0]]), np.full(1, 100.0), np.full(1, 10.0)
        return candidates._rooms(place, reach, side, np.array([count]), border)[0]

    assert room(1) == pytest.approx(200 * 200)
    assert room(4) == pytest.approx(1 / (3 / (150 * 200) + 1 / (200 * 200)))
    assert room(4, 950.0) == pytest.approx(room(4))
    assert room(4, 5000.0) == pytest.approx(1 / (3 / (10 * 200) + 1 / (200 * 200)))  # at least as wide as a box


def test_only_a_picture_of_many_can_be_full():
    """Few rows do not say how large their picture is."""
    usable = np.ones(101, np.bool_)
    frame = SimpleNamespace(is_usable=usable, border=(0.0, 0.0, 1010.0, 500.0))
    assert candidates._room_in(frame) == pytest.approx(5000)
    usable[:1] = False
    assert candidates._room_in(frame) == np.inf


def test_what_comes_and_goes_in_an_empty_picture_makes_no_identities():
    """Without descriptors, one detection in two frames, anywhere."""
    rng, given, count = np.random.default_rng(0), 0, 0
    for step_s in (0.04, 0.25, 1.0):
        frames = [seen(*rng.uniform(0, 800, (rng.poisson(0.5), 2)), scores=0.5) for _ in range(200)]
        answers = _ids(frames, DefaultConfig(appearance=False), [step_s * n for n in range(200)])
        given += sum(identity != NO_ID for ids in answers for identity in ids)
        count += sum(len(ids) for ids in answers)
    assert given < 0.04 * count


@pytest.mark.parametrize("looks", [[ONE, OTHER], None])
def test_who_turns_round_between_two_frames_is_followed(looks):
    """Eight frames to the right, then to the left, 0.7 boxes a second, at one frame a second."""
    way = [28 * min(n, 16 - n) for n in range(16)]
    frames = [seen((100 + x, 100), (900, 100), looks=looks) for x in way]
    times = [float(n) for n in range(16)]
    assert _ids(frames, CONFIG, times) == [[1, 2]] * 16
    steady = replace(CONFIG, motion=replace(CONFIG.motion, turn_share=0.0, alone_speed=0.0))
    assert _last(frames, steady, times)[0] != 1


def test_who_swings_is_followed():
    """Two boxes to each side in three seconds, at eight frames a second: as fast as runners turn."""
    times = [0.12 * n for n in range(60)]
    frames = [seen((200 + 80 * np.sin(2 * np.pi * t / 3), 100), (900, 100)) for t in times]
    assert _ids(frames, BOXES, times) == [[1, 2]] * 60
    stiff = replace(BOXES, motion=replace(CONFIG.motion, lag=1e6, turn_share=0.0, alone_speed=0.0))
    assert _last(frames, stiff, times)[0] != 1


@pytest.mark.parametrize("size", [(20, 40), (40, 20), (100, 12), (12, 100)])
def test_objects_of_any_shape_are_followed(size):
    """Boxes that err by a tenth of their width and height, ten frames a second: people, cars, fish."""
    rng, frames = np.random.default_rng(0), []
    for number in range(40):
        places = [(100 + 0.05 * max(size) * number, 100), (100, 600), (900 - 0.1 * max(size) * number, 300)]
        frames.append(seen(*(np.array(places) + rng.normal(0, 0.1, (3, 2)) * size), size=size))
    answers = _ids(frames, BOXES, [number / 10 for number in range(40)])
    assert answers == [[1, 2, 3]] * 40


def test_nobody_is_looked_for_farther_away_than_twelve_boxes():
    """Even with the same look, and however wide the filter."""
    config = replace(CONFIG, appearance_weight=6.0)
    for way, found in ((450, 1), (500, NO_ID)):
        frames = [seen((x, 100), looks=[ONE]) for x in (100, 100, 100 + way)]
        assert _last(frames, config, [0.0, 0.1, 7.5]) == [found]


def test_a_row_without_descriptor_is_matched_by_its_place_among_others_that_have_one():
    """Two in a crowd were seen once, a second before and a box away; the first has no descriptor."""
    frames = [seen((x, 0), (x, 120), *CROWD, looks=[[0, 0], ONE, *[OTHER] * len(CROWD)]) for x in (0, 40)]
    assert _last(frames, CONFIG, [0.0, 1.0])[:2] == [1, 2]
    assert _last(frames, replace(CONFIG, appearance_absent=0.0), [0.0, 1.0])[:2] == [NO_ID, 1]


def test_what_a_missing_descriptor_is_worth_is_not_bounded_by_looks():
    """Two seconds after it was seen once, in a crowd, the place says no by more than 2."""
    frames = [seen((x, 0), *CROWD, looks=[[0, 0], *[ONE] * len(CROWD)]) for x in (0, 40)]
    for absent, found in ((1.0, NO_ID), (5.0, 1)):
        config = replace(CONFIG, place_limit=10.0, appearance_limit=1.0, appearance_absent=absent)
        assert _last(frames, config, [0.0, 2.0])[0] == found


def test_the_story_counts_what_a_missing_descriptor_is_worth():
    gains = []
    for absent in (0.5, 2.0):
        tracker = Tracker(replace(BOXES, appearance_absent=absent), explain=True)
        for number in range(2):
            story = tracker.update(seen(LEFT), number * STEP_S).story
        gains.append(story.rows[0].candidates[0].gain)
    assert gains[1] - gains[0] == pytest.approx(1.5)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "config",
    [
        replace(BOXES, safe_overlap=0.0),
        replace(CONFIG, appearance_weight=0.0),
        replace(BOXES, motion=replace(CONFIG.motion, jump_speed=0.0)),
        replace(BOXES, motion=replace(CONFIG.motion, doubt=20.0)),
        replace(CONFIG, place_limit=0.0, appearance_absent=0.0),
    ],
)
def test_settings_at_their_ends_are_no_error(config):
    """A pile of boxes, of which half have a descriptor."""
    rng, tracker = np.random.default_rng(0), Tracker(config)
    looks = rng.normal(size=(30, 4)) * (np.arange(30) % 2)[:, np.newaxis]
    for number in range(12):
        places = rng.uniform(100, 160, (30, 2))
        ids = tracker.update(seen(*places, looks=looks), number / 5).ids
        assert len(set(ids[ids > 0])) == (ids > 0).sum()


def test_in_a_crowd_without_end_only_boxes_that_overlap_are_looked_at(monkeypatch):
    """200 stand and 200 walk on by two boxes in four seconds; the pairs in reach would be too many."""
    grid = np.stack(np.meshgrid(np.arange(20), np.arange(20)), axis=-1).reshape(-1, 2) * 100.0
    walks = np.arange(400) % 2 == 1
    frames = [seen(*(grid + np.outer(walks, (80 * number, 0)))) for number in range(3)]
    everybody = list(range(1, 401))
    assert _last(frames, BOXES, [0.0, 4.0, 8.0]) == everybody
    monkeypatch.setattr(candidates, "_MOST_PAIRS", 1000)
    named = np.array(_last(frames, BOXES, [0.0, 4.0, 8.0])) != NO_ID
    np.testing.assert_array_equal(named, ~walks)


def test_a_guess_without_descriptors_is_better_than_a_new_identity():
    """A second after it was seen once, one box on, in a crowd."""
    frames = [seen((x, 0), *CROWD) for x in (0, 40)]
    assert _last(frames, BOXES, [0.0, 1.0])[0] == 1
    assert _last(frames, replace(BOXES, appearance_absent=0.0), [0.0, 1.0])[0] == NO_ID


def test_another_class_speaks_against_an_object():
    """Two neighbours of different classes, seen again after a gap in each other's place, without descriptors."""
    before, away = seen((100, 100), (112, 100), (900, 100), labels=[0, 1, 2]), seen((900, 100), labels=[2])
    after = seen((100, 100), (112, 100), (900, 100), labels=[1, 0, 2])
    assert _last([*[before] * 4, *[away] * 5, after]) == [2, 1, 3]
    assert _last([*[before] * 4, *[away] * 5, after], replace(CONFIG, class_penalty=0.0)) == [1, 2, 3]


# --- scores ----------------------------------------------------------------------------------------------------------


def test_low_scores_continue_an_object():
    assert _ids([seen(LEFT)] * 3 + [seen(LEFT, scores=0.15)] * 12) == [[1]] * 15


def test_object_of_which_only_low_scores_are_left_waits_until_it_is_sure_again():
    """After a second its rows get no id any more; when the score rises they are given back, with the same id."""
    frames = [*[seen(LEFT)] * 3, *[seen(LEFT, scores=0.15)] * 50]
    tracker = Tracker(CONFIG)
    answers = [tracker.update(frame, number * STEP_S).ids.tolist() for number, frame in enumerate(frames)]
    assert answers[-1] == [NO_ID]
    assert _ids([*frames, *[seen(LEFT, scores=1.0)] * 5]) == [[1]] * 58


def test_low_score_continues_only_where_it_overlaps():
    """Where the object would be by its motion, but with too little overlap: a high score continues, a low one not."""
    before, away = [seen(LEFT, (900, 100))] * 3, [seen((900, 100))] * 3
    assert _last([*before, *away, seen((112, 100), (900, 100), scores=[0.9, 0.9])]) == [1, 2]
    assert _last([*before, *away, seen((112, 100), (900, 100), scores=[0.15, 0.9])]) == [NO_ID, 2]
    assert _last([*before, *away, seen((102, 100), (900, 100), scores=[0.15, 0.9])]) == [1, 2]


def test_low_score_continues_only_what_was_seen_lately():
    before = [seen(LEFT, (900, 100))] * 3
    for unseen, expected in [(6, [1, 2]), (9, [NO_ID, 2])]:  # 0.28 s and 0.4 s since it was seen
        assert _last([*before, *[seen((900, 100))] * unseen, seen(LEFT, (900, 100), scores=[0.2, 0.9])]) == expected


def test_high_scores_choose_first():
    """A low score nearer to the object does not take it from a high one."""
    before = [seen(LEFT, (900, 100))] * 4
    assert _last([*before, seen((101, 100), (109, 100), (900, 100), scores=[0.3, 0.9, 0.9])])[1] == 1


def test_lowest_scores_are_not_looked_at_and_low_ones_begin_nothing():
    assert _ids([seen(LEFT, scores=0.09)] * 30) == [[NO_ID]] * 30
    assert _last([seen(LEFT)] * 3 + [seen(LEFT, scores=0.09)]) == [NO_ID]
    assert _ids([seen(LEFT, scores=0.19)] * 30) == [[NO_ID]] * 30
    tracker = Tracker(CONFIG)
    tracker.update(seen(LEFT, scores=0.19))
    assert len(tracker._rule.objects) == 0


# --- confirming ------------------------------------------------------------------------------------------------------


def test_object_is_confirmed_at_its_second_sight_and_its_first_row_is_given_back():
    tracker = Tracker(CONFIG)
    first = tracker.update(seen((900, 500), LEFT, scores=[0.15, 0.9], labels=[3, 5]), 0.0)
    assert first.ids.tolist() == [NO_ID, NO_ID]
    assert len(first.given_back) == len(tracker.given_back) == 0
    second = tracker.update(seen(LEFT, scores=0.8, labels=5), 0.04)
    back = second.given_back
    assert second.ids.tolist() == [1]
    assert tracker.given_back is back
    assert (back.frames.tolist(), back.rows.tolist(), back.ids.tolist()) == ([0], [1], [1])
    assert (back.labels.tolist(), back.scores.tolist()) == ([5], [np.float32(0.9)])
    assert back.xyxy.tolist() == first.xyxy[1:].tolist()
    assert back.xyxy.dtype == back.scores.dtype == np.float32
    assert len(tracker.update(seen(LEFT, labels=5), 0.08).given_back) == 0


def test_rows_given_back_are_those_of_every_frame_before():
    """Weak at first, at another place in each frame's rows; all of them come back at once."""
    tracker = Tracker(CONFIG)
    for number in range(5):
        others = [(900 + 30 * k, 500) for k in range(number)]  # never usable
        tracks = tracker.update(seen(*others, LEFT, scores=[*[0.05] * number, 0.5]), number * STEP_S)
        assert (tracks.ids == NO_ID).all()
    back = [tracker.update(seen(LEFT, scores=1.0), (5 + n) * STEP_S).given_back for n in range(3)]
    (given,) = [each for each in back if len(each)]
    assert given.ids.tolist() == [1] * len(given)
    assert given.frames.tolist() == list(range(len(given)))
    assert given.rows.tolist()[:5] == [0, 1, 2, 3, 4]


def test_no_more_rows_are_given_back_than_stated():
    tracker = Tracker(replace(CONFIG, given_back_rows=3))
    for number in range(10):
        tracker.update(seen(LEFT, scores=0.5), number * STEP_S)
    given = []
    for number in range(10, 14):
        given += tracker.update(seen(LEFT, scores=1.0), number * STEP_S).given_back.frames.tolist()
    assert len(given) == 3
    assert given == list(range(given[0], given[0] + 3))
    assert given[-1] >= 9


def test_weak_false_positive_is_never_confirmed():
    """Something that stands still at 0.5 for a minute, trembling by a few pixels."""
    rng = np.random.default_rng(0)
    frames = [seen(np.add(LEFT, rng.normal(0, 2, 2)), scores=0.5) for _ in range(1500)]
    assert {identity for answer in _ids(frames) for identity in answer} == {NO_ID}


def test_weak_object_that_moves_is_confirmed():
    answers = _ids([seen((100 + 3 * n, 100), scores=0.45) for n in range(40)])
    assert answers == [[1]] * 40


def test_object_seen_once_is_forgotten_soon():
    """Half a second later nothing is known of it: its first row is not given back."""
    frames = [seen(LEFT, (900, 100)), *[seen((900, 100))] * 15, *[seen(LEFT, (900, 100))] * 2]
    answers = _ids(frames)
    assert answers[0] == [NO_ID, 1]
    assert answers[-1] == [2, 1]


def test_ids_are_given_in_the_order_of_confirmation():
    weak = [seen(LEFT, scores=0.5)] * 3
    strong = [seen(LEFT, RIGHT, scores=[0.5, 0.9])] * 3
    both = [seen(LEFT, RIGHT, scores=1.0)] * 4
    assert _last([*weak, *strong, *both]) == [2, 1]


# --- duplicates and classes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [0, 3, 6])
def test_second_box_of_an_object_makes_no_second_object(shift):
    """Whether it is left out as the same box or only seen as one of a known object."""
    frames = [seen(LEFT)] * 2 + [seen(LEFT, (100 + shift, 100), scores=[0.9, 0.8])] * 10
    assert _ids(frames)[2:] == [[1, NO_ID]] * 10


def test_two_objects_that_begin_as_one_box_each_are_two():
    assert _ids([seen((100, 100), (112, 100))] * 4) == [[1, 2]] * 4


def test_class_is_that_of_the_vote_and_does_not_flicker():
    tracker, labels = Tracker(CONFIG), []
    for number, label in enumerate([0, 0, 0, 1, 0, 1, 0, 0, 1, 0]):
        labels += tracker.update(seen(LEFT, labels=label), number * STEP_S).labels.tolist()
    assert labels[1:] == [0] * 9


def test_wrong_first_class_is_outvoted_and_rows_given_back_have_the_right_one():
    tracker = Tracker(replace(CONFIG, evidence=replace(CONFIG.evidence, hits=4)))
    for number, label in enumerate([7, 3, 3]):
        assert tracker.update(seen(LEFT, labels=label), number * STEP_S).labels.tolist() == [label]
    tracks = tracker.update(seen(LEFT, labels=3), 3 * STEP_S)
    assert tracks.labels.tolist() == [3]
    assert tracks.given_back.labels.tolist() == [3, 3, 3]


# --- leaving ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("others", "size"), [(1, (200, 310)), (1, None), (9, None), (9, (200, 900)), (0, (200, 310))])
@pytest.mark.parametrize("leave_s", [0.5, 100.0])
def test_who_enters_where_another_left_gets_a_new_id(leave_s, others, size):
    """One walks out to the right; somebody enters there 0.7 s later. Whoever left is not waited for.

    Where the border is says the picture's size, or after ten objects where boxes have been.
    """
    standing = [(20.0 + 25 * k, 20.0) for k in range(others)]
    leaving = [seen((240 + 2 * n, 100), *standing) for n in range(31)]
    away, entering = [seen(*standing)] * 16, [seen((304 - 2 * n, 100), *standing) for n in range(5)]
    tracker = Tracker(replace(BOXES, leave_s=leave_s))
    for number, frame in enumerate([*leaving, *away, *entering]):
        ids = tracker.update(frame, number * STEP_S, size=size).ids.tolist()
    has_left = leave_s == 0.5 and (size == (200, 310) or (size is None and others == 9))
    assert ids == [others + 2 if has_left else 1, *range(2, others + 2)]


@pytest.mark.parametrize("size", [None, (480, 640)])
def test_who_hides_alone_in_the_picture_has_not_left(size):
    tracker = Tracker(BOXES)
    walking = [seen((100 + 3 * n, 100)) for n in range(60)]
    for number, frame in enumerate([*walking[:20], *[seen()] * 30, *walking[50:]]):
        tracks = tracker.update(frame, number * STEP_S, size=size)
        assert tracks.unseen_ids.tolist() == ([1] if 20 <= number < 50 else [])
    assert tracks.ids.tolist() == [1]


@pytest.mark.parametrize("size", [(0, 10), (10, -1), (10,), (1, 2, 3)])
def test_size_of_no_picture_is_refused(size):
    with pytest.raises(ValueError, match="size: expected"):
        Tracker(BOXES).update(seen(LEFT), size=size)


# --- camera ----------------------------------------------------------------------------------------------------------


def _panned(with_affine):
    """Three look-alikes in a row, 60 px apart; the camera turns by 55 px a frame, so each lands near the next."""
    tracker, shift, answers = Tracker(CONFIG), np.array([[1.0, 0, 0], [0, 1, 0]]), []
    for number in range(8):
        moved = 0.0 if number < 4 else -55.0 * (number - 3)
        if number >= 4:
            shift[0, 2] = -55.0
        frame = seen(*((500 + 60 * k + moved, 100) for k in range(3)), looks=[ONE] * 3)
        tracks = tracker.update(frame, number * STEP_S, camera=shift.copy() if with_affine else None)
        answers.append(tracks.ids.tolist())
    return answers


def test_ids_are_kept_in_a_panned_picture_with_the_cameras_motion_and_not_without():
    assert _panned(True)[1:] == [[1, 2, 3]] * 7
    assert _panned(False)[1:] != [[1, 2, 3]] * 7


def test_camera_moves_those_who_are_not_seen():
    tracker = Tracker(CONFIG)
    for number in range(5):
        tracker.update(seen(LEFT, RIGHT), number * STEP_S)
    camera = np.array([[1.0, 0, 30], [0, 1, -20]])
    tracks = tracker.update(seen((430, 80)), 5 * STEP_S, camera=camera)
    assert tracks.ids.tolist() == [2]
    np.testing.assert_allclose(tracks.unseen_xyxy, [[120, 60, 140, 100]], atol=1e-3)


def _out_and_back(pans, walks_px=0.0):
    """Ids seen at the end, and what was filled, of one who is out of the picture for 0.6 s.

    The camera turns away and back, and he stands or walks slowly; or the camera stands, and he walks out and back.
    """
    tracker, x, filled = Tracker(CONFIG), 100.0, 0
    for number in range(70):
        turn = 0.0 if number < 20 else -12.0 if number < 36 else 12.0 if number < 52 else 0.0
        x += turn + walks_px * (20 <= number < 36)
        camera = np.array([[1.0, 0, turn], [0, 1, 0]]) if pans else None
        frame = seen((x - 10, 100), looks=[ONE]) if x > 0 else seen()
        tracks = tracker.update(frame, number * STEP_S, camera=camera, size=(480, 640))
        filled += len(tracks.filled.ids)
    return tracks.ids.tolist(), filled


@pytest.mark.parametrize("walks_px", [0.0, -2.0])
def test_whom_the_camera_has_left_behind_is_waited_for(walks_px):
    """Also while it comes back and has moved him less in all than he has gone; while he was out he gets no boxes."""
    assert _out_and_back(True, walks_px) == ([1], 0)


def test_who_has_walked_out_himself_is_another_when_he_comes_back():
    assert _out_and_back(False) == ([2], 0)


@pytest.mark.parametrize("trembles_px", [0.0, 2.0])
def test_who_walks_out_of_a_picture_that_trembles_has_left(trembles_px):
    tracker, unseen = Tracker(CONFIG), []
    for number in range(70):
        way = trembles_px if number % 2 else -trembles_px
        x = 100.0 - 4 * number
        frame = seen((x - 10, 100), looks=[ONE]) if x > 0 else seen()
        camera = np.array([[1.0, 0, way], [0, 1, -way]])
        unseen.append(tracker.update(frame, number * STEP_S, camera=camera, size=(480, 640)).unseen_ids.tolist())
    assert [1] in unseen  # for half a second
    assert unseen[45:] == [[]] * 25


def test_what_the_camera_has_once_moved_does_not_count_when_it_was_seen_since():
    """A pan of 200 px, then it stands; he walks out himself."""
    tracker, unseen, x = Tracker(CONFIG), [], 400.0
    for number in range(110):
        turn = -10.0 if 5 <= number < 25 else 0.0
        x += turn - 4.0 * (number >= 30)
        camera = np.array([[1.0, 0, turn], [0, 1, 0]])
        frame = seen((x - 10, 100), looks=[ONE]) if x > 0 else seen()
        unseen.append(tracker.update(frame, number * STEP_S, camera=camera, size=(480, 640)).unseen_ids.tolist())
    assert [1] in unseen
    assert unseen[-1] == []


def test_whom_the_camera_has_left_and_found_again_may_leave_himself():
    tracker, unseen, x = Tracker(CONFIG), [], 100.0
    for number in range(130):
        turn = 0.0 if number < 20 else -12.0 if number < 36 else 12.0 if number < 52 else 0.0
        x += turn - 4.0 * (number >= 60)
        camera = np.array([[1.0, 0, turn], [0, 1, 0]])
        frame = seen((x - 10, 100), looks=[ONE]) if x > 0 else seen()
        unseen.append(tracker.update(frame, number * STEP_S, camera=camera, size=(480, 640)).unseen_ids.tolist())
    assert unseen[40] == [1]
    assert unseen[-1] == []


def test_a_camera_that_never_comes_back_is_not_followed_without_end():
    tracker = Tracker(CONFIG)
    for number in range(150):
        zoom = np.array([[100.0, 0, 0], [0, 100.0, 0]]) if number >= 5 else None
        tracks = tracker.update(
            seen((400, 100)) if number < 5 else seen(), number * STEP_S, camera=zoom, size=(480, 640)
        )
    assert tracks.unseen_ids.tolist() == []


def test_weak_box_that_stands_in_a_moving_picture_does_not_travel():
    """A sign at 0.5 while the camera turns: its way is that of the picture."""
    tracker, camera = Tracker(CONFIG), np.array([[1.0, 0, -8], [0, 1, 0]])
    for number in range(60):
        tracks = tracker.update(seen((900 - 8 * number, 100), scores=0.5), number * STEP_S, camera=camera)
        assert tracks.ids.tolist() == [NO_ID]


# --- descriptors that are kept ---------------------------------------------------------------------------------------


def _kept(frames):
    """How many descriptors each object has after the frames, in the order in which they were first seen."""
    tracker = Tracker(CONFIG)
    for number, frame in enumerate(frames):
        tracker.update(frame, number * STEP_S)
    return tracker._rule.looks.seen[tracker._rule.objects.slots].tolist()


def test_descriptor_of_a_box_that_another_one_overlaps_is_not_kept():
    """12 px beside each other they share a quarter, 8 px beside each other more than 0.4."""
    alone, near = seen((100, 100), (112, 100), looks=[ONE, OTHER]), seen((100, 100), (108, 100), looks=[ONE, OTHER])
    assert _kept([alone] * 5) == [5, 5]
    assert _kept([*[alone] * 5, *[near] * 4]) == [5, 5]
    weak = seen((100, 100), (108, 100), scores=[0.9, 0.3], looks=[ONE, OTHER])
    assert _kept([*[alone] * 5, *[weak] * 4]) == [9, 5]  # what is weak covers nobody, and is not kept itself


def test_descriptor_of_a_box_behind_which_another_object_is_hidden_is_not_kept():
    both, one = seen((100, 100), (112, 100), looks=[ONE, OTHER]), seen((112, 100), looks=[OTHER])
    assert _kept([*[both] * 5, *[one] * 4]) == [5, 5]
    hidden_long = [*[both] * 5, *[one] * 100]  # for four seconds, of which the last second counts again
    assert _kept(hidden_long)[0] == 5
    assert 20 <= _kept(hidden_long)[1] - 5 <= 27


# --- settings --------------------------------------------------------------------------------------------------------


def test_without_fast_objects_a_jump_is_none():
    slow = replace(CONFIG, motion=replace(CONFIG.motion, jump_share=0.0, alone_speed=0.0))
    frames = _moving(6, speed=24)
    assert _ids(frames) == [[1, 2]] * 6
    assert _ids(frames, slow) != [[1, 2]] * 6
