"""How good descriptors are on identities that were not trained on, and which distance tells them apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookonce.errors import ConfigError
from lookonce.evaluation import DescribedObjects, equal_error_rate, pair_distances

__all__ = ["Validation", "validate"]

_ANY_GAP = 2**31 - 1


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


def validate(objects: DescribedObjects) -> Validation:
    """Compare all pairs of different frames or views within each source.

    Raises:
        ConfigError: no source has pairs of both kinds.
    """
    rates, thresholds, pairs = [], [], 0
    for source in np.unique(objects.sequences):
        found = pair_distances(objects[objects.sequences == source], 1, _ANY_GAP)
        rate, threshold = equal_error_rate(found)
        if np.isfinite(rate):
            rates.append(rate)
            thresholds.append(threshold)
            pairs += found.genuine_count + found.impostor_count
    if not rates:
        raise ConfigError("too few identities to hold some out for validation; at least two with two pictures each")
    identities = len(np.unique(objects.identities))
    return Validation(float(np.mean(rates)), float(np.mean(thresholds)), identities, pairs)
