"""How the camera moved from frame to frame: not at all, or a shift, turn and zoom that most of the picture shows."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lookonce.camera.blocks import Blocks, Matches, choose_blocks, coarse_shift, follow, follow_nearby, shifts_from_rest
from lookonce.camera.pictures import Pyramid, make_pyramid, pyramid_of_level
from lookonce.camera.similarity import apply, compose, fit_similarity, identity, invert, largest_shift
from lookonce.camera.state import CameraState, read_state, write_state
from lookonce.structures import check_array, check_finite

__all__ = ["CameraMotion"]

Floats = NDArray[np.float64]

_LEAST_BLOCKS = 8
_REST_PX = 0.3  # working px; less is noise, or no matter to any box
_RESTING_SHARE = 0.5  # of the blocks in sight that have not moved: the camera has not either
_AGREEING_SHARE = 0.5  # of the blocks in sight that a motion must explain
_CLEAR_SHARE = 0.8  # of the blocks in sight that are found near to where they were expected: no need to look farther
_LEFT_BEHIND_SHARE = 0.25  # of the blocks in sight that may rest while the others move: a bonnet, a logo, a clock
_TOLERANCE_PX = 0.5  # working px by which a block may be off, and of the motion this share:
_TOLERANCE_SHARE = 0.1
_LARGEST_ZOOM, _LARGEST_TURN, _LARGEST_SHIFT = 0.12, 0.15, 0.3  # share, radians, share of the longer side
_FAR_PX = 8.0  # a reference that is farther away than this, in working px, is replaced,
_OLD_S = 3.0  # and one that is older,
_WORN_SHARE = 0.6  # and one of whose blocks fewer are in sight
_STILL_AFTER_S = 1.0  # without motion
_ASLEEP_AFTER_S = 2.0
_LOOK_EVERY_S = 0.2
_LEAST_OF_A_QUARTER = 3  # blocks, to be asked whether a motion holds there
_ROUNDING_S = 1e-6  # of clocks that count in frames
_USUAL_FRAME_S = 0.04  # where nobody gives the time


@dataclass(frozen=True, slots=True)
class _Seen:
    """A frame that was given: its picture is looked at only when it is needed.

    Attributes:
        luma: (h, w) uint8, not copied.
        xyxy: (M, 4) boxes in px of the frame.
        size: (height, width) of the frame.
        time_s: when it was.
    """

    luma: NDArray[np.uint8]
    xyxy: NDArray[np.float32]
    size: tuple[int, int]
    time_s: float

    def boxes(self, picture: Pyramid) -> Floats:
        """The boxes in px of its working picture."""
        down, across = _scales(self.size, picture)
        boxes: Floats = self.xyxy.astype(np.float64) * np.array([across, down, across, down])
        return boxes


_NO_FRAME = _Seen(np.zeros((0, 0), np.uint8), np.zeros((0, 4), np.float32), (1, 1), 0.0)


@dataclass(frozen=True, slots=True)
class _Reference:
    """A frame with which later ones are compared.

    Attributes:
        picture: its pictures.
        boxes: (M, 4) of its objects, working px.
        blocks: to be followed; None where there are none.
        time_s: when it was.
    """

    picture: Pyramid
    boxes: Floats
    blocks: Blocks | None
    time_s: float

    @classmethod
    def of(cls, picture: Pyramid, boxes: Floats, time_s: float) -> _Reference:
        """With the blocks of a picture."""
        return cls(picture, boxes, choose_blocks(picture, boxes), time_s)


class CameraMotion:
    """Tells how the picture as a whole moved from frame to frame, apart from the objects in it.

    Blocks with texture outside the objects' boxes are followed, and a similarity (shift, turn, zoom) is fitted that
    most of them agree on. A camera that stands still gives exactly the identity. After two seconds without motion the
    picture is looked at five times a second only; the frame in which motion is noticed is compared with the one before.
    The same frames give the same bytes on every machine.

    An instance belongs to one stream. It keeps the last picture without copying it: do not write into it.

    >>> import numpy as np
    >>> camera = CameraMotion()
    >>> camera.update(np.zeros((90, 160), np.uint8), np.zeros((0, 4), np.float32), (540, 960))
    array([[1., 0., 0.],
           [0., 1., 0.]])
    """

    def __init__(self) -> None:
        self._last: _Seen | None = None
        self._begin(0.0)

    def update(
        self,
        luma: NDArray[np.uint8],
        xyxy: NDArray[np.float32],
        size: tuple[int, int],
        time_s: float | None = None,
    ) -> NDArray[np.float64]:
        """Where pixels of the previous frame are in this one.

        Args:
            luma: (h, w) uint8, the frame's grey picture (or its green), at any scale; 320 px across or more are best.
            xyxy: (M, 4) float32, boxes of this frame's objects in its own px; their insides are not looked at.
            size: (height, width) of the frame in px, of which ``luma`` shows all.
            time_s: when it was taken; without it, 25 frames are a second.

        Returns:
            (2, 3) float64 ``A`` in px of the frame: ``A[:, :2] @ (x, y) + A[:, 2]`` is where (x, y) of the previous
            frame is now. Exactly the identity if nothing moved, if it cannot be told, and for a stream's first frame.

        Raises:
            ValueError: a wrong shape or dtype, an empty picture, or a time that is not finite.
        """
        _check(luma, xyxy, size, time_s)
        before = self._last
        if time_s is None:
            time_s = 0.0 if before is None else before.time_s + _USUAL_FRAME_S
        now = self._last = _Seen(luma, xyxy, size, time_s)
        if before is None or not _can_follow(before, now):
            self._begin(time_s)
            before = now
        if self._is_asleep(time_s):
            return identity()
        self._looked_s = time_s
        picture = make_pyramid(luma)
        step = self._wait(before, now, picture) if self._is_still else self._go_on(now, picture)
        return identity() if step is None else _to_frame(step, size, picture)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all that it remembers to one file; :meth:`load` goes on with it as if nothing had happened.

        Raises:
            OutputError: it cannot be written.
        """
        last, reference = self._last or _NO_FRAME, self._reference
        motions = [self._pose, self._wander, identity() if self._step is None else self._step]
        times = [last.time_s, 0.0 if reference is None else reference.time_s, self._moved_s, self._looked_s]
        state = CameraState(
            self._is_still,
            self._step is not None,
            (int(last.size[0]), int(last.size[1])),
            last.luma,
            last.xyxy,
            np.zeros((0, 0), np.int16) if reference is None else reference.picture.level(0),
            np.zeros((0, 4)) if reference is None else reference.boxes,
            np.stack(motions),
            np.array(times),
        )
        write_state(Path(path), state)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """As it was when it was saved; the file is checked, and nothing in it is unpickled or run.

        Raises:
            FormatError: the file is something else, of another version, damaged or cut short.
        """
        state, camera = read_state(Path(path)), cls()
        (height, width), times = state.luma.shape, state.times.tolist()
        if state.has_frame:
            camera._last = _Seen(state.luma, state.xyxy, state.size, times[0])
        if state.has_reference:
            picture = pyramid_of_level(state.reference, (height, width))
            camera._reference = _Reference.of(picture, state.reference_boxes, times[1])
        camera._pose, camera._wander, step = state.motions
        camera._step = step if state.has_step else None
        camera._is_still, camera._moved_s, camera._looked_s = state.is_still, times[2], times[3]
        return camera

    def _begin(self, time_s: float) -> None:
        """Forgets everything but the frame before."""
        self._reference: _Reference | None = None
        self._pose = identity()  # from the reference to the last frame, working px
        self._wander = identity()  # since the camera was last said to move
        self._step: Floats | None = None  # the last motion, if it is known
        self._is_still, self._moved_s, self._looked_s = True, time_s, -math.inf

    def _is_asleep(self, time_s: float) -> bool:
        has_rested = self._is_still and time_s - self._moved_s >= _ASLEEP_AFTER_S
        return has_rested and time_s - self._looked_s < _LOOK_EVERY_S - _ROUNDING_S

    def _wait(self, before: _Seen, now: _Seen, picture: Pyramid) -> Floats | None:
        """Looks whether a camera that stood still has begun to move."""
        reference, boxes = self._reference, now.boxes(picture)
        if reference is None or reference.blocks is None:
            self._reference = _Reference.of(picture, boxes, now.time_s)
            return None
        guesses, is_seen = shifts_from_rest(reference.blocks, picture, boxes)
        in_sight = int(is_seen.sum())
        if in_sight < _LEAST_BLOCKS or _resting(guesses[is_seen]) >= _RESTING_SHARE * in_sight:
            if now.time_s - reference.time_s >= _OLD_S or in_sight < _WORN_SHARE * len(is_seen):
                self._reference = _Reference.of(picture, boxes, now.time_s)
            return None
        moved = None
        if _resting(guesses[is_seen]) <= _LEFT_BEHIND_SHARE * in_sight:  # else something large passes by
            moved = _estimate(reference, picture, boxes, [identity()])
        self._reference = _Reference.of(picture, boxes, now.time_s)
        if moved is None or largest_shift(moved, picture.shape) < _REST_PX:
            return None
        self._is_still, self._moved_s = False, now.time_s
        self._pose, self._wander, self._step = identity(), identity(), moved
        if before.time_s > reference.time_s:  # it may have begun some frames ago
            there = make_pyramid(before.luma)
            earlier = _Reference.of(there, before.boxes(there), before.time_s)
            self._step = _estimate(earlier, picture, boxes, [identity(), moved])
        return self._step

    def _go_on(self, now: _Seen, picture: Pyramid) -> Floats | None:
        """Follows a camera that moves."""
        reference, boxes = self._reference, now.boxes(picture)
        assert reference is not None
        expected = [self._pose] if self._step is None else [self._pose, compose(self._step, self._pose)]
        moved = _estimate(reference, picture, boxes, expected)
        step = None if moved is None else compose(moved, invert(self._pose))
        self._step = step
        if moved is not None and step is not None:
            self._pose = moved
            self._wander = compose(step, self._wander)
            if largest_shift(self._wander, picture.shape) >= _REST_PX:
                self._wander, self._moved_s = identity(), now.time_s
        is_far = moved is None or largest_shift(moved, picture.shape) > _FAR_PX
        if is_far or now.time_s - reference.time_s >= _OLD_S:
            self._reference, self._pose = _Reference.of(picture, boxes, now.time_s), identity()
        if now.time_s - self._moved_s >= _STILL_AFTER_S:
            self._reference, self._pose, self._is_still = _Reference.of(picture, boxes, now.time_s), identity(), True
        return step


