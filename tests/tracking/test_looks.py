"""What is kept of how objects look, against NumPy on plain lists."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.distances import COARSE, Quantized
from lookonce.distances import quantize as quantize_finely
from lookonce.tracking.looks import LATEST, Looks, median_of_three
from tracking.scenes import apart, at_angle

EVERY = np.ones(1, np.bool_)


def _quantize(descriptors) -> Quantized:
    return quantize_finely(descriptors, COARSE)


def _looks(views=4, apart_by=0.5, interval_s=0.25, size=16):
    looks = Looks(views, apart_by, interval_s)
    looks.check_size(size)
    return looks


def _units(rng, count, size=16):
    rows = rng.normal(size=(count, size))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def _rounded(descriptors):
    """To what is kept of them, so that plain arithmetic gives the same."""
    return _quantize(descriptors.astype(np.float32)).units / np.float32(COARSE.scale)


def _remember(looks, slot, descriptor, now_s=0.0, clean=True):
    looks.remember(np.array([slot]), _quantize(np.array([descriptor], np.float32)), np.array([0]), EVERY & clean, now_s)


def _distance(looks, slot, descriptor):
    return float(looks.distances(np.array([slot]), _quantize(np.array([descriptor], np.float32)), np.array([0]))[0])


class PlainLooks:
    """One object's descriptors in lists, as the docstring of `Looks` says it."""

    def __init__(self, views, apart_by, interval_s):
        self.most, self.apart, self.interval_s = views, apart_by, interval_s
        self.last, self.views, self.view_s, self.replaced = [], [], -np.inf, 0

    def remember(self, descriptor, now_s, clean):
        if not descriptor.any() or not (clean or not self.last):
            return
        self.last.append(descriptor.astype(np.float64))
        if clean and self.most and now_s >= self.view_s + self.interval_s:
            self.view_s = now_s
            if all(np.linalg.norm(view - descriptor) > self.apart for view in self.views):
                if len(self.views) < self.most:
                    self.views.append(descriptor)
                else:
                    self.views[self.replaced % self.most] = descriptor
                    self.replaced += 1

    def distance(self, descriptor):
        if not self.last or not descriptor.any():
            return np.inf
        reference = np.median(self.last[-3:], axis=0) if len(self.last) >= LATEST else self.last[-1]
        return min(np.linalg.norm(kept - descriptor) for kept in [reference, *self.views])


@pytest.mark.parametrize("views", [0, 1, 4])
@pytest.mark.parametrize("seed", range(5))
def test_distances_are_those_of_plain_lists(seed, views):
    rng = np.random.default_rng(seed)
    looks, count = _looks(views, 0.8, 0.1), 7
    plain = [PlainLooks(views, 0.8, 0.1) for _ in range(count)]
    slots, faces = looks.take(count), _units(rng, count)
    for frame in range(40):
        who = rng.permutation(count)[: rng.integers(0, count + 1)]
        noisy = faces[who] + rng.normal(0, 0.2, (len(who), 16))
        noisy /= np.maximum(np.linalg.norm(noisy, axis=1, keepdims=True), 1e-9)
        noisy[rng.random(len(who)) < 0.1] = 0
        is_clean = rng.random(len(who)) < 0.7
        noisy = _rounded(noisy)
        looks.remember(slots[who], _quantize(noisy), np.arange(len(who)), is_clean, frame * 0.04)
        for one, descriptor, clean in zip(who, noisy, is_clean, strict=True):
            plain[one].remember(descriptor, frame * 0.04, clean)
        asked = _rounded(np.vstack([_units(rng, 3), np.zeros((1, 16), np.float32)]))
        pairs = [(one, row) for one in range(count) for row in range(len(asked))]
        found = looks.distances(slots[[one for one, _ in pairs]], _quantize(asked), np.array([row for _, row in pairs]))
        expected = [plain[one].distance(asked[row]) for one, row in pairs]
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_the_nearest_of_reference_and_views_counts():
    """An object seen from 0, 90 and 180 degrees is near to each of them, and far from between."""
    looks = _looks(interval_s=0.0, size=2)
    (slot,) = looks.take(1).tolist()
    for number, angle in enumerate([0, 90, 180, 180, 180]):
        _remember(looks, slot, at_angle(angle)[0], now_s=number)
    for angle in (0, 90, 180):
        assert _distance(looks, slot, at_angle(angle)[0]) == pytest.approx(0, abs=5e-4)
    assert _distance(looks, slot, at_angle(45)[0]) == pytest.approx(apart(45), abs=5e-4)
    assert _distance(looks, slot, at_angle(270)[0]) == pytest.approx(apart(90), abs=5e-4)


def test_views_are_kept_only_so_often_and_so_different():
    looks = _looks(views=4, apart_by=apart(30), interval_s=1.0, size=2)
    (slot,) = looks.take(1).tolist()
    for now_s, angle in [(0.0, 0), (0.5, 120), (1.0, 20), (2.0, 60), (2.9, 180)]:
        _remember(looks, slot, at_angle(angle)[0], now_s)
    # 120 and 180 came too soon, 20 is too near to 0; kept are 0 and 60.
    assert looks.view_count[slot] == 2
    views = looks.kept[1:3, slot] / COARSE.scale
    np.testing.assert_allclose(views, at_angle(0, 60), atol=5e-4)


