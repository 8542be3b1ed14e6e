"""Textured blocks of a reference picture, and where each of them lies in a later one.

A block is followed by the gradient method of Lucas and Kanade in its inverse form: gradients belong to the reference
and are made once. Pictures hold whole numbers, offsets are multiples of 1/16 px, so all sums are exact in float64 and
do not depend on the order of addition.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lookonce.camera.pictures import Pyramid, gather, windows

__all__ = [
    "BLOCK_PX",
    "Blocks",
    "Matches",
    "choose_blocks",
    "coarse_shift",
    "follow",
    "follow_nearby",
    "shifts_from_rest",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Differences = NDArray[np.int16] | NDArray[np.float32]

BLOCK_PX = 16
_CELL = BLOCK_PX // 2  # of a block on the second level
_LEAST_RISE = 10.0  # mean change over two px of the second level, quarters of a grey level, in the flattest direction
_BOX_MARGIN = 2.0  # working px around an object's box that belong to it
_FRACTIONS = 16  # of a px, in which patches are read between pixels
_STEP_PX = 1.5  # the gradient method is blind farther than this
_NEAR_PX, _FEW_SHARE = 0.75, 0.1  # where no more than a few blocks went farther in one step, one is enough
_LARGEST_APART = 40  # quarters of a grey level by which two pixels count: objects that move on their own differ by more
_LARGEST_ERROR = 0.35  # of the block's own variance: a worse match is none
_COARSE_PX = (3, 5)  # of the smallest level, down and across
_FINE_PX = 1


@dataclass(frozen=True, slots=True)
class _Patches:
    """Patches of the blocks on one level, with what the gradient method needs.

    Attributes:
        tops: (N,) first row of each patch on its level.
        lefts: (N,) first column.
        values: (N, side²) int16.
        gradients: (2, N, side²) float64 across and down, twice the slope, without their mean.
        inverse: (2, 2, N) of the matrices of the gradients, times -2.
    """

    tops: Ints
    lefts: Ints
    values: NDArray[np.int16]
    gradients: Floats
    inverse: Floats


@dataclass(frozen=True)
class Blocks:
    """Textured blocks of a reference picture; N of them.

    Attributes:
        picture: the reference.
        centres: (N, 2) x and y in working px.
        low: patches on the first level.
        variances: (N,) of the values on the first level, times their number.
    """

    picture: Pyramid
    centres: Floats
    low: _Patches
    variances: Floats

    @cached_property
    def high(self) -> _Patches:
        """Patches on the second level, around the same centres where there is room."""
        picture = self.picture.level(1)
        top, left = (
            np.clip((first + _CELL) // 2 - _CELL, 1, side - BLOCK_PX - 1)
            for first, side in zip((self.low.tops, self.low.lefts), picture.shape, strict=True)
        )
        return _patches(picture, top, left)

    def __len__(self) -> int:
        return len(self.centres)


@dataclass(frozen=True, slots=True)
class Matches:
    """Where blocks went; N of them.

    Attributes:
        shifts: (N, 2) across and down in working px, multiples of 1/1024.
        is_found: (N,) bool: the block was found again.
        is_seen: (N,) bool: it could have been: it lies in the picture and no object covers it.
    """

    shifts: Floats
    is_found: NDArray[np.bool_]
    is_seen: NDArray[np.bool_]


def choose_blocks(pyramid: Pyramid, boxes: Floats) -> Blocks | None:
    """The blocks of a picture with most texture, spread over it.

    Args:
        pyramid: the picture.
        boxes: xyxy (M, 4) in working px: objects, whose blocks are left out.

    Returns:
        Up to one block of every four; None where the picture is too small for any, or has none.
    """
    high = pyramid.level(1).astype(np.int32)
    rows, columns = ((side - 2) // _CELL - 1 for side in high.shape)
    if rows < 1 or columns < 1 or min(high.shape) < BLOCK_PX + 4:
        return None
    first = _CELL // 2  # blocks stay half a block away from the border
    part = high[first - 1 : first + rows * _CELL + 1, first - 1 : first + columns * _CELL + 1]
    across, down = part[1:-1, 2:] - part[1:-1, :-2], part[2:, 1:-1] - part[:-2, 1:-1]
    xx, xy, yy = (_cell_sums(product, rows, columns) for product in (across * across, across * down, down * down))
    strength = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)  # the smaller eigenvalue
    tops = (np.arange(rows) * _CELL + first) * 2
    lefts = (np.arange(columns) * _CELL + first) * 2
    corners = np.empty((rows, columns, 2))
    corners[:, :, 0], corners[:, :, 1] = lefts, tops[:, None]
    corners = corners.reshape(-1, 2)
    strength[_is_covered(corners, boxes).reshape(rows, columns)] = 0.0
    chosen = _best_of_four(strength)
    chosen = chosen[strength.reshape(-1)[chosen] >= _CELL**2 * _LEAST_RISE**2]
    if not len(chosen):
        return None
    top, left = tops[chosen // columns], lefts[chosen % columns]
    low = _patches(pyramid.level(0), top, left)
    return Blocks(pyramid, corners[chosen] + _CELL, low, _errors(low.values))


def _cell_sums(products: NDArray[np.int32], rows: int, columns: int) -> Floats:
    by_row = products.reshape(rows, _CELL, columns * _CELL).sum(axis=1, dtype=np.int32)  # below 64 * 1020²
    sums: Floats = by_row.reshape(rows, columns, _CELL).sum(axis=2, dtype=np.int32).astype(np.float64)
    return sums


def _best_of_four(strength: Floats) -> Ints:
    """Flat numbers of the strongest of every two by two blocks."""
    down, across = (np.minimum(np.arange(side + side % 2), side - 1).reshape(-1, 2) for side in strength.shape)
    fours = down[:, None, :, None] * strength.shape[1] + across[None, :, None, :]  # the last row or column may be twice
    fours = fours.reshape(-1, 4)
    best = strength.reshape(-1)[fours].argmax(axis=1)
    chosen: Ints = fours[np.arange(len(best)), best].astype(np.int64)
    return chosen


def _is_covered(corners: Floats, boxes: Floats) -> NDArray[np.bool_]:
    """Which blocks (N,), given by left and top (N, 2), touch a box (M, 4), all in working px."""
    if not len(boxes):
        return np.zeros(len(corners), np.bool_)
    near, far = corners[:, None, :] - _BOX_MARGIN, corners[:, None, :] + (BLOCK_PX + _BOX_MARGIN)
    is_beside: NDArray[np.bool_] = (near >= boxes[None, :, 2:]) | (far <= boxes[None, :, :2])  # (N, M, 2)
    touches: NDArray[np.bool_] = ~np.all(np.any(is_beside, axis=2), axis=1)
    return touches


def _patches(picture: NDArray[np.int16], tops: Ints, lefts: Ints) -> _Patches:
    wide = gather(picture, tops - 1, lefts - 1, BLOCK_PX + 2)
    slopes = np.empty((2, len(tops), BLOCK_PX, BLOCK_PX))
    np.subtract(wide[:, 1:-1, 2:], wide[:, 1:-1, :-2], out=slopes[0])
    np.subtract(wide[:, 2:, 1:-1], wide[:, :-2, 1:-1], out=slopes[1])
    gradients = slopes.reshape(2, len(tops), -1)
    gradients -= gradients.sum(axis=2, keepdims=True) / BLOCK_PX**2  # a power of two: the mean is exact
    xx, yy = np.einsum("knp,knp->kn", gradients, gradients)
    xy = np.einsum("np,np->n", gradients[0], gradients[1])
    inverse = np.array([[yy, -xy], [-xy, xx]]) * (-2.0 / np.maximum(xx * yy - xy * xy, 1.0))
    return _Patches(tops, lefts, wide[:, 1:-1, 1:-1].reshape(len(tops), -1), gradients, inverse)


def _steps(patches: _Patches, differences: _Differences) -> Floats:
    """Shifts (N, 2) that the gradient method reads from what patches differ by (N, P), in px of the level."""
    slopes = np.einsum("knp,np->kn", patches.gradients, differences.astype(np.float64))
    from_x, from_y = patches.inverse * slopes[:, None]
    steps = from_x + from_y
    limited: Floats = np.minimum(np.maximum(steps, -_STEP_PX), _STEP_PX)
    return limited.T


def _placed(
    picture: NDArray[np.int16], patches: _Patches, shifts: Ints, extra: int = 0
) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
    """Patches (N, side, side) at whole shifts (N, 2), moved back into the picture; and which needed no moving."""
    side = BLOCK_PX + extra
    height, width = picture.shape
    tops, lefts = patches.tops + shifts[:, 1], patches.lefts + shifts[:, 0]
    inside_tops = np.minimum(np.maximum(tops, 0), height - side)  # cheaper than clip
    inside_lefts = np.minimum(np.maximum(lefts, 0), width - side)
    found = gather(picture, inside_tops, inside_lefts, side)
    return found, (inside_tops == tops) & (inside_lefts == lefts)


def _differences(picture: NDArray[np.int16], patches: _Patches, shifts: Ints) -> NDArray[np.int16]:
    found, _ = _placed(picture, patches, shifts)
    return found.reshape(len(found), -1) - patches.values


def shifts_from_rest(blocks: Blocks, now: Pyramid, boxes: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """First guesses (N, 2) for blocks that have hardly moved, working px, and which blocks (N,) can be seen.

    A guess is infinite where there is something else now: pixels that have nothing to do with each other often seem to
    have hardly moved.
    """
    differences = _differences(now.level(0), blocks.low, np.zeros((len(blocks), 2), np.int64))
    shifts = _steps(blocks.low, differences)
    shifts[_errors(differences) > _LARGEST_ERROR * blocks.variances] = np.inf
    return shifts, ~_is_covered(blocks.centres - _CELL, boxes)


def follow(blocks: Blocks, now: Pyramid, boxes: Floats, guesses: Floats) -> Matches:
    """Where the blocks lie in another picture.

    Args:
        blocks: of the reference.
        now: the other picture, of the same size.
        boxes: xyxy (M, 4) in working px of its objects.
        guesses: (G, N, 2) where each block may have gone, working px; the one whose pixels fit best is taken.
    """
    high, picture = blocks.high, now.level(1)
    wholes, differences = _best_guess(blocks, picture, guesses)
    wholes = np.rint(wholes + _steps(high, differences)).astype(np.int64)
    differences = _differences(picture, high, wholes)
    return follow_nearby(blocks, now, boxes, 2 * (wholes + _steps(high, differences)))


def follow_nearby(blocks: Blocks, now: Pyramid, boxes: Floats, shifts: Floats) -> Matches:
    """As ``follow``, for blocks of which it is known to within a px or two where they went: ``shifts`` (N, 2)."""
    low, picture = blocks.low, now.level(0)
    for _ in range(2):
        wholes = np.rint(shifts).astype(np.int64)
        steps = _steps(low, _differences(picture, low, wholes))
        shifts = wholes + steps
        if np.count_nonzero(np.abs(steps) > _NEAR_PX) <= _FEW_SHARE * steps.size:
            break
    sixteenths = np.rint(shifts * _FRACTIONS).astype(np.int64)
    differences, is_inside = _differences_between(picture, low, sixteenths)
    is_alike = _errors(differences) <= _LARGEST_ERROR * blocks.variances
    last = _steps(low, differences)
    shifts = np.rint((sixteenths / _FRACTIONS + last) * 1024) / 1024
    is_seen = is_inside & ~_is_covered(blocks.centres - _CELL + shifts, boxes)
    return Matches(shifts, is_alike & is_seen & (np.abs(last) < 0.5).all(axis=1), is_seen)


def _best_guess(blocks: Blocks, picture: NDArray[np.int16], guesses: Floats) -> tuple[Ints, NDArray[np.int16]]:
    wholes = np.rint(guesses / 2).astype(np.int64)
    found = [_differences(picture, blocks.high, one) for one in wholes]
    if len(found) == 1:
        return wholes[0], found[0]
    best, rows = np.argmin([_errors(one) for one in found], axis=0), np.arange(len(blocks))
    return wholes[best, rows], np.stack(found)[best, rows]


def _errors(differences: _Differences) -> Floats:
    """Squares of differences (N, P), summed (N,), when their mean has been taken off: light may change."""
    exact = differences.astype(np.float64)
    squares: Floats = np.einsum("np,np->n", exact, exact)
    squares -= exact.sum(axis=1) ** 2 / exact.shape[1]
    return squares


def _differences_between(
    picture: NDArray[np.int16], patches: _Patches, sixteenths: Ints
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """As ``_differences`` at shifts in sixteenths of a px, read linearly between pixels."""
    wholes = sixteenths >> 4
    found, is_inside = _placed(picture, patches, wholes, extra=1)
    across, down = (sixteenths - (wholes << 4)).T.astype(np.int16)[:, :, None, None]
    lines = found[:, :, :-1] * (_FRACTIONS - across)  # below 2¹⁵
    lines += found[:, :, 1:] * across
    values, share = lines.astype(np.float32), down.astype(np.float32) / _FRACTIONS**2
    values = values[:, :-1] * (1 / np.float32(_FRACTIONS) - share) + values[:, 1:] * share  # exact: below 2¹⁰ in 2⁻⁸
    return values.reshape(len(values), -1) - patches.values, is_inside


def coarse_shift(before: Pyramid, now: Pyramid) -> Floats:
    """The shift (2,) of the picture as a whole, across and down in working px, to within two of them."""
    start = _search(before.level(3), now.level(3), (0, 0), _COARSE_PX)
    down, across = _search(before.level(2), now.level(2), (2 * start[0], 2 * start[1]), (_FINE_PX, _FINE_PX))
    return np.array([4.0 * across, 4.0 * down])


def _search(
    before: NDArray[np.int16], now: NDArray[np.int16], start: tuple[int, int], reach: tuple[int, int]
) -> tuple[int, int]:
    """The shift (down, across) near ``start`` at which the middle of ``before`` differs least; the first of equals.

    Large differences count as one bound, so that what moves on its own does not decide.
    """
    margins = [min(abs(begin) + far, side // 3) for begin, far, side in zip(start, reach, before.shape, strict=True)]
    height, width = (side - 2 * margin for side, margin in zip(before.shape, margins, strict=True))
    template = before[margins[0] : margins[0] + height, margins[1] : margins[1] + width]
    lows = [max(-margin, begin - far) for margin, begin, far in zip(margins, start, reach, strict=True)]
    highs = [min(margin, begin + far) + 1 for margin, begin, far in zip(margins, start, reach, strict=True)]
    rows, columns = (slice(m + low, m + high) for m, low, high in zip(margins, lows, highs, strict=True))
    apart = windows(now, (height, width))[rows, columns] - template  # (down, across, height, width)
    light = np.rint(apart.sum(axis=(2, 3), dtype=np.int64) / (height * width)).astype(np.int16)
    errors = np.minimum(np.abs(apart - light[:, :, None, None]), _LARGEST_APART).sum(axis=(2, 3), dtype=np.int64)
    down, across = divmod(int(errors.argmin()), errors.shape[1])
    return lows[0] + down, lows[1] + across
