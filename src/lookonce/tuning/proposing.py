"""Which values to try next, and which settings mattered: Optuna's sampler and its PED-ANOVA."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution

from lookonce.tuning.ranges import SearchRange
from lookonce.tuning.trials import Trial

__all__ = ["importances", "propose"]

_RANDOM_TRIALS = 1  # the settings to begin with: the sampler learns from them at once
_LEAST_TRIALS = 20  # from which on importances say anything


def propose(trials: Sequence[Trial], ranges: Sequence[SearchRange], seed: int) -> dict[str, float]:
    """The values to try after these trials; the same trials and seed give the same ones.

    The state of the sampler is nothing but the trials so far: a search that was stopped goes on as if it never was.
    """
    number = int(np.random.SeedSequence([seed, len(trials)]).generate_state(1)[0])
    sampler = optuna.samplers.TPESampler(n_startup_trials=_RANDOM_TRIALS, multivariate=True, seed=number)
    study = _study(trials, ranges, sampler)
    asked = study.ask(_distributions(ranges))
    return {one.name: one.tidy(asked.params[one.name]) for one in ranges}


def importances(trials: Sequence[Trial], ranges: Sequence[SearchRange]) -> dict[str, float]:
    """How much each setting had to do with good scores, shares of 1; nothing where trials are few or all alike."""
    if len(trials) < _LEAST_TRIALS or len({trial.score for trial in trials}) == 1:
        return {}
    study = _study(trials, ranges, None)
    names = [one.name for one in ranges]
    evaluator = optuna.importance.PedAnovaImportanceEvaluator()
    return optuna.importance.get_param_importances(study, evaluator=evaluator, params=names)


def _study(
    trials: Sequence[Trial], ranges: Sequence[SearchRange], sampler: optuna.samplers.BaseSampler | None
) -> optuna.Study:
    """The trials as Optuna has them, in memory."""
    logging.getLogger("optuna").setLevel(logging.WARNING)  # or every study and trial is a line on the screen
    study = optuna.create_study(direction="maximize", sampler=sampler)
    distributions = _distributions(ranges)
    for trial in trials:
        frozen = optuna.trial.create_trial(params=dict(trial.values), distributions=distributions, value=trial.score)
        study.add_trial(frozen)
    return study


def _distributions(ranges: Sequence[SearchRange]) -> dict[str, BaseDistribution]:
    return {
        one.name: IntDistribution(int(one.low), int(one.high))
        if one.is_whole
        else FloatDistribution(one.low, one.high, log=one.is_log)
        for one in ranges
    }