def test_no_more_views_than_stated_and_the_oldest_goes_first():
    looks = _looks(views=2, apart_by=0.1, interval_s=0.0, size=2)
    (slot,) = looks.take(1).tolist()
    for number, angle in enumerate([0, 90, 180]):
        _remember(looks, slot, at_angle(angle)[0], now_s=number)
    assert looks.kept.shape[0] == 3
    np.testing.assert_allclose(looks.kept[1:, slot] / COARSE.scale, at_angle(180, 90), atol=5e-4)


def test_unclean_descriptor_is_kept_only_where_there_is_none():
    looks = _looks(size=2)
    (slot,) = looks.take(1).tolist()
    _remember(looks, slot, at_angle(0)[0], clean=False)
    assert _distance(looks, slot, at_angle(0)[0]) == pytest.approx(0, abs=5e-4)
    assert looks.view_count[slot] == 0
    _remember(looks, slot, at_angle(90)[0], now_s=1.0, clean=False)
    assert _distance(looks, slot, at_angle(90)[0]) == pytest.approx(apart(90), abs=5e-4)


def test_without_descriptors_the_distance_is_infinite():
    looks = _looks(size=2)
    (slot,) = looks.take(1).tolist()
    assert _distance(looks, slot, at_angle(0)[0]) == np.inf
    _remember(looks, slot, [0.0, 0.0])
    assert _distance(looks, slot, at_angle(0)[0]) == np.inf
    _remember(looks, slot, at_angle(0)[0])
    assert _distance(looks, slot, [0.0, 0.0]) == np.inf


def test_slots_are_used_again_and_nothing_leaks():
    """Thousands of objects, few at a time: the room stays that of the few, and a new one knows nothing of the old."""
    rng, looks = np.random.default_rng(0), _looks(interval_s=0.0)
    held: list[int] = []
    for frame in range(500):
        held += looks.take(int(rng.integers(0, 5))).tolist()
        assert len(set(held)) == len(held)
        if held:
            rows, is_clean = np.arange(len(held)), np.ones(len(held), np.bool_)
            looks.remember(np.array(held), _quantize(_units(rng, len(held))), rows, is_clean, frame)
        while len(held) > 20:
            looks.release(np.array([held.pop(int(rng.integers(len(held))))]))
    assert len(looks.seen) == 64
    looks.release(np.array(held))
    for slot in looks.take(25).tolist():
        assert _distance(looks, slot, _units(rng, 1)[0]) == np.inf
        _remember(looks, slot, _units(rng, 1)[0])
        assert looks.view_count[slot] == 1


def test_room_grows_and_keeps_what_is_there():
    rng, looks = np.random.default_rng(0), _looks()
    faces = _units(rng, 200)
    slots = np.concatenate([looks.take(40) for _ in range(5)])
    assert sorted(slots.tolist()) == list(range(200))
    looks.remember(slots[:3], _quantize(faces[:3]), np.arange(3), np.ones(3, np.bool_), 0.0)
    looks.take(500)
    found = looks.distances(slots[:4], _quantize(faces[:4]), np.arange(4))
    np.testing.assert_allclose(found, [0, 0, 0, np.inf], atol=5e-4)


def test_many_pairs_are_the_same_as_one_by_one():
    """More pairs than are compared at once."""
    rng, looks = np.random.default_rng(0), _looks(size=8)
    slots, faces = looks.take(100), _quantize(_units(rng, 100, 8))
    looks.remember(slots, faces, np.arange(100), np.ones(100, np.bool_), 0.0)
    of_object, row = np.divmod(np.arange(10_000), 100)
    at_once = looks.distances(slots[of_object], faces, row)
    for pair in (0, 2047, 2048, 9_999):
        alone = looks.distances(slots[of_object[pair : pair + 1]], faces, row[pair : pair + 1])
        assert alone.tobytes() == at_once[pair : pair + 1].tobytes()


def test_descriptors_of_another_length_are_refused():
    looks = _looks(size=2)
    looks.check_size(2)
    with pytest.raises(ValueError, match="descriptors: expected 2 values as before, got 3"):
        looks.check_size(3)


def test_objects_that_come_before_the_first_descriptor_have_none():
    looks = Looks(4, 0.5, 0.25)
    slots = looks.take(100)
    looks.check_size(3)
    assert (
        looks.distances(slots, _quantize(np.eye(3, dtype=np.float32)[:1]), np.zeros(100, np.int64)).tolist()
        == [np.inf] * 100
    )


def test_median_of_three_is_numpys():
    three = np.random.default_rng(0).normal(size=(3, 50, 7))
    np.testing.assert_array_equal(median_of_three(*three), np.median(three, axis=0))


def test_nothing_in_nothing_out():
    looks, none = _looks(size=2), np.zeros(0, np.int64)
    empty = _quantize(np.zeros((0, 2), np.float32))
    assert looks.take(0).shape == (0,)
    assert looks.distances(none, empty, none).shape == (0,)
    looks.remember(none, empty, none, np.zeros(0, np.bool_), 0.0)
    looks.release(none)
