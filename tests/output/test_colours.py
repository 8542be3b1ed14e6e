import itertools

import pytest

from lookonce.output.colours import text_colour, track_colour

COLOURS_OF_1_2_3 = [(0, 232, 255), (180, 122, 0), (200, 138, 253)]


def _luminance(colour) -> float:
    linear = [c / 255 / 12.92 if c <= 10 else ((c / 255 + 0.055) / 1.055) ** 2.4 for c in colour]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def _contrast(a, b) -> float:
    high, low = sorted((_luminance(a), _luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_colours_are_the_same_in_every_run():
    """Literal values: a change here changes the look of everybody's videos."""
    assert [track_colour(identity) for identity in (1, 2, 3)] == COLOURS_OF_1_2_3


def test_ids_at_most_20_apart_differ_visibly():
    for a, b in itertools.combinations(range(1, 200), 2):
        if b - a <= 20:
            difference = [abs(x - y) for x, y in zip(track_colour(a), track_colour(b), strict=True)]
            assert sum(difference) >= 40, (a, b)


@pytest.mark.parametrize("identity", [1, 2, 10**6, 2**62])
def test_any_id_has_a_colour(identity):
    assert all(0 <= channel <= 255 for channel in track_colour(identity))


def test_text_has_the_better_of_both_contrasts():
    for identity in range(1, 200):
        ground = track_colour(identity)
        chosen = _contrast(ground, text_colour(ground))
        assert chosen == pytest.approx(max(_contrast(ground, (0, 0, 0)), _contrast(ground, (255, 255, 255))), abs=0.05)
        assert chosen > 4.5  # WCAG 2, level AA
