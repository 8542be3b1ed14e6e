"""How good descriptors are on identities that were not trained on, and which distance tells them apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import ConfigError
from lookonce.evaluation import DescribedObjects, PairDistances, equal_error_rate
from lookonce.evaluation.retrieval.pairs import count_pairs
from lookonce.make.training.sources import coexist

__all__ = ["Validation", "are_comparable", "check_comparable", "validate"]

_ANY_GAP = 2**31 - 1
_SIDE_BY_SIDE, _FAR_APART, _UNKNOWN = range(3)  # groups of pairs
_ENOUGH = 100  # pairs of two objects that were seen side by side


@dataclass(frozen=True, slots=True)
class Validation:
    """Means over the sources, so that a long sequence does not outweigh a thousand stills.

    Attributes:
        error_rate: equal error rate.
        threshold: the distance at which it is reached.
        identities: held out.
        pairs: compared.
    """

    error_rate: float
    threshold: float
    identities: int
    pairs: int


def validate(objects: DescribedObjects, lifetimes: NDArray[np.int64], scenes: NDArray[np.int64]) -> Validation:
    """Compare all pairs of different frames or views within each source of which it is known what they are.

    Two objects are compared where they were seen side by side, in one light: that is what a tracker has to tell apart,
    and where the threshold must hold. Of a source with hardly any such pairs all are.

    Args:
        objects: held-out rows; ``sequences`` are the sources.
        lifetimes: (identities, 2) by identity, see ``coexist``.
        scenes: (identities,) by identity the scene that it was seen in.

    Raises:
        ConfigError: no source has pairs of both kinds.
    """
    rates, thresholds, pairs = [], [], 0
    for source in np.unique(objects.sequences):
        found = _known_pairs(objects[objects.sequences == source], lifetimes, scenes)
        rate, threshold = equal_error_rate(found)
        if np.isfinite(rate):
            rates.append(rate)
            thresholds.append(threshold)
            pairs += found.genuine_count + found.impostor_count
    if not rates:
        raise _too_few()
    identities = len(np.unique(objects.identities))
    return Validation(float(np.mean(rates)), float(np.mean(thresholds)), identities, pairs)


def check_comparable(lifetimes: Sequence[NDArray[np.int64]]) -> None:
    """Look whether some source has two held-out identities to compare, before any work is done.

    Args:
        lifetimes: of each source those of its held-out identities, (identities, 2).

    Raises:
        ConfigError: none has.
    """
    if not any(are_comparable(lives) for lives in lifetimes):
        raise _too_few()


def are_comparable(lifetimes: NDArray[np.int64]) -> bool:
    """Whether any two of these lives (identities, 2) coexist."""
    lives = lifetimes[np.argsort(lifetimes[:, 0], kind="stable")]
    return bool((lives[1:, 0] <= np.maximum.accumulate(lives[:-1, 1])).any())


def _too_few() -> ConfigError:
    return ConfigError(
        "too few identities to hold some out for validation: expected at least two, seen together, with two pictures "
        "each; give more data"
    )


def _known_pairs(objects: DescribedObjects, lifetimes: NDArray[np.int64], scenes: NDArray[np.int64]) -> PairDistances:
    """Pairs of one identity, and of two that are surely two objects, of one scene where there are enough."""

    def group_of(queries: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.int64]:
        a, b = objects.identities[queries], objects.identities[others]
        group = np.where(scenes[a] == scenes[b], _SIDE_BY_SIDE, _FAR_APART)
        return np.where(coexist(lifetimes[a], lifetimes[b]), group, _UNKNOWN)

    near, far, _ = count_pairs(objects, 1, _ANY_GAP, group_of, group_count=3)
    return near if near.impostor_count >= _ENOUGH else replace(near, impostor=near.impostor + far.impostor)
