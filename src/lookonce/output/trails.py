"""The short path behind each identity: remembered for a while, drawn thinner and fainter towards its end."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.output.colours import track_colour
from lookonce.structures import NO_ID, Tracks

__all__ = ["NO_TRAILS", "TrailBrush", "TrailMemory", "Trails"]

_MAX_STEPS = 64  # moments kept of one trail, whatever the frame rate
_OPACITY = 0.9  # at the newest point
_TAIL_WIDTH = 0.4  # at the oldest point, of the width at the newest
_SAMPLE_SPACING = 0.75  # of the radius: the scallops between discs stay below a tenth of the radius


@dataclass(frozen=True, slots=True)
class Trails:
    """Where the identities were lately, oldest moment first.

    Attributes:
        ids: (M,) int64.
        points: (M, 2) float32, x, y of the box's bottom centre, px of the original image.
        freshness: (M,) float32, 1 = now, 0 = about to be forgotten.
    """

    ids: NDArray[np.int64]
    points: NDArray[np.float32]
    freshness: NDArray[np.float32]


NO_TRAILS = Trails(np.zeros(0, np.int64), np.zeros((0, 2), np.float32), np.zeros(0, np.float32))
"""For pictures that stand alone."""


class TrailMemory:
    """Remembers the last ``duration_s`` seconds of all identities; older moments are dropped, with ids that left.

    Args:
        duration_s: length of a trail in seconds, above 0.
    """

    def __init__(self, duration_s: float) -> None:
        if not duration_s > 0:
            raise ValueError(f"duration_s: expected more than 0, got {duration_s}")
        self._duration_s = duration_s
        self._moments: deque[tuple[float, NDArray[np.int64], NDArray[np.float32]]] = deque(maxlen=_MAX_STEPS + 2)

    def __len__(self) -> int:
        """The number of points remembered."""
        return sum(len(ids) for _, ids, _ in self._moments)

    def update(self, tracks: Tracks, time_s: float) -> Trails:
        """Add the frame at ``time_s`` and give the trails as they are now."""
        moments = self._moments
        if moments and time_s < moments[-1][0]:
            moments.clear()  # the source began again
        while moments and moments[0][0] <= time_s - self._duration_s:
            moments.popleft()
        # The newest moment is always kept; the one before it only at the pace that 64 steps a trail need.
        if len(moments) > 1 and moments[-1][0] - moments[-2][0] < self._duration_s / _MAX_STEPS:
            moments.pop()
        rows = (tracks.ids != NO_ID) & np.isfinite(tracks.xyxy).all(axis=1)
        xyxy = tracks.xyxy[rows]
        bottom_centre = np.stack([xyxy[:, 0] / 2 + xyxy[:, 2] / 2, xyxy[:, 3]], axis=1)
        moments.append((time_s, tracks.ids[rows], bottom_centre))
        return self._collect(time_s)

    def _collect(self, now_s: float) -> Trails:
        freshness = [np.full(len(ids), 1 - (now_s - t) / self._duration_s, np.float32) for t, ids, _ in self._moments]
        return Trails(
            np.concatenate([ids for _, ids, _ in self._moments]),
            np.concatenate([points for _, _, points in self._moments]),
            np.concatenate(freshness),
        )


class TrailBrush:
    """Draws trails as smooth lines that fade and thin.

    The lines are sampled as discs, all of them in one go, and each pixel takes the disc that covers it most: the cost
    grows with the length of the trails, not with the picture. The brush keeps one array of the picture's size between
    calls, because fresh memory for it would cost a good part of the drawing time.
    """

    def __init__(self) -> None:
        self._strongest = np.zeros(0, np.float32)  # by flat pixel index; all 0 between calls

    def paint_(self, image: NDArray[np.uint8], trails: Trails, width_px: float) -> None:
        """Draw into ``image``.

        Args:
            image: (H, W, 3) uint8 RGB, contiguous, modified.
            trails: the paths; parts outside the picture are skipped.
            width_px: width at the newest point.
        """
        height, width = image.shape[:2]
        centres, freshness, ids = _sample(trails, (height, width), _SAMPLE_SPACING * width_px / 2)
        if not len(ids):
            return
        radius = width_px / 2 * (_TAIL_WIDTH + (1 - _TAIL_WIDTH) * freshness)
        pixels, cover, samples = _cover(centres, radius, _OPACITY * freshness, (height, width))
        shown = self._is_strongest(pixels, cover, height * width)
        pixels, opacity, samples = pixels[shown], cover[shown, None], samples[shown]
        known, which = np.unique(ids, return_inverse=True)
        palette = np.array([track_colour(identity) for identity in known.tolist()], np.float32)
        flat = image.reshape(-1, 3)
        before = flat[pixels]
        flat[pixels] = (before + opacity * (palette[which[samples]] - before) + 0.5).astype(np.uint8)

    def _is_strongest(
        self, pixels: NDArray[np.int64], cover: NDArray[np.float32], pixel_count: int
    ) -> NDArray[np.bool_]:
        """(K,) bool: for each touch of a pixel (K,), whether no other touch of that pixel covers it more."""
        if len(self._strongest) != pixel_count:
            self._strongest = np.zeros(pixel_count, np.float32)
        np.maximum.at(self._strongest, pixels, cover)
        is_strongest: NDArray[np.bool_] = cover == self._strongest[pixels]
        self._strongest[pixels] = 0
        return is_strongest


def _sample(
    trails: Trails, size: tuple[int, int], spacing_px: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Points along the trails at most ``spacing_px`` apart: centres (S, 2), freshness (S,), ids (S,)."""
    order = np.argsort(trails.ids, kind="stable")  # stable: time order within an id
    ids, fresh = trails.ids[order], trails.freshness[order]
    # Far outside is as good as just outside, and keeps the number of samples bounded.
    points = np.clip(trails.points[order], -max(size), 2 * max(size))
    starts = np.flatnonzero(ids[1:] == ids[:-1])
    step = points[starts + 1] - points[starts]
    counts = np.ceil(np.hypot(step[:, 0], step[:, 1]) / spacing_px).astype(np.int64)
    segment = np.repeat(np.arange(len(starts)), counts)
    first = np.cumsum(counts) - counts
    along = ((np.arange(len(segment)) - first[segment] + 1) / counts[segment]).astype(np.float32)
    begin = starts[segment]
    centres = points[begin] + along[:, None] * step[segment]
    freshness = fresh[begin] + along * (fresh[begin + 1] - fresh[begin])
    return centres, freshness, ids[begin]


