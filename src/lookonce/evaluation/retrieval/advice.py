"""One sentence for people: how far appearance can be trusted."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lookonce.evaluation.retrieval.breakdown import BreakdownBin
from lookonce.evaluation.retrieval.pairs import PairDistances
from lookonce.evaluation.retrieval.rates import equal_error_rate

__all__ = ["advice"]

# Rules of thumb, not measurements. A tracker has motion too, which settles most of the one pair in ten.
_RELIABLE = 0.10  # largest equal error rate that is called reliable
_WEAK = 0.25  # above it the smallest objects are called weak
_USELESS = 0.35  # above it appearance is not worth its cost; 0.5 is guessing
_FEWEST_PAIRS = 100  # of each kind: an error rate of 0.10 then stands to 0.06 (two standard errors), at best
_FEWEST_IDENTITIES = 5  # pairs of one object resemble each other: a thousand pairs of two objects say little


def advice(overall: PairDistances, by_time: Sequence[BreakdownBin], by_height: Sequence[BreakdownBin]) -> str:
    """One sentence on how far descriptors alone tell objects apart.

    The rules, where a part counts only with 100 pairs of each kind and 5 objects that have a genuine pair:

    1. Too few pairs overall: there is nothing to say.
    2. Parts by time, from the shortest: as far as all have an equal error rate of at most 0.10, appearance is
       reliable. The rate stated is the worst of them, and behind it the worst of the parts beyond.
    3. The first part is above 0.10: with an overall rate above 0.35, do not rely on appearance; else it is a help to
       motion.
    4. Parts by height, from the smallest: as far as all are above 0.25, objects below that height are called weak,
       unless all parts are, or rule 3 has already said not to rely on it.

    Args:
        overall: all pairs.
        by_time: the same pairs by ``time_gap``; without a part that counts, ``overall`` stands for all.
        by_height: the same pairs by ``height``; may be empty.
    """
    if not _is_enough(overall.genuine_count, overall.impostor_count, overall.identities):
        return (
            f"Too few pairs to say how far appearance can be trusted: {overall.genuine_count} of the same object "
            f"({overall.identities} objects) and {overall.impostor_count} of different ones."
        )
    overall_rate, _ = equal_error_rate(overall)
    times = _counting(by_time)
    first_rate = times[0].equal_error_rate if times else overall_rate
    if first_rate <= _RELIABLE:
        return f"Appearance alone is {_reach(times, overall_rate)}{_weakness(by_height)}."
    if overall_rate > _USELESS:
        return (
            "Do not rely on appearance: it hardly tells these objects apart "
            f"(error rate {overall_rate:.2f}; 0.50 is guessing)."
        )
    worst = max([overall_rate, *(part.equal_error_rate for part in times)])
    return (
        f"Appearance alone is not reliable (error rate up to {worst:.2f}) but a help to motion{_weakness(by_height)}."
    )


def _is_enough(genuine: int, impostor: int, identities: int) -> bool:
    return min(genuine, impostor) >= _FEWEST_PAIRS and identities >= _FEWEST_IDENTITIES


def _counting(parts: Sequence[BreakdownBin]) -> list[BreakdownBin]:
    return [part for part in parts if _is_enough(part.genuine, part.impostor, part.identities)]


def _reach(times: Sequence[BreakdownBin], overall_rate: float) -> str:
    """``reliable up to ...`` where the first part (or, without parts, all) is reliable."""
    if not times:
        return f"reliable over the gaps compared (error rate {overall_rate:.2f})"
    rates = [part.equal_error_rate for part in times]
    reliable = next((number for number, rate in enumerate(rates) if rate > _RELIABLE), len(rates))
    worst = f"error rate {max(rates[:reliable]):.2f}"
    if reliable < len(rates):
        upper = times[reliable - 1].upper
        return f"reliable up to about {upper:g} s apart ({worst}), less so beyond ({max(rates[reliable:]):.2f})"
    upper = times[-1].upper
    extent = f"beyond {times[-1].lower:g} s" if upper == math.inf else f"up to {upper:g} s"
    return f"reliable at all gaps compared, {extent} apart ({worst})"


def _weakness(by_height: Sequence[BreakdownBin]) -> str:
    """``, and weak for ...``, or nothing."""
    heights = _counting(by_height)
    rates = [part.equal_error_rate for part in heights]
    weak = next((number for number, rate in enumerate(rates) if rate <= _WEAK), 0)
    if not weak:
        return ""
    return f", and weak for objects under {heights[weak - 1].upper:g} px high ({max(rates[:weak]):.2f})"
