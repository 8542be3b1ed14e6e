import math

import numpy as np
import pytest

from lookonce.evaluation import BreakdownBin, PairDistances, advice

TIMES = [0, 1, 2, 5, 10, 30, math.inf]
HEIGHTS = [0, 16, 32, 64, 128, math.inf]


def _overall(rate, count=10_000, identities=20):
    """Two bins in which the equal error rate is ``rate``."""
    near = round(count * (1 - rate))
    return PairDistances(np.array([near, count - near]), np.array([count - near, near]), identities, 1, 900)


def _parts(limits, rates, count=1000, identities=20):
    return [
        BreakdownBin(
            "",
            low,
            high,
            *((0, 0, 0) if rate is None else (count, count, identities)),
            math.nan if rate is None else rate,
            0.5,
            0.5,
            0.5,
        )
        for low, high, rate in zip(limits[:-1], limits[1:], rates, strict=True)
    ]


def _advice(overall, times, heights=(None,) * 5):
    return advice(_overall(overall), _parts(TIMES, times), _parts(HEIGHTS, heights))


def test_strong_everywhere():
    assert _advice(0.04, [0.01, 0.02, 0.03, 0.03, 0.05, 0.06], [0.2, 0.1, 0.04, 0.02, 0.02]) == (
        "Appearance alone is reliable at all gaps compared, beyond 30 s apart (error rate 0.06)."
    )
    assert _advice(0.02, [0.01, 0.02, 0.03, None, None, None]) == (
        "Appearance alone is reliable at all gaps compared, up to 5 s apart (error rate 0.03)."
    )


def test_strong_only_for_short_gaps_and_weak_for_small_objects():
    assert _advice(0.18, [0.02, 0.04, 0.08, 0.15, 0.22, 0.20], [0.31, 0.12, 0.1, 0.1, 0.1]) == (
        "Appearance alone is reliable up to about 5 s apart (error rate 0.08), less so beyond (0.22), and weak for "
        "objects under 16 px high (0.31)."
    )


def test_a_reliable_part_behind_an_unreliable_one_does_not_extend_the_reach():
    assert "up to about 1 s apart" in _advice(0.1, [0.05, 0.2, 0.05, 0.05, 0.05, 0.05])


def test_useless():
    assert _advice(0.41, [0.38, 0.4, 0.4, 0.42, 0.44, 0.45], [0.45, 0.2, 0.2, 0.2, 0.2]) == (
        "Do not rely on appearance: it hardly tells these objects apart (error rate 0.41; 0.50 is guessing)."
    )


def test_a_help_to_motion():
    assert _advice(0.2, [0.12, 0.15, 0.2, 0.2, 0.24, None], [None, 0.3, 0.28, 0.2, 0.1]) == (
        "Appearance alone is not reliable (error rate up to 0.24) but a help to motion, and weak for objects under "
        "64 px high (0.30)."
    )


def test_weak_at_all_heights_is_not_said_of_small_objects():
    assert "px" not in _advice(0.3, [0.3] * 6, [0.3] * 5)


@pytest.mark.parametrize(
    ("count", "identities"), [pytest.param(12, 20, id="pairs"), pytest.param(10_000, 4, id="objects")]
)
def test_too_few_pairs_to_say(count, identities):
    found = advice(_overall(0.0, count, identities), _parts(TIMES, [0.0] * 6), [])
    assert found == (
        f"Too few pairs to say how far appearance can be trusted: {count} of the same object ({identities} objects) "
        f"and {count} of different ones."
    )


def test_parts_with_too_few_pairs_do_not_count():
    few = _parts(TIMES, [0.5] * 6, count=99) + _parts(TIMES, [0.5] * 6, identities=4)
    assert advice(_overall(0.05), few, _parts(HEIGHTS, [0.5, 0.1, 0.1, 0.1, 0.1], count=99)) == (
        "Appearance alone is reliable over the gaps compared (error rate 0.05)."
    )


def test_no_pairs_at_all():
    nothing = PairDistances(np.zeros(4, np.int64), np.zeros(4, np.int64), 0, 1, 9)
    assert advice(nothing, [], []).startswith("Too few pairs to say")
