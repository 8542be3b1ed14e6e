"""Pictures for the moments of a report: which ones get some, and what is drawn over them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.report.pictures import backdrop, cut, frames_of
from lookonce.report.views import DrawnBox, Moment, SequenceView, Tile

__all__ = ["Wanted", "choose_moments", "illustrate"]

_MOST_DRAWN = 12  # boxes over a picture


@dataclass(frozen=True, slots=True)
class Wanted:
    """The moments of a view, by place, that get pictures."""

    view: SequenceView
    places: tuple[int, ...]


def choose_moments(views: Sequence[SequenceView], most: int) -> list[Wanted]:
    """Fair shares of at most so many moments, in each view evenly spread over time.

    >>> choose_moments([], 5)
    []
    """
    counts = [sum(one.xyxy is not None for one in view.moments) for view in views]
    shares = [0] * len(views)
    rest = min(most, sum(counts))
    while rest:
        open_views = [number for number, count in enumerate(counts) if shares[number] < count]
        each = max(1, rest // len(open_views))
        for number in open_views:
            more = min(each, counts[number] - shares[number], rest)
            shares[number] += more
            rest -= more
    wanted = []
    for view, share in zip(views, shares, strict=True):
        shown = [place for place, one in enumerate(view.moments) if one.xyxy is not None]
        chosen = np.unique(np.linspace(0, len(shown) - 1, share).round().astype(np.int64)).tolist()
        wanted.append(Wanted(view, tuple(shown[place] for place in chosen)))
    return wanted


def illustrate(
    wanted: Sequence[Wanted], source: Path, on_frame: Callable[[int, int], None]
) -> tuple[list[SequenceView], list[str]]:
    """The views of one sequence with pictures, each frame read once for all runs; and what went wrong.

    Args:
        wanted: views of the same sequence, of one run or several.
        source: its pictures.
        on_frame: told how many frames of how many are done.

    Raises:
        VideoError: the pictures cannot be read at all.
    """
    frames: defaultdict[int, list[tuple[int, int, bool]]] = defaultdict(list)  # -> view, moment, whether it is after
    for number, one in enumerate(wanted):
        for place in one.places:
            moment = one.view.moments[place]
            frames[moment.frame].append((number, place, True))
            if moment.xyxy_before is not None:
                frames[moment.frame_before].append((number, place, False))
    first = min((view.view.timeline.first_frame(0) for view in wanted), default=0)
    needed = {first, *frames} if any(one.view.places is not None for one in wanted) else set(frames)
    tiles: dict[tuple[int, int, bool], Tile] = {}
    behind, misfits = "", 0
    for frame in frames_of(source, needed, lambda done: on_frame(done, len(needed))):
        if any(one.view.size not in (None, frame.size) for one in wanted):
            misfits += 1
            continue
        image = frame.image
        behind = behind or backdrop(image)
        for number, place, is_after in frames[frame.index]:
            view = wanted[number].view
            tiles[number, place, is_after] = _tile(view, view.moments[place], is_after, image)
    views = []
    for number, one in enumerate(wanted):
        moments = list(one.view.moments)
        for place in one.places:
            both = [tiles[key] for is_after in (False, True) if (key := (number, place, is_after)) in tiles]
            moments[place] = replace(moments[place], tiles=tuple(both))
        places = one.view.places
        if places is not None and behind:
            places = replace(places, backdrop=behind)
        views.append(replace(one.view, moments=tuple(moments), places=places))
    notes = [f"{misfits:,} frames have another size than the run's and are not shown"] if misfits else []
    return views, notes


def _tile(view: SequenceView, moment: Moment, is_after: bool, image: NDArray[np.uint8]) -> Tile:
    xyxy = moment.xyxy if is_after else moment.xyxy_before
    frame = moment.frame if is_after else moment.frame_before
    assert xyxy is not None  # moments without are not wanted
    crop = cut(image, xyxy)
    left, top, right, bottom = crop.window
    result = view.result
    rows = np.flatnonzero(result.row_frames == frame)
    boxes = result.xyxy[rows]
    inside = (boxes[:, 0] < right) & (boxes[:, 2] > left) & (boxes[:, 1] < bottom) & (boxes[:, 3] > top)
    rows = rows[inside]
    middle = (xyxy[:2] + xyxy[2:]) / 2
    apart = np.abs((result.xyxy[rows, :2] + result.xyxy[rows, 2:]) / 2 - middle).sum(axis=1)
    rows = rows[np.argsort(apart, kind="stable")][:_MOST_DRAWN]
    drawn = [DrawnBox(_corners(result.xyxy[row]), int(result.ids[row])) for row in rows.tolist()]
    if view.truth is not None:
        drawn.append(DrawnBox(_corners(xyxy), -1, True))
    return Tile(frame, crop, tuple(drawn))


def _corners(xyxy: NDArray[np.float64]) -> tuple[float, float, float, float]:
    left, top, right, bottom = xyxy.tolist()
    return left, top, right, bottom
