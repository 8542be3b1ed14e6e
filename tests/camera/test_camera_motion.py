"""The camera's motion on pictures whose motion is known."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from lookonce.camera import CameraMotion, luma_of_canvas
from lookonce.camera.blocks import coarse_shift
from lookonce.camera.pictures import make_pyramid
from lookonce.camera.similarity import compose, fit_similarity, identity, invert
from lookonce.letterbox import Letterboxer

SIZE = (270, 480)
NO_BOXES = np.zeros((0, 4), np.float32)
MARGIN = 120
USUAL = ((6, 50.0), (15, 50.0), (40, 50.0))
FINE = ((4, 60.0), (40, 30.0))  # as a lawn or gravel


def textured(
    seed: int = 0, size: tuple[int, int] = SIZE, contrasts: tuple[tuple[int, float], ...] = USUAL
) -> np.ndarray:
    """A smooth random picture with room for motion around it, float64; of cells of so many px with such contrast."""
    height, width = size[0] + 2 * MARGIN, size[1] + 2 * MARGIN
    rng, total = np.random.default_rng(seed), np.zeros((height, width))
    for cell, contrast in contrasts:
        grid = rng.uniform(-contrast, contrast, (height // cell + 2, width // cell + 2))
        rows, columns = np.arange(height) / cell, np.arange(width) / cell
        total += bilinear(grid, *np.meshgrid(columns, rows))
    return np.clip(128 + total, 0, 255)


def bilinear(grid: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    right, below = x - left, y - top
    upper = grid[top, left] * (1 - right) + grid[top, left + 1] * right
    lower = grid[top + 1, left] * (1 - right) + grid[top + 1, left + 1] * right
    return upper * (1 - below) + lower * below


def view(world: np.ndarray, pose: np.ndarray, noise: float = 2.0, seed: int = 0) -> np.ndarray:
    """What a camera sees whose ``pose`` takes px of the unmoved view to px of this one; (H, W) uint8."""
    back = invert(pose)
    x, y = np.meshgrid(np.arange(SIZE[1]) + 0.5, np.arange(SIZE[0]) + 0.5)
    seen_x = back[0, 0] * x + back[0, 1] * y + back[0, 2] - 0.5 + MARGIN
    seen_y = back[1, 0] * x + back[1, 1] * y + back[1, 2] - 0.5 + MARGIN
    grain = np.random.default_rng(seed).normal(0, noise, SIZE)
    return np.clip(np.rint(bilinear(world, seen_x, seen_y) + grain), 0, 255).astype(np.uint8)


def pose(dx: float = 0.0, dy: float = 0.0, turn: float = 0.0, zoom: float = 1.0) -> np.ndarray:
    """A motion about the middle of the picture."""
    cos, sin = zoom * math.cos(turn), zoom * math.sin(turn)
    middle = np.array([SIZE[1] / 2, SIZE[0] / 2])
    linear = np.array([[cos, -sin], [sin, cos]])
    return np.column_stack([linear, middle - linear @ middle + (dx, dy)])


def apart(a: np.ndarray, b: np.ndarray, size: tuple[int, int] = SIZE) -> float:
    """The largest distance between where two affines take the corners."""
    corners = np.array([[0, 0, 1], [size[1], 0, 1], [0, size[0], 1], [size[1], size[0], 1]], float)
    return float(np.linalg.norm(corners @ (a - b).T, axis=1).max())


def is_identity(affine: np.ndarray) -> bool:
    return affine.tobytes() == identity().tobytes()


def follow(camera: CameraMotion, pictures: list[np.ndarray], fps: float = 25.0) -> list[np.ndarray]:
    return [camera.update(luma, NO_BOXES, SIZE, index / fps) for index, luma in enumerate(pictures)]


@pytest.mark.parametrize(
    ("motion", "tolerance_px"),
    [
        pytest.param(pose(4, -3), 0.2, id="shift"),
        pytest.param(pose(0.6, 0.5), 0.2, id="less than a px"),
        pytest.param(pose(31, 14), 0.3, id="far"),
        pytest.param(pose(turn=0.02), 0.4, id="turn"),
        pytest.param(pose(zoom=1.02), 0.4, id="zoom"),
        pytest.param(pose(-5, 6, 0.015, 0.985), 0.4, id="all at once"),
    ],
)
def test_one_known_motion_is_found(motion: np.ndarray, tolerance_px: float) -> None:
    world = textured()
    _, found = follow(CameraMotion(), [view(world, pose(), seed=1), view(world, motion, seed=2)])
    assert apart(found, motion) < tolerance_px


def test_motion_adds_up_along_a_path() -> None:
    """Steps that are each a little wrong may not drift away from the path."""
    world, total = textured(), identity()
    poses = [pose(20 * math.sin(t / 7), 9 * math.cos(t / 5) - 9, 0.02 * math.sin(t / 9)) for t in range(50)]
    for step in follow(CameraMotion(), [view(world, one, seed=t) for t, one in enumerate(poses)]):
        total = compose(step, total)
    assert apart(total, poses[-1]) < 1.0


@pytest.mark.parametrize("step_px", [25, 50])
def test_a_camera_that_stood_still_and_pans_far_from_frame_to_frame_is_followed(step_px: int) -> None:
    """Two frames a second: nothing is where it was, and fine texture looks as if it had hardly moved."""
    world, poses = textured(contrasts=FINE), [pose(step_px * t - 75, 6 * t - 20) for t in (0, 1, 2, 3, 2, 1)]
    found = follow(CameraMotion(), [view(world, one, seed=t) for t, one in enumerate(poses)], fps=2)
    for before, now, step in zip(poses, poses[1:], found[1:], strict=False):
        assert apart(step, compose(now, invert(before))) < 0.5


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_objects_in_the_foreground_do_not_decide_how_far_the_picture_went(seed: int) -> None:
    """Three dark pillars go to the left, and all else to the right."""
    world = textured(seed)
    before, now = view(world, pose(), seed=1), view(world, pose(48, 16), seed=2)
    for left in (60, 220, 380):
        before[70:200, left : left + 50] = 20
        now[70:200, left - 20 : left + 30] = 20
    pictures = make_pyramid(before), make_pyramid(now)
    np.testing.assert_allclose(pictures[0].factor * coarse_shift(*pictures), [48, 16], atol=8)


def test_a_camera_that_stands_still_gives_exactly_the_identity() -> None:
    world = textured()
    light = [0, 0, 9, 18, 27, 18, 9, 0, -9, -18] * 8
    pictures = [
        np.clip(view(world, pose(), noise=4.0, seed=t).astype(int) + more, 0, 255).astype(np.uint8)
        for t, more in enumerate(light)
    ]
    assert all(is_identity(found) for found in follow(CameraMotion(), pictures))


@pytest.mark.parametrize("has_boxes", [True, False])
def test_what_moves_in_a_still_picture_does_not_win(has_boxes: bool) -> None:
    """A lorry over a third of the picture, with more texture than all the rest."""
    world, lorry = textured(), textured(seed=5) // 8 * 8
    camera = CameraMotion()
    for t in range(30):
        picture = view(world, pose(), seed=t)
        left = 10 + 8 * t
        picture[60:240, left : left + 240] = lorry[:180, : picture[60:240, left : left + 240].shape[1]]
        boxes = np.array([[left, 60, left + 240, 240]], np.float32) if has_boxes else NO_BOXES
        assert is_identity(camera.update(picture, boxes, SIZE, t / 25))


def test_objects_do_not_disturb_a_moving_camera() -> None:
    world, object_ = textured(), textured(seed=5)
    camera, before = CameraMotion(), pose()
    for t in range(25):
        now = pose(3 * t, -t)
        picture = view(world, now, seed=t)
        left = 380 - 12 * t
        picture[40:160, left : left + 90] = object_[:120, :90]
        found = camera.update(picture, np.array([[left, 40, left + 90, 160]], np.float32), SIZE, t / 25)
        if t:
            assert apart(found, compose(now, invert(before))) < 0.4
        before = now


def test_a_sleeping_camera_is_back_soon_after_it_moves() -> None:
    world, camera = textured(), CameraMotion()
    answers, truth = [], []
    for t in range(130):
        x = 0.0 if t < 100 else 2.0 * (t - 99)
        answers.append(camera.update(view(world, pose(x), seed=t), NO_BOXES, SIZE, t / 25))
        truth.append(pose(2.0 if t >= 100 else 0.0))
    assert all(is_identity(answer) for answer in answers[:100])
    woken = next(t for t, answer in enumerate(answers) if not is_identity(answer))
    assert 100 <= woken <= 105  # a fifth of a second
    assert all(apart(a, b) < 0.3 for a, b in zip(answers[woken:], truth[woken:], strict=True))  # one step, not all five


def test_a_sleeping_camera_is_looked_at_now_and_then_only(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[float] = []
    world, camera = textured(), CameraMotion()
    from lookonce.camera import motion

    real = motion.make_pyramid
    monkeypatch.setattr(motion, "make_pyramid", lambda luma: looks.append(now_s) or real(luma))
    picture = view(world, pose())
    for t in range(250):
        now_s = t / 25
        camera.update(picture, NO_BOXES, SIZE, now_s)
    assert sum(1 for time_s in looks if time_s < 2) == 50
    assert sum(1 for time_s in looks if time_s >= 2) == 40  # of 200


def test_it_sleeps_again_when_the_camera_has_come_to_rest() -> None:
    world = textured()
    xs = [2.0 * t for t in range(20)] + [40.0] * 80
    found = follow(CameraMotion(), [view(world, pose(x), seed=t) for t, x in enumerate(xs)])
    assert not is_identity(found[10])
    assert all(is_identity(affine) for affine in found[60:])


def test_times_need_not_be_given_or_even() -> None:
    world, rng = textured(), np.random.default_rng(3)
    camera, without, time_s = CameraMotion(), CameraMotion(), 0.0
    for t in range(20):
        picture = view(world, pose(3 * t), seed=t)
        found = camera.update(picture, NO_BOXES, SIZE, time_s)
        assert apart(without.update(picture, NO_BOXES, SIZE), pose(3 if t else 0)) < 0.3
        assert apart(found, pose(3 if t else 0)) < 0.3
        time_s += float(rng.choice([0.0, 0.01, 0.04, 0.5, 3.0]))


def test_cuts_and_a_clock_that_goes_back_give_the_identity_once() -> None:
    first, second = textured(), textured(seed=9)
    camera = CameraMotion()
    for t in range(10):
        camera.update(view(first, pose(3 * t), seed=t), NO_BOXES, SIZE, t / 25)
    assert is_identity(camera.update(view(second, pose()), NO_BOXES, SIZE, 0.4))
    assert apart(camera.update(view(second, pose(4)), NO_BOXES, SIZE, 0.44), pose(4)) < 0.3
    assert is_identity(camera.update(view(second, pose(8)), NO_BOXES, SIZE, 0.0))
    assert apart(camera.update(view(second, pose(12)), NO_BOXES, SIZE, 0.04), pose(4)) < 0.3


def test_a_change_of_size_begins_anew() -> None:
    world, camera = textured(), CameraMotion()
    camera.update(view(world, pose()), NO_BOXES, SIZE, 0.0)
    half = np.ascontiguousarray(view(world, pose(9))[::2, ::2])
    assert is_identity(camera.update(half, NO_BOXES, SIZE, 0.04))
    assert is_identity(camera.update(half, NO_BOXES, (540, 960), 0.08))
    assert apart(camera.update(view(world, pose(9)), NO_BOXES, SIZE, 0.12), identity()) == 0


@pytest.mark.parametrize(
    "picture",
    [
        pytest.param(np.full(SIZE, 90, np.uint8), id="plain"),
        pytest.param(np.repeat(np.arange(480, dtype=np.uint8)[None] // 2, 270, axis=0), id="slope"),
        pytest.param(np.zeros((1, 1), np.uint8), id="one px"),
        pytest.param(np.zeros((4, 4000), np.uint8), id="a line"),
        pytest.param(np.random.default_rng(0).integers(0, 256, (37, 41), dtype=np.uint8), id="tiny"),
    ],
)
def test_pictures_that_tell_nothing_give_the_identity(picture: np.ndarray) -> None:
    camera = CameraMotion()
    for shift in range(6):
        assert is_identity(camera.update(np.roll(picture, 3 * shift, axis=1), NO_BOXES, SIZE, shift / 25))


def test_noise_alone_gives_the_identity() -> None:
    rng = np.random.default_rng(0)
    assert all(
        is_identity(found)
        for found in follow(CameraMotion(), [rng.integers(0, 256, SIZE, dtype=np.uint8) for _ in range(20)])
    )


@pytest.mark.parametrize(
    "boxes",
    [
        pytest.param([[0, 0, 480, 270]], id="one"),
        pytest.param([[-50, -50, 250, 300], [240, -10, 500, 290]], id="two"),
        pytest.param([[-3e38, -3e38, 3e38, 3e38]], id="huge"),
    ],
)
def test_a_picture_under_boxes_gives_the_identity_until_they_go(boxes: list[list[float]]) -> None:
    world, camera, covered = textured(), CameraMotion(), np.array(boxes, np.float32)
    for t in range(8):
        assert is_identity(camera.update(view(world, pose(4 * t), seed=t), covered, SIZE, t / 25))
    camera.update(view(world, pose(32)), NO_BOXES, SIZE, 8 / 25)
    found = [camera.update(view(world, pose(32 + 4 * t), seed=t), NO_BOXES, SIZE, (8 + t) / 25) for t in (1, 2)]
    assert apart(found[-1], pose(4)) < 0.3


def test_the_scale_of_the_luma_does_not_matter() -> None:
    world = textured()
    pictures = [view(world, pose(4.0 * t, 2.0 * t), seed=t) for t in range(3)]
    large, small = CameraMotion(), CameraMotion()
    for t, picture in enumerate(pictures):
        doubled = np.kron(picture, np.ones((2, 2), np.uint8))
        found = [
            large.update(doubled, NO_BOXES, (540, 960), t / 25),
            small.update(picture, NO_BOXES, (540, 960), t / 25),
        ]
    for affine in found:
        assert np.abs(affine[:, 2] - (8, 4)).max() < 0.5


def test_the_canvas_of_the_network_shows_the_motion_in_px_of_the_frame() -> None:
    world, letterbox, camera = textured(), Letterboxer((256, 256)), CameraMotion()
    for t in range(3):
        rgb = np.repeat(view(world, pose(6.0 * t, -4.0 * t), seed=t)[:, :, None], 3, axis=2)
        canvas, placed = letterbox(rgb)
        luma = luma_of_canvas(canvas, placed)
        assert luma.shape == placed.scaled
        assert np.shares_memory(luma, canvas)
        found = camera.update(luma, NO_BOXES, SIZE, t / 25)
    assert apart(found, pose(6.0, -4.0)) < 0.6


def test_two_streams_do_not_meet_and_the_same_input_gives_the_same_bytes() -> None:
    worlds = [textured(seed) for seed in (1, 2)]
    clips = [[view(world, pose(3.3 * t, t, 0.002 * t), seed=t) for t in range(12)] for world in worlds]
    alone = [np.stack(follow(CameraMotion(), clip)).tobytes() for clip in clips]
    cameras = CameraMotion(), CameraMotion()
    answers: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for t in range(12):
        for camera, clip, found in zip(cameras, clips, answers, strict=True):
            found.append(camera.update(clip[t], NO_BOXES, SIZE, t / 25))
    assert [np.stack(found).tobytes() for found in answers] == alone


def test_threads_and_processor_features_do_not_change_a_byte() -> None:
    code = (
        "import hashlib; import numpy as np; from lookonce.camera import CameraMotion\n"
        "rng = np.random.default_rng(0); world = rng.uniform(0, 255, (40, 70)).repeat(9, 0).repeat(9, 1)\n"
        "world = sum(np.roll(world, (k, k // 2), (0, 1)) for k in range(9)) / 9; camera = CameraMotion(); found = []\n"
        "for t in range(10):\n"
        "    luma = world[t : t + 270, 2 * t : 2 * t + 480].astype(np.uint8)\n"
        "    found.append(camera.update(luma, np.zeros((0, 4), np.float32), (540, 960), t / 25))\n"
        "print(hashlib.sha256(np.stack(found).tobytes()).hexdigest(), (found[-1] != np.eye(2, 3)).any())"
    )
    digests = set()
    for extra in ({"OMP_NUM_THREADS": "1"}, {"OPENBLAS_NUM_THREADS": "2"}, {"OPENBLAS_CORETYPE": "Nehalem"}):
        run = subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, **extra}, capture_output=True, text=True, check=True
        )
        digests.add(run.stdout)
    assert len(digests) == 1
    assert digests.pop().endswith("True\n")


def test_the_arguments_stay_as_they_are() -> None:
    picture, boxes = view(textured(), pose()), np.array([[10, 10, 50, 50]], np.float32)
    copies = picture.copy(), boxes.copy()
    picture.flags.writeable = boxes.flags.writeable = False
    camera = CameraMotion()
    for t in range(3):
        camera.update(picture, boxes, SIZE, t / 25)
    assert (picture == copies[0]).all()
    assert (boxes == copies[1]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param({"luma": np.zeros((4, 4, 3), np.uint8)}, "luma", id="colour"),
        pytest.param({"luma": np.zeros((4, 4), np.float32)}, "luma", id="float"),
        pytest.param({"luma": np.zeros((0, 4), np.uint8)}, "pixels", id="empty"),
        pytest.param({"xyxy": np.zeros((2, 5), np.float32)}, "xyxy", id="boxes"),
        pytest.param({"xyxy": np.full((1, 4), np.nan, np.float32)}, "xyxy", id="nan"),
        pytest.param({"size": (0, 480)}, "frame", id="size"),
        pytest.param({"time_s": math.inf}, "time_s", id="time"),
    ],
)
def test_wrong_calls_are_refused(change: dict, message: str) -> None:
    call = {"luma": np.zeros(SIZE, np.uint8), "xyxy": NO_BOXES, "size": SIZE, "time_s": 0.0} | change
    with pytest.raises(ValueError, match=message):
        CameraMotion().update(**call)


def test_a_similarity_is_found_among_many_wrong_points() -> None:
    rng = np.random.default_rng(0)
    points = np.rint(rng.uniform(0, 300, (40, 2)))
    true = pose(3, -2, 0.03, 1.01)
    shifts = points @ true[:, :2].T + true[:, 2] - points
    shifts[:17] += rng.uniform(5, 30, (17, 2))
    found, off = fit_similarity(points, np.rint(shifts * 1024) / 1024, (180, 320), 0.5)
    assert apart(found, true) < 0.05
    assert (off[17:] < 0.1).all()
    assert (off[:17] > 1).all()
