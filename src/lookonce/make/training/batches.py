"""Which rows a training step sees."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from lookonce.make.training.readings import Readings
from lookonce.make.training.sources import coexist

__all__ = ["BatchSampler", "comparable"]

_FROM_SCENES = 0.5  # share of a batch that comes scene by scene: there the hard negatives are
_IDENTITIES_A_SCENE = 16
# How often scenes of a kind are drawn; labelled sequences as often as all the others together.
_WEIGHTS = {"clips": 1.0, "stills": 1.0, "rendered people": 2.0}


class BatchSampler:
    """Draws batches: half of it scene by scene, kind by kind of sources, the rest any identities.

    Objects that stand side by side in one light are the hard negatives, and what a tracker has to tell apart. A
    sequence has few identities in many frames: it is drawn several times for a batch, each time with other frames.

    Args:
        readings: everything.
        identities: in a batch, about.
        rows: of an identity, each time it is drawn.
        seed: of all draws; a step's batch depends on nothing but seed and step.
    """

    def __init__(self, readings: Readings, identities: int, rows: int, seed: int) -> None:
        self._identities, self._rows, self._seed = identities, rows, seed
        train = ~readings.held_out[readings.identity]
        order = np.flatnonzero(train)[np.argsort(readings.identity[train], kind="stable")]
        starts = np.flatnonzero(np.diff(readings.identity[order], prepend=-1))
        groups = [group for group in np.split(order, starts[1:]) if len(group) > 1] if len(order) else []
        self.groups: Sequence[NDArray[np.int64]] = groups  # rows of each identity that has two or more
        by_source: dict[int, dict[int, list[int]]] = {}
        for number, group in enumerate(groups):
            row = group[0]
            scenes = by_source.setdefault(int(readings.source[row]), {})
            scenes.setdefault(int(readings.scene[readings.identity[row]]), []).append(number)
        by_kind: dict[str, list[list[list[int]]]] = {}
        for source, scenes in by_source.items():
            crowded = [members for members in scenes.values() if len(members) > 1]
            if crowded:
                by_kind.setdefault(readings.kinds[source], []).append(crowded)
        self._scenes = list(by_kind.values())  # kind -> source -> scene -> numbers of groups
        others = sum(_WEIGHTS.get(kind, 0.0) for kind in by_kind)
        weights = np.array([_WEIGHTS.get(kind, others or 1.0) for kind in by_kind])
        self._shares = weights / weights.sum()

    def __call__(self, step: int) -> NDArray[np.int64]:
        """Row numbers of one step's batch."""
        rng = np.random.default_rng([self._seed, step])
        drawn: list[int] = []
        while self._scenes and len(drawn) < _FROM_SCENES * self._identities:
            sources = self._scenes[rng.choice(len(self._scenes), p=self._shares)]
            scenes = sources[rng.integers(len(sources))]
            drawn += self._some(scenes[rng.integers(len(scenes))], _IDENTITIES_A_SCENE, rng)
        times = Counter(drawn)
        others = [number for number in range(len(self.groups)) if number not in times]
        times.update(self._some(others, self._identities - len(drawn), rng))
        rows = [self.groups[n][rng.permutation(len(self.groups[n]))[: k * self._rows]] for n, k in times.items()]
        return np.sort(np.concatenate(rows))

    @staticmethod
    def _some(members: Sequence[int], count: int, rng: Generator) -> list[int]:
        return [members[index] for index in rng.permutation(len(members))[: max(count, 0)]]


def comparable(readings: Readings, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N, N) whether two rows are surely one object or surely two: of identities that coexist, or of two sources."""
    source, lifetimes = readings.source[rows], readings.lifetime[readings.identity[rows]]
    result: NDArray[np.bool_] = coexist(lifetimes[:, None], lifetimes) | (source[:, None] != source)
    return result
