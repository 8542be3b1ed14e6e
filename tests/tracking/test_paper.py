"""The paper's rule (section 3.3), one scene of 2-6 frames for each of its sentences."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.errors import ConfigError
from lookonce.structures import Detections
from lookonce.tracking import PaperConfig, Tracker
from tracking.scenes import apart, at_angle, make_detections

NOTHING = make_detections(np.zeros((0, 2)))


def _ids(frames, threshold=1.0):
    """Ids of each frame's rows, by a new tracker."""
    tracker = Tracker(PaperConfig(match_threshold=threshold))
    return [tracker.update(make_detections(frame)).ids.tolist() for frame in frames]


def _angles(*frames, threshold=1.0):
    """Ids where each frame is given as its descriptors' angles in degrees."""
    return _ids([at_angle(*frame) for frame in frames], threshold)


def test_ids_start_at_1_and_follow_the_rows():
    assert _angles((0, 90, 180)) == [[1, 2, 3]]


def test_same_descriptors_keep_their_ids_in_any_order():
    assert _angles((0, 90, 180), (180, 0, 90)) == [[1, 2, 3], [3, 1, 2]]


def test_newest_descriptor_is_used_while_there_is_one():
    """ "The descriptor that is generated for that object is used to match it [...] in the next frame."""
    assert _angles((0,), (20,), threshold=apart(25)) == [[1], [1]]


def test_newest_descriptor_is_used_while_there_are_two():
    """0, then 20: at 42 it is 22 from the newest, but 32 from the mean and 42 from the oldest."""
    assert _angles((0,), (20,), (42,), threshold=apart(25)) == [[1], [1], [1]]


def test_median_is_used_once_there_are_three():
    """0, 20, 40 turns: the median of the three lies near 20, so 42 is out of reach although the newest is at 40.

    Element-wise, cos and sin of 0..90 degrees fall and rise: the median of three is the middle vector itself.
    """
    assert _angles((0,), (20,), (40,), (42,), threshold=apart(21)) == [[1], [1], [1], [2]]
    assert _angles((0,), (20,), (40,), (38,), threshold=apart(21)) == [[1], [1], [1], [1]]


def _vector(*values):
    """A descriptor of four values, the last one makes it unit length."""
    return [*values, np.sqrt(1 - np.square(values).sum())]


def test_it_is_the_median_of_each_element_not_the_mean_and_not_the_newest():
    """Three frames, each with an outlier in another element: only the element-wise median is free of all three.

    Two detections follow: one nearest to the median, one in the direction of the mean, which is nearer to the newest
    descriptor too.
    """
    history = np.array([_vector(0.35, 0, 0), _vector(0, 0.35, 0), _vector(0, 0, 0.35)])
    median, mean = np.median(history, axis=0), np.mean(history, axis=0)
    clean, average = np.array(_vector(0, 0, 0)), mean / np.linalg.norm(mean)
    for reference, nearer, farther in [(median, clean, average), (mean, average, clean), (history[2], average, clean)]:
        assert np.linalg.norm(reference - nearer) + 0.05 < np.linalg.norm(reference - farther)
    frames = [*([row] for row in history), [average, clean]]
    assert _ids(frames) == [[1], [1], [1], [2, 1]]


def test_oldest_of_the_last_three_is_dropped():
    """After 0, 20, 40 and 60 the median is 40, not 20 (the first three), 30 (all four) or 60 (the newest)."""
    history, threshold = [(0,), (20,), (40,), (60,)], apart(45)
    assert _angles(*history, (82,), threshold=threshold) == [[1]] * 5  # 62 from the median of the first three
    assert _angles(*history, (-8,), threshold=threshold) == [[1]] * 4 + [[2]]  # 28 and 38 from the others
    assert _angles(*history, (100,), threshold=threshold) == [[1]] * 4 + [[2]]  # 40 from the newest


@pytest.mark.parametrize(
    ("threshold", "expected"),
    [
        pytest.param(float(np.nextafter(1.0, 0)), [2], id="just-below"),
        pytest.param(1.0, [1], id="exactly-at"),
        pytest.param(float(np.nextafter(1.0, 2)), [1], id="just-above"),
    ],
)
def test_distance_equal_to_the_threshold_is_not_neglected(threshold, expected):
    """Distance exactly 1, in numbers that float32 and the rounding hold exactly: "larger than" is neglected."""
    assert _ids([[[1, 0, 0, 0]], [[0.5, 0.5, 0.5, 0.5]]], threshold=threshold)[1] == expected