def _cover(
    centres: NDArray[np.float32], radius: NDArray[np.float32], opacity: NDArray[np.float32], size: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]:
    """The pixels under soft discs.

    Args:
        centres: (S, 2) float32, x, y in px.
        radius: (S,) float32, px.
        opacity: (S,) float32 in [0, 1], at the centre.
        size: (height, width) of the picture in px.

    Returns:
        For each of K touched pixels: its flat index (K,), how much it is covered (K,) in (0, 1], by which sample (K,).
    """
    reach = float(radius.max()) + 0.5  # cells with their middle as near as this are touched
    first = np.ceil(centres - 0.5 - reach).astype(np.int64)  # (S, 2)
    steps = np.arange(int(2 * reach) + 1)  # (R,)
    across = _squared_offset(first[:, :1] + steps, centres[:, :1], size[1])
    down = _squared_offset(first[:, 1:] + steps, centres[:, 1:], size[0])
    squared = (down[:, :, None] + across[:, None, :]).reshape(len(centres), -1)  # (S, R * R)
    # Only what is near enough to be touched goes through the rest.
    touched = np.flatnonzero(squared < np.square(radius + 0.5)[:, None])
    sample = touched // squared.shape[1]
    cell = touched - sample * squared.shape[1]
    cover = np.minimum(radius[sample] + 0.5 - np.sqrt(squared.ravel()[touched]), 1) * opacity[sample]
    pixel_of_cell = (steps[:, None] * size[1] + steps).ravel()  # (R * R,)
    return (first[:, 1] * size[1] + first[:, 0])[sample] + pixel_of_cell[cell], cover, sample


def _squared_offset(cells: NDArray[np.int64], centre: NDArray[np.float32], limit: int) -> NDArray[np.float32]:
    """Squared distance on one axis from the middle of cells (S, R) to centres (S, 1); infinite off the picture."""
    squared: NDArray[np.float32] = np.square(cells + np.float32(0.5) - centre, dtype=np.float32)
    squared[(cells < 0) | (cells >= limit)] = np.inf
    return squared
