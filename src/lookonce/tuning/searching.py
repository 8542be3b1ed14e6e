"""The search: the settings to begin with, then trial after trial until time or number is used up."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lookonce.errors import OutputError
from lookonce.tracking import TrackerConfig
from lookonce.tracking.settings import replace_settings
from lookonce.tuning.proposing import propose
from lookonce.tuning.ranges import SearchRange, values_of
from lookonce.tuning.scoring import Scorer, objective_value
from lookonce.tuning.trials import Trial, TrialFile

__all__ = ["Search", "best_settings"]

_SAME = 1e-9  # the same sums may end in other digits on another machine


@dataclass(frozen=True, slots=True)
class Search:
    """What is searched, and for how long.

    Attributes:
        start: the settings to begin with; they are the first trial.
        ranges: what is changed, one or more.
        objective: one of ``OBJECTIVES``.
        trials: how many in all, those of an earlier run included.
        seconds: how long this run may begin trials; None = as long as it takes.
        seed: of every random choice.
    """

    start: TrackerConfig
    ranges: tuple[SearchRange, ...]
    objective: str
    trials: int
    seconds: float | None
    seed: int

    def run(self, scorer: Scorer, file: TrialFile) -> Iterator[Trial]:
        """Appends trials to the file until there are enough, and yields each.

        Raises:
            OutputError: a trial cannot be written, or the file's first one scores otherwise today.
        """
        end_s = None if self.seconds is None else time.monotonic() + self.seconds
        first = Trial(values_of(self.start, self.ranges), objective_value(self.objective, scorer.scores(self.start)))
        if not file.trials:
            file.append(first)
            yield first
        elif not _are_same(file.trials[0], first):
            what = f"its first trial has {file.trials[0].score:.6f}, which is {first.score:.6f} now"
            raise OutputError(f"{file.path}: {what}: tracking has changed since; begin again with --overwrite")
        while len(file.trials) < self.trials and (end_s is None or time.monotonic() < end_s):
            values = propose(file.trials, self.ranges, self.seed)
            scores = scorer.scores(replace_settings(self.start, values))
            trial = Trial(values, objective_value(self.objective, scores))
            file.append(trial)
            yield trial


def _are_same(one: Trial, other: Trial) -> bool:
    return one.values == other.values and math.isclose(one.score, other.score, rel_tol=0, abs_tol=_SAME)


def best_settings(start: TrackerConfig, trials: Sequence[Trial]) -> TrackerConfig:
    """The settings of the best trial, of equally good ones the first; ``start`` where none is better than that."""
    best = max(trials, key=lambda trial: trial.score)
    return start if best is trials[0] else replace_settings(start, best.values)