def _check(luma: NDArray[np.uint8], xyxy: NDArray[np.float32], size: tuple[int, int], time_s: float | None) -> None:
    check_array("luma", luma, (None, None), np.uint8)
    check_array("xyxy", xyxy, (None, 4), np.float32)
    check_finite("xyxy", xyxy)
    if 0 in luma.shape or min(size) <= 0:
        raise ValueError(f"luma: expected a picture with pixels, got {luma.shape} of a frame of {size}")
    if time_s is not None and not math.isfinite(time_s):
        raise ValueError(f"time_s: expected finite seconds, got {time_s}")


def _can_follow(before: _Seen, now: _Seen) -> bool:
    return before.luma.shape == now.luma.shape and before.size == now.size and now.time_s >= before.time_s


def _scales(size: tuple[int, int], picture: Pyramid) -> tuple[float, float]:
    """Working px for one px of the frame, down and across."""
    down, across = (small / (picture.factor * side) for small, side in zip(picture.size, size, strict=True))
    return down, across


def _to_frame(affine: Floats, size: tuple[int, int], picture: Pyramid) -> Floats:
    """An affine of working px as one of the frame's own."""
    down, across = _scales(size, picture)
    (a, b, c), (d, e, f) = affine.tolist()
    return np.array([[a, b * down / across, c / across], [d * across / down, e, f / down]])


