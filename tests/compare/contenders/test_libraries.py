"""Trackers of others behind our adapters: rows keep their ids, and nothing of it is by luck of order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compare.moving import ids_by_lane, lane, make_sequence, nothing
from lookonce.compare.contenders.registry import CROPS, Contender, contenders

KNOWN = contenders()
FOREIGN = [one for one in KNOWN.values() if one.package]
OWN = [one for one in KNOWN.values() if not one.package]


def ready(contender: Contender) -> Contender:
    if not contender.is_installed:
        pytest.skip(f"the comparator {contender.package} is not installed; pip install 'lookonce[compare]'")
    return contender


@pytest.fixture(params=[*FOREIGN, *OWN], ids=lambda one: one.name)
def contender(request):
    return ready(request.param)


@pytest.mark.filterwarnings("ignore")
def test_two_objects_keep_apart_though_rows_change_places(contender):
    sequence, owners = make_sequence([lane(0), lane(200, 300, -3)], frames=20, mixed=True)
    ids = contender.answer(sequence).ids
    assert ids.shape == (40,)
    late = np.arange(40) >= 20  # trackers may wait before they trust a new object
    found = ids_by_lane(ids[late], owners[late])
    assert [len(one) for one in found] == [1, 1]
    assert found[0] != found[1]
    assert (ids[late] >= 0).all()


@pytest.mark.filterwarnings("ignore")
def test_nothing_gives_nothing(contender):
    assert contender.answer(nothing()).ids.tolist() == []


@pytest.mark.filterwarnings("ignore")
def test_empty_frames_between_do_no_harm(contender):
    sequence, _ = make_sequence([lane(0, hidden=(0, 7)), lane(200, hidden=(0, 7))], frames=16)
    ids = contender.answer(sequence).ids
    assert len(ids) == len(sequence)
    assert (ids >= 0).any()


@pytest.mark.filterwarnings("ignore")
def test_same_input_twice_gives_the_same_grouping(contender):
    sequence, _ = make_sequence([lane(0), lane(30, 60, -3), lane(70, 20, 2)], frames=16, mixed=True)
    first, second = contender.answer(sequence).ids, contender.answer(sequence).ids
    assert np.array_equal(first >= 0, second >= 0)
    pairs = set(zip(first.tolist(), second.tolist(), strict=True))  # ids may be counted on by the library
    assert len(pairs) == len(set(first.tolist())) == len(set(second.tolist()))


@pytest.mark.filterwarnings("ignore")
def test_id_is_given_once_a_frame(contender):
    lanes = [lane(top, 40 * (top % 3), 2) for top in (0, 15, 30, 45, 60)]
    sequence, _ = make_sequence(lanes, frames=16, mixed=True)
    ids = contender.answer(sequence).ids
    for frame in np.unique(sequence.row_frames):
        given = ids[(sequence.row_frames == frame) & (ids >= 0)]
        assert len(np.unique(given)) == len(given)


def test_trackers_that_need_descriptors_say_so():
    needy = {name for name, one in KNOWN.items() if one.needs_descriptors}
    assert {"visualsort", CROPS, "lookonce-paper"} <= needy
    assert not {"iou", "kiou", "gog", "sort"} & needy
    users = {name for name, one in KNOWN.items() if one.uses_descriptors}
    assert needy <= users
    assert not {"iou", "kiou", "gog", "sort"} & users


def test_every_preset_takes_part():
    from lookonce.tracking import PRESETS

    assert [name for name in KNOWN if name.startswith("lookonce-")] == [
        *(f"lookonce-{name}" for name in PRESETS),
        "lookonce-detected",
    ]


def test_calibrated_threshold_reaches_the_rule():
    """Looks that are 0.5 apart from frame to frame, 1 from the median of three: one object at 1.2, many at 0.3."""
    sequence, _ = make_sequence([lane(0)], frames=6)
    angle = 2 * np.arcsin(0.25) * np.arange(6)
    turned = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    wide, narrow = (replace(sequence, descriptors=turned, match_threshold=limit) for limit in (1.2, 0.3))
    paper = KNOWN["lookonce-paper"]
    assert len(set(paper.answer(wide).ids.tolist())) == 1
    assert len(set(paper.answer(narrow).ids.tolist())) == 6


class TestFlow:
    """GOG in detail."""

    @pytest.fixture
    def gog(self):
        return ready(KNOWN["gog"]).associate

    def test_single_weak_detection_is_no_track(self, gog):
        sequence, owners = make_sequence([lane(0), lane(200, hidden=tuple(range(1, 12)))], scores=(0.9, 0.6))
        assert [len(ids) for ids in ids_by_lane(gog(sequence), owners)] == [1, 0]

    def test_gap_of_a_frame_is_bridged_and_a_long_one_is_not(self, gog):
        short, _ = make_sequence([lane(0, step=2, hidden=(5,))], frames=12)
        assert len(set(gog(short).tolist())) == 1
        long, _ = make_sequence([lane(0, step=2, hidden=tuple(range(6, 14)))], frames=20)
        assert len(set(gog(long).tolist())) == 2

    def test_best_paths_are_found_together(self, gog):
        """The second object's box overlaps the first's next box more than its own: greedy steps would take it."""
        sequence, owners = make_sequence([lane(0, 0, 5), lane(0, 8, 5)], frames=12)
        ids = gog(sequence)
        assert [len(one) for one in ids_by_lane(ids, owners)] == [1, 1]
