"""The part of a page about one sequence: what each run did in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lookonce.report.markup import Content, Fragment, element, joined
from lookonce.report.mistakes import by_place
from lookonce.report.pictures import CROP_SIZE, heat
from lookonce.report.switches import KINDS, Switch
from lookonce.report.tables import count_table, decision_table, scrolled, size_table, table
from lookonce.report.timelines import colour_class, timeline_of_identities, timeline_of_objects
from lookonce.report.views import DrawnBox, Moment, Places, SequenceView, Tile

__all__ = ["sequence_article"]

_MISS_COLOUR, _FALSE_COLOUR = (230, 159, 0), (86, 180, 233)  # orange and sky blue of Okabe and Ito's palette
_MAP_WIDTH = 480
_FIRST_CARDS = 12  # the others are a click away, so that what follows can be reached


def sequence_article(views: Sequence[SequenceView], number: int, is_several: bool) -> Fragment:
    """All runs of one sequence, under its name; where the page has several runs, each is named."""
    name = views[0].sequence
    parts: list[Content] = []
    for view in views:
        if is_several:
            parts.append(element("h3", f"Run {view.run}"))
        parts.append(_of_run(view, "h4" if is_several else "h3"))
    return element(
        "article",
        element("h2", name, id=f"s{number}"),
        *parts,
        data_sequence=name,
        aria_labelledby=f"s{number}",
    )


def _of_run(view: SequenceView, level: str) -> Fragment:
    where = f"{view.sequence}, run {view.run}"
    lead = element("p", "; ".join(view.notes), class_="note")
    if view.truth is None:
        return joined(
            lead,
            element(level, "Identities over time"),
            timeline_of_identities(view.timeline, view.clock, f"Identities over time: {where}"),
            element(level, "How long identities are"),
            count_table("boxes of the identity", view.lengths),
            _decisions(view, level),
            _moments(view, level, where),
        )
    return joined(
        lead,
        element(level, "True objects over time"),
        timeline_of_objects(view.timeline, view.clock, f"True objects over time: {where}"),
        _moments(view, level, where),
        element(level, "Misses and false boxes"),
        _maps(view.places),
        scrolled(size_table(view.sizes), f"By size: {where}"),
        _decisions(view, level),
    )


def _decisions(view: SequenceView, level: str) -> Fragment | None:
    if not view.decisions:
        return None
    content = scrolled(decision_table(view.decisions), f"Decisions: {view.sequence}, run {view.run}")
    return joined(element(level, "What the tracker decided"), content)


def _moments(view: SequenceView, level: str, where: str) -> Fragment:
    """Switches, or doubts: a summary, some with pictures, and all in a table."""
    total = len(view.moments) + view.unlisted
    is_truth = view.truth is not None
    heading = element(level, f"Identity switches ({total:,})" if is_truth else f"Doubtful places ({total:,})")
    if not total:
        return joined(heading, element("p", _none(view), class_="note"))
    kinds = {KINDS[kind]: view.kinds[kind] for kind in KINDS if kind in view.kinds}
    cards = [_card(view, one, "h5" if level == "h4" else "h4") for one in view.moments if one.tiles]
    rest = total - len(cards)
    notes = [_where_from(view)]
    if cards and rest:
        notes.append(f"{len(cards):,} of {total:,} are shown in pictures, evenly spread over time.")
    if view.unlisted:
        notes.append(f"The table below has the first {len(view.moments):,}.")
    return joined(
        heading,
        count_table("where the new identity came from", kinds) if kinds else None,
        element("p", " ".join(filter(None, notes)), class_="note") if any(notes) else None,
        element("ol", *cards[:_FIRST_CARDS], class_="cards") if cards else None,
        _more_cards(cards[_FIRST_CARDS:]),
        element(
            "details",
            element("summary", f"{len(view.moments):,} as a table"),
            scrolled(_moment_table(view), f"{'Switches' if is_truth else 'Doubts'}: {where}"),
        ),
    )


def _more_cards(cards: Sequence[Fragment]) -> Fragment | None:
    if not cards:
        return None
    listed = element("ol", *cards, class_="cards")
    return element("details", element("summary", f"{len(cards):,} more in pictures"), listed)


def _none(view: SequenceView) -> str:
    if view.truth is not None:
        return "No object changed its identity."
    if view.decisions:
        return "Nothing that was decided by a hair, as far as the tracker says."
    return "No identity begins where another one has just ended."


def _where_from(view: SequenceView) -> str:
    """On what doubts rest, where there is no truth."""
    if view.truth is not None:
        return ""
    if view.decisions:
        return "Where the tracker nearly decided otherwise, as its explanation (explain.jsonl) says."
    return (
        "A guess from the boxes alone: an identity begins where another one has just ended. Of a run that explains "
        "itself (lookonce track --explain) the tracker's own doubts stand here."
    )


def _moment_table(view: SequenceView) -> Fragment:
    is_truth = view.truth is not None
    rows: list[list[Content]] = []
    for one in view.moments:
        about = _about(one.switch) if one.switch is not None else ""
        said = " ".join(filter(None, [about, *one.said]))
        last = view.clock.show(one.frame_before)
        rows.append([view.clock.show(one.frame), one.title, last, one.old_id, one.new_id, said])
    headings = ["frame", "object" if is_truth else "what", "seen before in", "identity before", "now", "what happened"]
    return table(headings, rows, texts=(1, 5))


def _about(switch: Switch) -> str:
    """What happened, in words."""
    parts = [KINDS[switch.kind]]
    if switch.other is not None:
        parts[0] += f" (object {switch.other})"
    for count, what in ((switch.missed, "missed"), (switch.absent, "absent")):
        if count:
            parts.append(f"{what} for {count:,} frame{'s' if count > 1 else ''}")
    return ", ".join(parts) + "."


def _card(view: SequenceView, moment: Moment, level: str) -> Fragment:
    about = _about(moment.switch) if moment.switch is not None else ""
    ids = [_id(view, moment.old_id), " → " if view.truth is not None else " or ", _id(view, moment.new_id)]
    return element(
        "li",
        element(level, f"Frame {view.clock.show(moment.frame)}: ", *ids),
        element("p", f"{moment.title[:1].upper()}{moment.title[1:]}", f": {about}" if about else ""),
        element("div", *(_figure(view, moment, tile) for tile in moment.tiles), class_="pair"),
        element("ul", *(element("li", text) for text in moment.said)) if moment.said else None,
        class_="card",
    )


def _id(view: SequenceView, identity: int) -> Fragment:
    return element("span", identity, class_=f"id {colour_class(view.timeline, identity)}")


def _figure(view: SequenceView, moment: Moment, tile: Tile) -> Fragment:
    is_after = tile.frame == moment.frame
    identity = moment.new_id if is_after else moment.old_id
    when = "now" if is_after else "before"
    alt = f"{moment.title} in frame {tile.frame}, {when}: identity {identity}"
    return element(
        "figure",
        _shot(view, tile, alt),
        element("figcaption", f"{when}, frame {tile.frame:,}"),
    )


def _shot(view: SequenceView, tile: Tile, alt: str) -> Fragment:
    """The picture, with boxes drawn over it in the colours of the timeline."""
    height, width = CROP_SIZE
    left, top, right, _ = tile.crop.window
    scale = width / (right - left)
    parts: list[Content] = [element("title", alt), element("image", href=tile.crop.uri, width=width, height=height)]
    for box in reversed(tile.boxes):  # the nearest one last, over the others; but the object itself under it
        x, y, x2, y2 = ((value - start) * scale for value, start in zip(box.xyxy, (left, top, left, top), strict=True))
        place = {"x": x, "y": y, "width": max(x2 - x, 0.1), "height": max(y2 - y, 0.1)}
        parts.append(element("rect", **place, class_="halo"))
        if box.is_true:
            parts.append(element("rect", **place, class_="true"))
            continue
        parts.append(element("rect", **place, class_=f"box {colour_class(view.timeline, box.id)}"))
        parts.append(_label(box, x, y, x2, y2))
    return element("svg", *parts, viewBox=f"0 0 {width} {height}", class_="shot", role="img", aria_label=alt)


def _label(box: DrawnBox, x: float, y: float, x2: float, y2: float) -> Fragment:
    """The identity above the box; below it where there is no room; always within the picture."""
    height, width = CROP_SIZE
    above, below = y - 4, min(y2, height) + 14
    baseline = above if above >= 12 else below if below <= height - 3 else max(14.0, y + 14)
    return element("text", box.id, x=min(max(x, 3.0), width - 30.0), y=baseline)


def _maps(places: Places | None) -> Fragment | None:
    """Where boxes were missed and where they were wrong, over a frame in grey."""
    if places is None:
        return None
    grids = [by_place(boxes, places.size) for boxes in (places.missed, places.wrong)]
    names = (("Missed", _MISS_COLOUR), ("False boxes", _FALSE_COLOUR))
    figures = []
    height = max(1, round(_MAP_WIDTH * places.size[0] / places.size[1]))
    for grid, (name, colour) in zip(grids, names, strict=True):
        most, total = int(grid.max(initial=0)), int(grid.sum())
        said = f"{name}: {total:,} boxes" + (f", at most {most:,} in one place" if most else "")
        area = {"width": _MAP_WIDTH, "height": height}
        layers: list[Content] = [element("title", said)]
        if places.backdrop:
            layers.append(element("image", href=places.backdrop, preserveAspectRatio="none", **area))
        if total:
            uri = heat(grid, colour, max(1, int(np.quantile(grid[grid > 0], 0.98))))
            layers.append(element("image", href=uri, preserveAspectRatio="none", **area))
        svg = element("svg", *layers, viewBox=f"0 0 {_MAP_WIDTH} {height}", class_="shot", role="img", aria_label=said)
        figures.append(element("figure", svg, element("figcaption", f"{said}. A box counts where its middle is.")))
    return element("div", *figures, class_="maps")
