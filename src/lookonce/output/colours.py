"""One colour for each identity, the same in every run."""

from __future__ import annotations

import math
from functools import lru_cache

__all__ = ["Colour", "text_colour", "track_colour"]

Colour = tuple[int, int, int]
"""Red, green, blue in [0, 255]."""

_GOLDEN_RATIO = 0.6180339887498949  # of the hue circle from one id to the next: any run of ids spreads evenly
# OKLab lightness and chroma. Golden-ratio hues come close again after 5, 8 and 13 ids; seven lightnesses keep those
# apart. Of all orders of these seven, this one has the largest smallest distance (0.086) among ids at most 20 apart.
_LIGHTNESS = (0.68, 0.86, 0.62, 0.74, 0.56, 0.80, 0.48)
_CHROMA = 0.17
_BLACK, _WHITE = (0, 0, 0), (255, 255, 255)
_EQUAL_CONTRAST = (
    0.179  # relative luminance at which black and white text read equally well (WCAG 2: sqrt(.0525) - .05)
)


@lru_cache(maxsize=4096)  # a pure function: the cache only saves time
def track_colour(identity: int) -> Colour:
    """The colour of an identity: golden-ratio hue, alternating lightness, evenly vivid to the eye."""
    angle = 2 * math.pi * (identity * _GOLDEN_RATIO % 1)
    return _oklab_to_rgb(_LIGHTNESS[identity % len(_LIGHTNESS)], _CHROMA * math.cos(angle), _CHROMA * math.sin(angle))


def text_colour(background: Colour) -> Colour:
    """Black or white, whichever has more contrast with ``background``.

    >>> text_colour((255, 220, 0)), text_colour((0, 0, 160))
    ((0, 0, 0), (255, 255, 255))
    """
    red, green, blue = (_decode(value / 255) for value in background)
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue  # of linear sRGB
    return _BLACK if luminance > _EQUAL_CONTRAST else _WHITE


def _oklab_to_rgb(lightness: float, a: float, b: float) -> Colour:
    """OKLab (Ottosson 2020) as sRGB, cut to what sRGB can show."""
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    middle = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    return (
        _encode(4.0767416621 * long - 3.3077115913 * middle + 0.2309699292 * short),
        _encode(-1.2684380046 * long + 2.6097574011 * middle - 0.3413193965 * short),
        _encode(-0.0041960863 * long - 0.7034186147 * middle + 1.7076147010 * short),
    )


def _encode(linear: float) -> int:
    """A linear sRGB channel in [0, 1], cut to that range, as the byte of the sRGB curve."""
    linear = min(max(linear, 0.0), 1.0)
    curved = 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055
    return round(255 * curved)


def _decode(curved: float) -> float:
    return curved / 12.92 if curved <= 0.04045 else float(((curved + 0.055) / 1.055) ** 2.4)
