"""The training loop: steps, looks at held-out identities, checkpoints, early stopping."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from lookonce.errors import ConfigError, OutputError
from lookonce.evaluation import DescribedObjects
from lookonce.make.training.batches import BatchSampler
from lookonce.make.training.config import FitConfig
from lookonce.make.training.readings import Readings
from lookonce.make.training.validation import Validation, validate
from lookonce.video.opening import one_line

__all__ = ["History", "Trainable", "train"]

_WARM_UP = 0.1  # share of the steps in which the learning rate rises
_FEWEST_IDENTITIES = 2
_UNIT_LENGTH_TOLERANCE = 1e-3
_EVALUATE_ROWS = 2048


class Trainable(Protocol):
    """A head together with what trains it."""

    @property
    def module(self) -> nn.Module:
        """Everything that is trained."""
        ...

    def loss(self, values: Mapping[str, Tensor], rows: NDArray[np.int64]) -> Tensor:
        """Scalar, of one batch; ``rows`` are the numbers of its rows in the readings."""
        ...

    def describe(self, values: Mapping[str, Tensor]) -> Tensor:
        """(N, D) of unit length."""
        ...


@dataclass(slots=True)
class History:
    """What a run has seen so far, a value for each look.

    Attributes:
        step: how many steps were done.
        loss: mean since the look before.
        error_rate: equal error rate of the held-out identities, mean over the sources.
        learning_rate: at that step.
    """

    step: list[int] = field(default_factory=list)
    loss: list[float] = field(default_factory=list)
    error_rate: list[float] = field(default_factory=list)
    learning_rate: list[float] = field(default_factory=list)

    @property
    def best(self) -> int:
        """Number of the look with the lowest error rate; the earliest of equals."""
        return int(np.argmin(self.error_rate))

    def is_spent(self, patience: int) -> bool:
        """Whether the last ``patience`` looks brought nothing better."""
        return bool(self.step) and len(self.step) - 1 - self.best >= patience


@dataclass(slots=True)
class _State:
    step: int
    history: History
    best: dict[str, Tensor]


def train(
    trainable: Trainable,
    readings: Readings,
    config: FitConfig,
    folder: Path,
    *,
    device: torch.device,
    report: Callable[[int, History], None],
) -> tuple[History, Validation]:
    """Train a head in place, ending with the weights that did best on the held-out identities.

    Args:
        trainable: the head; its module is changed.
        readings: what it reads at every labelled box.
        config: settings.
        folder: for checkpoints; training goes on from one that is there.
        device: where to train.
        report: called after every step with its number.

    Returns:
        The history, and the validation of the best weights.

    Raises:
        ConfigError: there are too few identities, the loss is not finite, or the checkpoint is damaged.
        OutputError: a checkpoint cannot be written.
    """
    module = trainable.module.to(device)
    optimizer = torch.optim.AdamW(module.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    sampler = BatchSampler(readings, config.identities, config.rows, config.seed)
    if len(sampler.groups) < _FEWEST_IDENTITIES:
        raise ConfigError(
            f"{len(sampler.groups)} identities to train on that are seen in two pictures, expected at least "
            f"{_FEWEST_IDENTITIES}; give more data"
        )
    _validate(trainable, readings, 0, device)  # refuses too few held-out identities before the work is done
    state = _restore(module, optimizer, folder) or _State(0, History(), {})
    losses: list[float] = []
    while state.step < config.steps and not state.history.is_spent(config.patience):
        for group in optimizer.param_groups:
            group["lr"] = _learning_rate(state.step, config)
        rows = sampler(state.step)
        torch.manual_seed((config.seed << 32) + state.step)  # a resumed run draws what an unbroken one would
        loss = trainable.loss(_values(readings, rows, device), rows)
        losses.append(loss.item())
        if not math.isfinite(losses[-1]):
            raise _divergence(state.step + 1)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        state.step += 1
        report(state.step, state.history)
        if state.step % config.check_every == 0 or state.step == config.steps:
            _look(trainable, readings, config, state, float(np.mean(losses)), device)
            losses = []
            _keep(module, optimizer, state, folder)
    module.load_state_dict(state.best)
    return state.history, _validate(trainable, readings, state.step, device)


def _learning_rate(step: int, config: FitConfig) -> float:
    """One cycle: a straight rise, then half a cosine (Smith and Topin 2018)."""
    rise = max(1, round(_WARM_UP * config.steps))
    if step < rise:
        return config.learning_rate * (step + 1) / rise
    return config.learning_rate * 0.5 * (1 + math.cos(math.pi * (step - rise) / max(1, config.steps - rise)))


def _look(
    trainable: Trainable, readings: Readings, config: FitConfig, state: _State, loss: float, device: torch.device
) -> None:
    error_rate = _validate(trainable, readings, state.step, device).error_rate
    state.history.step.append(state.step)
    state.history.loss.append(loss)
    state.history.error_rate.append(error_rate)
    state.history.learning_rate.append(_learning_rate(state.step - 1, config))
    if state.history.best == len(state.history.step) - 1:
        state.best = {name: value.detach().cpu().clone() for name, value in trainable.module.state_dict().items()}


def _divergence(step: int) -> ConfigError:
    return ConfigError(
        f"the loss is not a finite number at step {step}; try a lower learning_rate (--overwrite begins again and "
        "keeps the features), or another model file"
    )


def _validate(trainable: Trainable, readings: Readings, step: int, device: torch.device) -> Validation:
    rows = np.flatnonzero(readings.held_out[readings.identity])
    descriptors = _describe(trainable, readings, rows, device)
    if not (np.abs(np.linalg.norm(descriptors, axis=1) - 1) < _UNIT_LENGTH_TOLERANCE).all():  # also for NaN
        raise _divergence(step)
    height = readings.height_px[rows]
    objects = DescribedObjects(
        descriptors=descriptors,
        identities=readings.identity[rows],
        sequences=readings.source[rows],
        frames=readings.frame[rows],
        times_s=readings.frame[rows].astype(np.float64),
        heights_px=height,
        widths_px=height,
    )
    return validate(objects, readings.lifetime, readings.scene)


def _describe(
    trainable: Trainable, readings: Readings, rows: NDArray[np.int64], device: torch.device
) -> NDArray[np.float32]:
    """Descriptors (N, D) of some rows; (0, 1) of none."""
    trainable.module.eval()
    parts = []
    with torch.no_grad():
        for start in range(0, len(rows), _EVALUATE_ROWS):
            some = rows[start : start + _EVALUATE_ROWS]
            parts.append(trainable.describe(_values(readings, some, device)).cpu().numpy())
    trainable.module.train()
    return np.concatenate(parts) if parts else np.zeros((0, 1), np.float32)


def _values(readings: Readings, rows: NDArray[np.int64], device: torch.device) -> dict[str, Tensor]:
    values = {name: torch.from_numpy(array[rows]) for name, array in readings.values.items()}
    return {name: (v.float() if v.is_floating_point() else v).to(device) for name, v in values.items()}


def _keep(module: nn.Module, optimizer: torch.optim.Optimizer, state: _State, folder: Path) -> None:
    """Write a checkpoint in one step: the last good one stays until the next is whole."""
    tensors = {f"module.{name}": value for name, value in module.state_dict().items()}
    tensors |= {f"best.{name}": value for name, value in state.best.items()}
    for number, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": torch.as_tensor(value) for name, value in moments.items()}
    path = folder / "checkpoint.safetensors"
    unfinished = path.with_suffix(".unfinished")
    about = {"step": str(state.step), "history": json.dumps(asdict(state.history))}
    try:
        save_file({name: value.cpu().contiguous() for name, value in tensors.items()}, unfinished, about)
        os.replace(unfinished, path)
    except (OSError, SafetensorError) as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(f"{path}: cannot write the checkpoint ({exc}); make room and go on with --resume") from exc


def _restore(module: nn.Module, optimizer: torch.optim.Optimizer, folder: Path) -> _State | None:
    """The state of an earlier checkpoint, put back; None where there is none."""
    path = folder / "checkpoint.safetensors"
    if not path.exists():
        return None
    try:
        step, history = _read_about(path)
        tensors = load_file(path)
        parameters = dict(enumerate(module.parameters()))
        weights = {name: value.shape for name, value in module.state_dict().items()}
        best, moments = _part(tensors, "best."), _moments(tensors)
        has_all = all(_shapes(part) == weights for part in (best, _part(tensors, "module.")))
        has_all = has_all and moments.keys() == parameters.keys()
        if not has_all or any(_shapes(moments[n]) != _moment_shapes(p) for n, p in parameters.items()):
            raise ValueError("other weights")
        module.load_state_dict(_part(tensors, "module."))
        optimizer.load_state_dict({**optimizer.state_dict(), "state": moments})
    except (OSError, SafetensorError, KeyError, ValueError, TypeError, RuntimeError, RecursionError) as exc:
        raise ConfigError(
            f"{one_line(path)}: not a checkpoint of this run, or damaged; remove it and go on with --resume"
        ) from exc
    return _State(step, history, best)


def _read_about(path: Path) -> tuple[int, History]:
    """Step and history of a checkpoint.

    Raises:
        ValueError: they make no sense.
    """
    with safe_open(path, "pt") as file:
        about = dict(file.metadata() or {})
    step, history = int(about["step"]), History(**json.loads(about["history"]))
    columns = [np.asarray(column, np.float64) for column in asdict(history).values()]
    if any(column.shape != columns[0].shape or column.ndim != 1 for column in columns) or step not in history.step[-1:]:
        raise ValueError("a history that makes no sense")
    return step, history


def _moments(tensors: Mapping[str, Tensor]) -> dict[int, dict[str, Tensor]]:
    """What the optimizer keeps, by number of the parameter."""
    moments: dict[int, dict[str, Tensor]] = {}
    for name, value in _part(tensors, "optimizer.").items():
        number, moment = name.split(".", 1)
        moments.setdefault(int(number), {})[moment] = value
    return moments


def _moment_shapes(parameter: Tensor) -> dict[str, torch.Size]:
    """What AdamW keeps of a parameter."""
    return {"step": torch.Size(()), "exp_avg": parameter.shape, "exp_avg_sq": parameter.shape}


def _shapes(tensors: Mapping[str, Tensor]) -> dict[str, torch.Size]:
    return {name: value.shape for name, value in tensors.items()}


def _part(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
