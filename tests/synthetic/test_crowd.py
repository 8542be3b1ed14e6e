"""Crowds: boxes are where the members are, who stands before whom is known, and everything follows from the seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from lookonce.synthetic.crowd import MEMBERS, Crowd

SIZE = (160, 200)


def gather(seed=0) -> Crowd:
    """A crowd before plain green, whose camera is perfect."""
    crowd = Crowd.gather(SIZE, Image.new("RGB", (50, 40), (0, 255, 0)), np.random.default_rng(seed))
    return replace(crowd, optics=lambda image, rng: np.asarray(image))


def test_boxes_enclose_what_is_painted_and_no_more():
    for seed in range(4):
        seen = gather(seed).picture(np.random.default_rng(seed))
        is_painted = (seen.image != [0, 255, 0]).any(axis=2)
        inside = np.zeros(SIZE, bool)
        for x1, y1, x2, y2 in seen.xyxy[~np.isnan(seen.xyxy[:, 0])]:
            box = np.s_[int(y1) : int(np.ceil(y2)), int(x1) : int(np.ceil(x2))]
            inside[box] = True
            rows, columns = is_painted[box].any(axis=1), is_painted[box].any(axis=0)
            assert rows[:2].any()
            assert rows[-2:].any()
            assert columns[:2].any()
            assert columns[-2:].any()
        assert is_painted.any()
        assert not (is_painted & ~inside).any()


def test_who_stands_alone_is_wholly_visible_and_some_are_hidden():
    shares = []
    for seed in range(6):
        seen = gather(seed).picture(np.random.default_rng(seed))
        boxes = seen.xyxy
        for number in np.flatnonzero(~np.isnan(boxes[:, 0])):
            box, others = boxes[number], np.delete(boxes, number, axis=0)
            corner, end = np.maximum(box[:2], others[:, :2]), np.minimum(box[2:], others[:, 2:])
            if not (np.ceil(end) > np.floor(corner)).all(axis=1).any():
                assert seen.visible[number] == pytest.approx(1)
            shares.append(seen.visible[number])
        assert (seen.visible[np.isnan(boxes[:, 0])] == 0).all()
    assert min(shares) < 0.8
    assert max(shares) <= 1


def test_everything_follows_from_the_seeds():
    def draw(crowd_seed, frame_seed):
        crowd = Crowd.gather(SIZE, Image.new("RGB", (50, 40), (0, 255, 0)), np.random.default_rng(crowd_seed))
        seen = crowd.picture(np.random.default_rng(frame_seed))
        return seen.image.tobytes() + seen.xyxy.tobytes() + seen.visible.tobytes()

    assert draw(1, 2) == draw(1, 2)
    assert len({draw(1, 2), draw(1, 3), draw(2, 2)}) == 3


def test_a_member_keeps_its_looks_from_picture_to_picture():
    """The same person's mean colour varies less than that of different persons."""
    crowd = replace(gather(3), shade=0.0)
    colours: dict[int, list[np.ndarray]] = {}
    for frame in range(12):
        seen = crowd.picture(np.random.default_rng(frame))
        for number in np.flatnonzero(seen.visible > 0.95):
            x1, y1, x2, y2 = seen.xyxy[number].astype(int)
            pixels = seen.image[y1:y2, x1:x2].reshape(-1, 3).astype(float)
            own = pixels[(pixels != [0, 255, 0]).any(axis=1)]
            if len(own) > 40:
                colours.setdefault(int(number), []).append(own.mean(axis=0))
    several = [np.array(seen) for seen in colours.values() if len(seen) > 3]
    assert len(several) > 5
    within = np.mean([seen.var(axis=0).sum() for seen in several])
    between = np.array([seen.mean(axis=0) for seen in several]).var(axis=0).sum()
    assert between > 1.5 * within


def test_nobody_stands_in_the_place_of_another():
    crowd = gather()
    assert len(crowd.members) == MEMBERS
    for frame in range(10):
        places = np.array(list(crowd._places(np.random.default_rng(frame)).values()))
        apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1)) + 1e9 * np.eye(len(places))
        assert 0.4 < apart.min() < 3