def test_smallest_distance_is_taken_first_even_where_the_sum_is_larger():
    """Objects at 0 and 30, detections at 20 and -25. Greedy: 30-20 first (10), then 0 to -25 (25).

    With detections at 13 and 45 it takes 0-13 (13) and 30-45 (15). In the third case greedy and the least sum differ:
    objects 0 and 30, detections 28 (2 from the second) and 50: greedy pairs 30-28 and is left with 0-50 (50), above
    the threshold, so 50 is new; the least sum would pair 0-28 and 30-50 and keep both objects.
    """
    assert _angles((0, 30), (20, -25)) == [[1, 2], [2, 1]]
    assert _angles((0, 30), (13, 45)) == [[1, 2], [1, 2]]
    assert _angles((0, 30), (28, 50), threshold=apart(40)) == [[1, 2], [2, 3]]


def test_each_object_and_each_detection_is_matched_once():
    """Two detections near one object: the nearer one gets it. Two objects near one detection: the nearer one has it."""
    assert _angles((0,), (10, 5)) == [[1], [2, 1]]
    assert _angles((0, 20), (12,)) == [[1, 2], [2]]


def test_next_smallest_distance_follows_among_the_rest():
    assert _angles((0, 40, 80), (38, 6, 70)) == [[1, 2, 3], [2, 1, 3]]
    # The second best partner of 2 was taken by 1 first: both chains are followed to the end.
    assert _angles((0, 10, 24), (9, 23, 40), threshold=apart(20)) == [[1, 2, 3], [2, 3, 4]]
    assert _angles((0, 10, 24), (9, 23, 40), threshold=apart(41)) == [[1, 2, 3], [2, 3, 1]]


def test_unmatched_detection_is_a_new_object_and_is_matched_next_time():
    assert _angles((0,), (0, 90), (90, 0)) == [[1], [1, 2], [2, 1]]


def test_new_ids_go_by_row():
    assert _angles((0,), (180, 0, 90)) == [[1], [2, 1, 3]]


def test_object_missed_once_is_a_new_object():
    """ "The objects detected in previous frame": there is no longer memory."""
    assert _angles((0, 90), (90,), (0, 90)) == [[1, 2], [2], [3, 2]]


def test_object_that_returns_starts_with_one_descriptor_again():
    """Its old three are forgotten: the fourth frame is matched with the newest one, not with a median."""
    assert _angles((0,), (20,), (40,), (), (40,), (60,), threshold=apart(25)) == [[1], [1], [1], [], [2], [2]]


def test_frame_without_detections_forgets_everything():
    assert _angles((0, 90), (), (0, 90)) == [[1, 2], [], [3, 4]]


def test_no_detections_and_no_objects():
    assert _angles((), ()) == [[], []]


def test_no_objects_then_detections():
    assert _angles((), (0,)) == [[], [1]]


def test_one_of_each():
    assert _angles((0,), (1,)) == [[1], [1]]


def test_more_detections_than_objects_and_fewer():
    assert _angles((0,), (0, 60, 120, 180)) == [[1], [1, 2, 3, 4]]
    assert _angles((0, 60, 120, 180), (120,)) == [[1, 2, 3, 4], [3]]


def test_two_trackers_do_not_meet():
    one, two = Tracker("paper"), Tracker("paper")
    assert one.update(make_detections(at_angle(0, 90))).ids.tolist() == [1, 2]
    assert two.update(make_detections(at_angle(90))).ids.tolist() == [1]
    assert one.update(make_detections(at_angle(90, 180))).ids.tolist() == [2, 3]
    assert two.update(make_detections(at_angle(90))).ids.tolist() == [1]


def _random_frames(seed, frames=12):
    """Noisy objects that come and go, in shuffled order."""
    rng = np.random.default_rng(seed)
    base = rng.normal(size=(9, 32))
    for _ in range(frames):
        present = rng.permutation(9)[: rng.integers(0, 10)]
        yield base[present] + rng.normal(0, 0.35, (len(present), 32))


def test_same_input_gives_the_same_ids():
    assert _ids(_random_frames(1)) == _ids(_random_frames(1))
    assert len({i for frame in _ids(_random_frames(1)) for i in frame}) > 9


