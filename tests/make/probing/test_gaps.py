import math

import numpy as np
import pytest

from evaluation.described import make_objects, on_circle
from lookonce.errors import ConfigError
from lookonce.evaluation import pair_distances
from lookonce.make.probing import Gap, GapLimits


def _objects(frames, times_s, sequences=None):
    count = len(frames)
    return make_objects(on_circle(np.arange(count)), np.ones(count), frames, sequences, times_s)


def _pairs(objects, limits):
    window = limits.window(objects)
    return pair_distances(window.objects, window.least, window.most).genuine_count


@pytest.mark.parametrize(
    ("text", "value", "in_frames"),
    [
        pytest.param("30f", 30, True, id="frames"),
        pytest.param("4s", 4, False, id="seconds"),
        pytest.param("0.5", 0.5, False, id="bare-number"),
        pytest.param(" 1.5 S ", 1.5, False, id="blanks-and-capitals"),
    ],
)
def test_gaps_are_read_as_people_write_them(text, value, in_frames):
    assert Gap.parse(text) == Gap(value, in_frames)


@pytest.mark.parametrize("text", ["", "f", "30 frames", "-1s", "1e3", "nan", "1.5f", "9999999s", "٣s"])
def test_what_is_no_gap_is_refused(text):
    with pytest.raises(ConfigError, match=r"^gap .*expected"):
        Gap.parse(text)


@pytest.mark.parametrize(
    ("least", "most", "rank", "message"),
    [
        pytest.param("30f", "30s", "2s", "30 frames to 30 s: give both", id="mixed"),
        pytest.param("9f", "8f", "2s", "the second must be larger", id="frames-turned-round"),
        pytest.param("2s", "2s", "2s", "the second must be larger", id="empty-range-of-seconds"),
        pytest.param("0s", "2s", "0f", "rank one: expected more than 0", id="rank-without-gap"),
    ],
)
def test_limits_that_leave_nothing_are_refused(least, most, rank, message):
    with pytest.raises(ConfigError, match=message):
        GapLimits(Gap.parse(least), Gap.parse(most), Gap.parse(rank))


def test_limits_in_frames_include_both_ends():
    objects = _objects(range(6), np.arange(6) / 7)
    assert _pairs(objects, GapLimits(Gap(2, True), Gap(3, True))) == 4 + 3
    assert _pairs(objects, GapLimits(Gap(2, True), Gap(2, True))) == 4
    assert str(GapLimits(Gap(2, True), Gap(3, True))) == "2 to 3 frames"


def test_limits_in_seconds_leave_the_upper_end_out():
    for rate in (7, 10, 25, 29.97, 30):
        frames = np.arange(200)
        count = _pairs(_objects(frames, frames / rate), GapLimits(Gap(1.0), Gap(2.0)))
        first, end = math.ceil(rate - 1e-9), math.ceil(2 * rate - 1e-9)
        assert count == sum(200 - gap for gap in range(first, end))
    assert str(GapLimits(Gap(0.5), Gap(30.0))) == "0.5 to 30 s"


def test_seconds_follow_a_clock_that_is_not_even():
    objects = _objects([0, 1, 2, 3], [0.0, 0.1, 1.2, 5.0])
    assert _pairs(objects, GapLimits(Gap(1.0), Gap(3.0))) == 2


@pytest.mark.parametrize(
    ("frames", "rate", "gap", "expected"),
    [
        pytest.param(range(100), 25, "2s", 50, id="25-fps"),
        pytest.param(range(100), 29.97, "2s", 60, id="29.97-fps"),
        pytest.param(range(0, 100, 5), 25, "1.25s", 30, id="truth-for-every-fifth-frame"),
        pytest.param(range(0, 100, 5), 25, "0.01s", 5, id="one-step-at-least"),
        pytest.param(range(0, 100, 5), 25, "7f", 7, id="frames-as-they-are"),
        pytest.param([8], 25, "2s", 1, id="one-frame"),
        pytest.param([], 25, "2s", 1, id="no-frame"),
    ],
)
def test_rank_one_looks_a_whole_number_of_frames_later(frames, rate, gap, expected):
    frames = np.array(frames, np.int64)
    limits = GapLimits(rank=Gap.parse(gap))
    assert limits.rank_frames(_objects(frames, frames / rate)) == expected