def _resting(shifts: Floats) -> int:
    """How many of the blocks (N, 2) have not moved."""
    return int(((shifts * shifts).sum(axis=1) <= _REST_PX**2).sum())


def _estimate(reference: _Reference, picture: Pyramid, boxes: Floats, expected: list[Floats]) -> Floats | None:
    """The motion from the reference to a picture, working px; None if it cannot be told.

    Args:
        reference: where it starts.
        picture: where it ends.
        boxes: (M, 4) of the objects in it, working px.
        expected: motions that would be no surprise.
    """
    blocks = reference.blocks
    if blocks is None or len(blocks) < _LEAST_BLOCKS:
        return None
    *_, likely = expected
    if len(expected) > 1:
        matches = follow_nearby(blocks, picture, boxes, apply(likely, blocks.centres) - blocks.centres)
        if np.count_nonzero(matches.is_found) >= _CLEAR_SHARE * np.count_nonzero(matches.is_seen):
            found = _judge(matches, blocks, picture.shape)
            if found is not None:
                return found
    guesses = np.stack([apply(affine, blocks.centres) - blocks.centres for affine in expected])
    matches = follow(blocks, picture, boxes, guesses)
    found = _judge(matches, blocks, picture.shape)
    if found is not None or np.count_nonzero(matches.is_found) >= _AGREEING_SHARE * np.count_nonzero(matches.is_seen):
        return found  # what was found and does not agree would not agree better if it were looked for elsewhere
    surprise = np.broadcast_to(coarse_shift(reference.picture, picture), guesses[:1].shape)
    return _judge(follow(blocks, picture, boxes, np.concatenate([guesses, surprise])), blocks, picture.shape)


