"""UA-DETRAC's protocol written out plainly: tables of frames by tracks, a picture of ignored pixels, loops."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.evaluation import TrackingResult, TrackingTruth


def nearest(number: float) -> int:
    return int(math.copysign(math.floor(abs(round(number, 6)) + 0.5), number))


def plain_figures(truth: TrackingTruth, result: TrackingResult, size: tuple[int, int]) -> dict[str, Any]:
    """The counts of one sequence in a picture of ``size`` (height, width)."""
    picture = _picture(truth.ignored, size)
    true = _true_boxes(truth, picture)
    found = _found_boxes(result, picture)
    objects, tracks = sorted({one for _, one in true}), sorted({track for _, track in found})
    matches: dict[tuple[int, int], int] = {}
    totals = {"fp": 0, "fn": 0, "switches": 0, "overlap": 0.0, "matches": 0}
    for frame in range(len(truth.frames)):
        here = _match(frame, objects, tracks, true, found, matches)
        for one, track in here.items():
            earlier = [at for at in range(frame) if (at, one) in matches]
            if (frame - 1, one) in true and earlier and matches[earlier[-1], one] != track:
                totals["switches"] += 1
            overlap = iou(true[frame, one], found[frame, track])
            totals["overlap"] += overlap if overlap >= 0.7 else 0.0
            matches[frame, one] = track
        totals["matches"] += len(here)
        totals["fn"] += sum((frame, one) in true for one in objects) - len(here)
        totals["fp"] += sum((frame, track) in found for track in tracks) - len(here)
    return totals | _trajectories(objects, true, matches, len(truth.frames))


def _match(frame, objects, tracks, true, found, matches):
    here = {}
    for one in objects:
        track = matches.get((frame - 1, one))
        if track is not None and (frame, one) in true and (frame, track) in found:
            if iou(true[frame, one], found[frame, track]) >= 0.7 * 0.8:
                here[one] = track
    while True:
        best, pair = 0.0, None
        for track in tracks:
            for one in objects:
                if one in here or track in here.values() or (frame, one) not in true or (frame, track) not in found:
                    continue
                overlap = iou(true[frame, one], found[frame, track])
                if overlap >= 0.7 and overlap > best:
                    best, pair = overlap, (one, track)
        if pair is None:
            return here
        here[pair[0]] = pair[1]


def _trajectories(objects, true, matches, frames):
    counts = {"mt": 0, "pt": 0, "ml": 0, "frag": 0}
    for one in objects:
        length = sum((frame, one) in true for frame in range(frames))
        tracked = [frame for frame in range(frames) if (frame, one) in matches]
        share = len(tracked) / length
        counts["ml" if share < 0.2 else "pt" if share <= 0.8 else "mt"] += 1
        states = [(frame, one) in matches for frame in range(tracked[0], tracked[-1] + 1)] if tracked else []
        counts["frag"] += sum(a and not b for a, b in pairwise(states))
    return counts


def _picture(regions: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels counted from 1."""
    picture = np.zeros((size[0] + 1, size[1] + 1), np.bool_)
    for left, top, right, bottom in regions.tolist():
        picture[max(1, nearest(top)) : nearest(bottom) + 1, max(1, nearest(left)) : nearest(right) + 1] = True
    return picture


def _is_ignored(picture, left, top, width, height):
    covered = picture[max(1, top) + 1 : max(0, top + height + 1), max(1, left) + 1 : max(0, left + width + 1)].sum()
    return covered / (width * height) >= 0.5


def _true_boxes(truth, picture):
    boxes, kept = {}, {}
    for frame, one, (left, top, right, bottom) in zip(truth.row_frames, truth.ids, truth.xyxy.tolist(), strict=True):
        box = [max(1, nearest(number)) for number in (left, top, right - left, bottom - top)]
        boxes[int(frame), int(one)] = box
        if not _is_ignored(picture, *box):
            first, last = kept.get(int(one), (frame, frame))
            kept[int(one)] = (min(first, frame), max(last, frame))
    return {
        (frame, one): box
        for (frame, one), box in boxes.items()
        if one in kept and kept[one][0] <= frame <= kept[one][1]
    }


def _found_boxes(result, picture):
    boxes = {}
    for frame, track, (left, top, right, bottom) in zip(
        result.row_frames, result.ids, result.xyxy.tolist(), strict=True
    ):
        if right <= left or bottom <= top:
            continue
        width, height = nearest(right - left), nearest(bottom - top)
        if width and height:
            x, y = nearest((left + right) / 2 - width / 2), nearest(bottom - height)
            if _is_ignored(picture, x, y, width, height):
                continue
        boxes[int(frame), int(track)] = [left, top, right - left, bottom - top]
    return boxes


def iou(a, b):
    wide = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    high = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    if wide <= 0 or high <= 0:
        return 0.0
    return wide * high / (a[2] * a[3] + b[2] * b[3] - wide * high)