def _plain_rule(frames, threshold):
    """The paper's sentences, one after the other, with lists and loops."""
    next_id, objects = 1, []  # (id, descriptors) in order of ids
    answers = []
    for frame in frames:
        looks = make_detections(frame).descriptors.astype(np.float64)
        pairs = []
        for number, (_, seen) in enumerate(objects):
            reference = np.median(seen[-3:], axis=0) if len(seen) >= 3 else seen[-1]
            pairs += [(np.linalg.norm(reference - look), number, row) for row, look in enumerate(looks)]
        taken, answer = set(), [0] * len(looks)
        for distance, number, row in sorted(pairs):
            if distance <= threshold and number not in taken and not answer[row]:
                taken.add(number)
                answer[row] = objects[number][0]
        histories = dict(objects)
        for row in range(len(looks)):
            if not answer[row]:
                answer[row], next_id = next_id, next_id + 1
        objects = sorted((i, [*histories.get(i, []), look]) for i, look in zip(answer, looks, strict=True))
        answers.append(answer)
    return answers


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("threshold", [0.4, 0.8, 1.3])
def test_random_scenes_equal_the_rule_written_plainly(seed, threshold):
    frames = list(_random_frames(seed))
    assert _ids(frames, threshold) == _plain_rule(frames, threshold)


def test_ties_go_to_the_lowest_id_then_the_lowest_row():
    """Three objects with one descriptor, two detections with it too: ids by order, whatever the rows of before were."""
    assert _angles((0, 0, 0), (0, 0)) == [[1, 2, 3], [1, 2]]
    one, two, between = np.eye(4)[0], np.eye(4)[1], np.full(4, 0.5)  # each exactly 1 from the middle
    assert _ids([[one, two], [between]]) == [[1, 2], [1]]
    # The rows swap, then a tie: the lowest id wins, not the lowest row of the frame before.
    assert _ids([[one, two], [two, one], [between]]) == [[1, 2], [2, 1], [1]]
    assert _ids([[between], [two, one]]) == [[1], [1, 2]]


def test_tracks_are_the_detections_with_ids():
    detections = make_detections(at_angle(0, 90, 180))
    tracks = Tracker("paper").update(detections, time_s=0.5)
    assert tracks.ids.dtype == np.int64
    for name in ("xyxy", "scores", "labels"):
        np.testing.assert_array_equal(getattr(tracks, name), getattr(detections, name))
    assert (len(tracks.unseen_ids), tracks.unseen_xyxy.shape) == (0, (0, 4))


def test_zero_descriptor_has_no_id_and_disturbs_nobody():
    frames = [np.vstack([at_angle(0), [[0, 0]], at_angle(90)]), np.vstack([[[0, 0]], at_angle(90, 0)])]
    assert _ids(frames) == [[1, -1, 2], [-1, 2, 1]]
    assert _ids([[[0, 0]], [[0, 0]], at_angle(0)]) == [[-1], [-1], [1]]


def test_frame_of_zero_descriptors_is_a_frame_without_detections():
    assert _ids([at_angle(0), [[0, 0]], at_angle(0)]) == [[1], [-1], [2]]


def test_descriptors_of_another_length_are_refused():
    tracker = Tracker("paper")
    tracker.update(make_detections(np.eye(3, 8)))
    with pytest.raises(ValueError, match="descriptors: expected 8 values as before, got 9"):
        tracker.update(make_detections(np.eye(3, 9)))


def test_detections_without_descriptors_are_refused():
    with pytest.raises(ValueError, match="preset 'paper' matches descriptors; these detections have none"):
        Tracker("paper").update(Detections.empty())


@pytest.mark.parametrize("threshold", [0.0, -1.0, 2.1, float("nan"), float("inf")])
def test_impossible_threshold_is_refused(threshold):
    with pytest.raises(ConfigError, match="match_threshold"):
        PaperConfig(match_threshold=threshold)


def test_memory_does_not_grow_with_the_stream():
    """Whatever has been seen, the tracker holds the previous frame's objects only."""
    tracker = Tracker("paper")
    for angle in range(200):
        tracker.update(make_detections(at_angle(angle * 61, angle * 61 + 120)))
    objects = tracker._rule.objects
    assert objects is not None
    assert len(objects.ids) == len(objects.newest) == len(objects.references.units) == 2