def _judge(matches: Matches, blocks: Blocks, shape: tuple[int, int]) -> Floats | None:
    """The motion that the matches agree on; None where too few do, or it is none that a camera makes."""
    in_sight, found = np.count_nonzero(matches.is_seen), matches.is_found
    enough = max(_LEAST_BLOCKS, _AGREEING_SHARE * in_sight)
    if in_sight < _LEAST_BLOCKS or np.count_nonzero(found) < enough:
        return None
    points, shifts = blocks.centres[found], matches.shifts[found]
    typical = float(np.sort(np.abs(shifts).sum(axis=1))[len(shifts) // 2])
    tolerance = _TOLERANCE_PX + _TOLERANCE_SHARE * typical
    affine, off = fit_similarity(points, shifts, shape, tolerance)
    agrees = off <= tolerance
    if np.count_nonzero(agrees) < enough or not _is_possible(affine, shape):
        return None
    if _resting(shifts[~agrees]) > _LEFT_BEHIND_SHARE * in_sight:
        return None
    return affine if _is_spread(points[agrees], blocks.centres[matches.is_seen], shape) else None


def _is_possible(affine: Floats, shape: tuple[int, int]) -> bool:
    (a, _, c), (d, _, f) = affine.tolist()
    height, width = shape
    middle = a * width / 2 - d * height / 2 + c - width / 2, d * width / 2 + a * height / 2 + f - height / 2
    return (
        abs(a - 1) <= _LARGEST_ZOOM
        and abs(d) <= _LARGEST_TURN
        and math.hypot(*middle) <= _LARGEST_SHIFT * max(height, width)
    )


def _is_spread(agreeing: Floats, seen: Floats, shape: tuple[int, int]) -> bool:
    """Whether a motion holds in most of the quarters of the picture in which blocks are in sight."""

    def by_quarter(points: Floats) -> NDArray[np.int64]:
        is_right, is_below = points[:, 0] > shape[1] / 2, points[:, 1] > shape[0] / 2
        return np.bincount(2 * is_below + is_right, minlength=4)

    in_sight = by_quarter(seen)
    fails = (in_sight >= _LEAST_OF_A_QUARTER) & (by_quarter(agreeing) * 3 < in_sight)
    return int(fails.sum()) <= 1
