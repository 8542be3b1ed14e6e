"""Our own presets among the trackers."""

from __future__ import annotations

from dataclasses import replace

import pytest

from compare.moving import ids_by_lane, lane, leaves_and_comes, make_sequence
from lookonce.compare.contenders.presets import associate_preset


@pytest.mark.parametrize(("size", "expected"), [((480, 640), {1, 2}), (None, {1})])
def test_who_leaves_the_picture_is_gone(size, expected):
    """As in `lookonce track`, which knows the size as well."""
    sequence = replace(leaves_and_comes(), size=size)
    assert set(associate_preset("default", sequence).ids.tolist()) == expected


def test_the_size_stays_with_chosen_rows_and_frames():
    sequence = replace(make_sequence([lane(0), lane(90)])[0], size=(480, 640))
    assert sequence.every(2).size == sequence.rows(sequence.scores > 1).size == (480, 640)


def test_two_lanes_are_two_identities():
    sequence, owners = make_sequence([lane(0), lane(90)])
    assert ids_by_lane(associate_preset("default", sequence).ids, owners) == [{1}, {2}]
