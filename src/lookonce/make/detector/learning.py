"""The training loop of a detector: steps, moving average of the weights, looks, checkpoints, early stopping."""

from __future__ import annotations

import copy
import json
import math
import os
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from lookonce.errors import ConfigError, OutputError
from lookonce.make.darknet.network import ConvolutionBlock, DarknetNetwork
from lookonce.make.detector.feeding import batches, steps_in_epoch
from lookonce.make.detector.gather import Gathered
from lookonce.make.detector.looking import look
from lookonce.make.detector.objective import Objective, Truth
from lookonce.make.detector.samples import Batch
from lookonce.make.detector.settings import DetectorConfig
from lookonce.video.opening import one_line

__all__ = ["CHECKPOINT", "DetectorHistory", "learn", "prepare_"]

_LAST_RATE = 0.01  # share of the learning rate that is left in the end
_LARGEST_GRADIENT = 10.0
CHECKPOINT = "checkpoint.safetensors"


@dataclass(slots=True)
class DetectorHistory:
    """What a run has seen so far, a value for each look.

    Attributes:
        epoch: passes done.
        loss, box, objectness, classes: mean since the look before; the parts are weighted.
        ap, ap50: COCO's, mean over classes, of the averaged weights on the validation pictures.
        learning_rate: at that step.
    """

    epoch: list[int] = field(default_factory=list)
    loss: list[float] = field(default_factory=list)
    box: list[float] = field(default_factory=list)
    objectness: list[float] = field(default_factory=list)
    classes: list[float] = field(default_factory=list)
    ap: list[float] = field(default_factory=list)
    ap50: list[float] = field(default_factory=list)
    learning_rate: list[float] = field(default_factory=list)

    @property
    def best(self) -> int:
        """Number of the look with the highest AP; the earliest of equals."""
        return int(np.argmax(self.ap))

    def is_spent(self, patience: int) -> bool:
        """Whether the last ``patience`` looks brought nothing better."""
        return bool(self.epoch) and len(self.epoch) - 1 - self.best >= patience


@dataclass(slots=True)
class _State:
    step: int
    history: DetectorHistory
    average: DarknetNetwork
    best: dict[str, Tensor]


def learn(
    network: DarknetNetwork,
    gathered: Gathered,
    config: DetectorConfig,
    folder: Path,
    *,
    fabric: Fabric,
    threads: int,
    report: Callable[[str, int, int, str], None],
) -> DetectorHistory:
    """Train a network in place, ending with the averaged weights that did best on the validation pictures.

    Args:
        network: random or imported weights.
        gathered: what to learn from.
        config: settings.
        folder: for checkpoints; training goes on from one that is there.
        fabric: launched; where and with which precision to train.
        threads: processors for making views and for looks.
        report: called with stage, done, total, note.

    Raises:
        ConfigError: the loss is not finite, or the checkpoint is of another network or damaged.
        OutputError: a checkpoint cannot be written.
    """
    schedule = _Schedule(steps_in_epoch(len(gathered.training), config), config)
    average = copy.deepcopy(network).requires_grad_(False)
    optimizer = torch.optim.AdamW(_groups(network, config.weight_decay), lr=config.learning_rate)
    state = _restore(network, average, optimizer, folder) or _State(0, DetectorHistory(), average, {})
    average.to(fabric.device)
    _move_moments_(optimizer, fabric.device)
    model, optimizer = fabric.setup(network, optimizer)
    objective = Objective(network.config, config, fabric.device)
    sums, counted = torch.zeros(4), 0
    rank, world = fabric.global_rank, fabric.world_size
    steps = range(state.step, 0 if state.history.is_spent(config.patience) else schedule.steps)
    feed = batches(gathered.training, config, network.config.size, steps, workers=threads, rank=rank, world=world)
    with closing(feed):
        for batch in feed:
            for group in optimizer.param_groups:
                group["lr"] = schedule.learning_rate(state.step)
            losses = _step(fabric, model, optimizer, objective, batch)
            sums, counted = sums + losses, counted + 1
            if not math.isfinite(losses[0]):
                raise _divergence(state.step + 1)
            state.step += 1
            _average_(average, network, config.average_decay, state.step)
            report("train", state.step, schedule.steps, _note(state.history, losses[0]))
            if schedule.is_time_to_look(state.step):
                if rank == 0:
                    report("train", state.step, schedule.steps, "looking at the validation pictures")
                    _look(state, gathered, state.step // schedule.epoch, sums / counted, optimizer, threads)
                    _keep(network, optimizer, state, folder)
                state.history = fabric.broadcast(state.history)
                sums, counted = torch.zeros(4), 0
                if state.history.is_spent(config.patience):
                    break
    network.load_state_dict(state.best or average.state_dict())
    return state.history


@dataclass(frozen=True, slots=True)
class _Schedule:
    """When what happens; ``epoch`` is the number of steps in one."""

    epoch: int
    config: DetectorConfig

    @property
    def steps(self) -> int:
        """All in all."""
        return self.config.epochs * self.epoch

    def is_time_to_look(self, step: int) -> bool:
        """After so many steps."""
        number, within = divmod(step, self.epoch)
        return not within and (number % self.config.check_every == 0 or number == self.config.epochs)

    def learning_rate(self, step: int) -> float:
        """A straight rise, then half a cosine to a hundredth."""
        highest, rise = self.config.learning_rate, max(1, round(self.config.warm_up_epochs * self.epoch))
        if step < rise:
            return highest * (step + 1) / rise
        share = (step - rise) / max(1, self.steps - rise)
        return highest * (_LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + math.cos(math.pi * share)))


def _step(fabric: Fabric, model: nn.Module, optimizer: Any, objective: Objective, batch: Batch) -> Tensor:
    """One step of the optimizer; the loss and its parts, (4,)."""
    model.train()
    raw, _ = model(_images(batch, fabric.device))
    losses = objective(raw, _truth(batch, fabric.device))
    optimizer.zero_grad()
    fabric.backward(losses.total)
    fabric.clip_gradients(model, optimizer, max_norm=_LARGEST_GRADIENT, error_if_nonfinite=False)
    optimizer.step()
    return torch.stack([losses.total.detach(), losses.box, losses.objectness, losses.classes]).cpu()


def _divergence(step: int) -> ConfigError:
    return ConfigError(
        f"the loss is not a finite number at step {step}; try a lower learning_rate (--overwrite begins again); "
        "the last checkpoint is kept"
    )


def _groups(network: nn.Module, weight_decay: float) -> list[dict[str, Any]]:
    """Kernels decay; biases and batch norm do not."""
    kernels = [p for p in network.parameters() if p.ndim > 1]
    others = [p for p in network.parameters() if p.ndim <= 1]
    return [{"params": kernels, "weight_decay": weight_decay}, {"params": others, "weight_decay": 0.0}]


def _images(batch: Batch, device: torch.device) -> Tensor:
    images = torch.from_numpy(batch.canvases).to(device, non_blocking=True)
    return images.permute(0, 3, 1, 2).float().div_(255).contiguous(memory_format=torch.channels_last)


def _truth(batch: Batch, device: torch.device) -> Truth:
    arrays = (batch.xyxy, batch.labels, batch.image, batch.ignored, batch.ignored_image, batch.split, batch.labelled)
    return Truth(*(torch.from_numpy(array).to(device) for array in arrays))


@torch.no_grad()
def _average_(average: nn.Module, network: nn.Module, decay: float, step: int) -> None:
    """Moves the average towards the network, in place; faster in the beginning, when all changes quickly."""
    keep = min(decay, (1 + step) / (10 + step))
    for mean, value in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mean.is_floating_point():
            mean.lerp_(value, 1 - keep)
        else:
            mean.copy_(value)


def _note(history: DetectorHistory, loss: Tensor) -> str:
    best = f", AP50 {history.ap50[history.best]:.3f}" if history.epoch else ""
    return f"loss {float(loss):.2f}{best}"


def _look(state: _State, gathered: Gathered, epoch: int, means: Tensor, optimizer: Any, threads: int) -> None:
    on_cpu = copy.deepcopy(state.average).cpu().eval()
    scores = look(on_cpu, gathered.validation, gathered.classes, threads=threads)
    history = state.history
    history.epoch.append(epoch)
    for column, value in zip((history.loss, history.box, history.objectness, history.classes), means, strict=True):
        column.append(float(value))
    history.ap.append(scores.mean.ap)
    history.ap50.append(scores.mean.ap50)
    history.learning_rate.append(optimizer.param_groups[0]["lr"])
    if history.best == len(history.epoch) - 1:
        state.best = {name: value.clone() for name, value in on_cpu.state_dict().items()}


def _move_moments_(optimizer: torch.optim.Optimizer, device: torch.device) -> None:
    for moments in optimizer.state.values():
        for name, value in moments.items():
            if name != "step":
                moments[name] = value.to(device)


def _keep(network: nn.Module, optimizer: torch.optim.Optimizer, state: _State, folder: Path) -> None:
    """Write a checkpoint in one step: the last good one stays until the next is whole."""
    tensors = {f"network.{name}": value for name, value in network.state_dict().items()}
    tensors |= {f"average.{name}": value for name, value in state.average.state_dict().items()}
    tensors |= {f"best.{name}": value for name, value in state.best.items()}
    for number, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": torch.as_tensor(value) for name, value in moments.items()}
    path = folder / CHECKPOINT
    unfinished = path.with_suffix(".unfinished")
    about = {"step": str(state.step), "history": json.dumps(asdict(state.history))}
    try:
        save_file({name: value.detach().cpu().contiguous() for name, value in tensors.items()}, unfinished, about)
        os.replace(unfinished, path)
    except (OSError, SafetensorError) as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(f"{path}: cannot write the checkpoint ({exc}); make room and go on with --resume") from exc


def _restore(
    network: DarknetNetwork, average: DarknetNetwork, optimizer: torch.optim.Optimizer, folder: Path
) -> _State | None:
    """The state of an earlier checkpoint, put back; None where there is none."""
    path = folder / CHECKPOINT
    if not path.exists():
        return None
    try:
        with safe_open(path, "pt") as file:
            about = dict(file.metadata() or {})
        step, history = int(about["step"]), DetectorHistory(**json.loads(about["history"]))
        if {len(column) for column in asdict(history).values()} != {len(history.epoch) or 1}:
            raise ValueError("a history that makes no sense")
        tensors = load_file(path)
        moments: dict[int, dict[str, Tensor]] = {}
        for name, value in _part(tensors, "optimizer.").items():
            number, moment = name.split(".", 1)
            moments.setdefault(int(number), {})[moment] = value
        network.load_state_dict(_part(tensors, "network."))
        average.load_state_dict(_part(tensors, "average."))
        best = _part(tensors, "best.")
        parameters = dict(enumerate(p for group in optimizer.param_groups for p in group["params"]))
        if _shapes(best) != _shapes(network.state_dict()) or moments.keys() != parameters.keys():
            raise ValueError("other weights")
        if any(_shapes(moments[n]) != _moment_shapes(p) for n, p in parameters.items()):
            raise ValueError("other moments")
        optimizer.load_state_dict({**optimizer.state_dict(), "state": moments})
    except (OSError, SafetensorError, KeyError, ValueError, TypeError, RuntimeError, RecursionError) as exc:
        raise ConfigError(
            f"{one_line(path)}: not a checkpoint of this network, or damaged; remove it, or begin with --overwrite"
        ) from exc
    return _State(step, history, average, best)


def _shapes(tensors: Mapping[str, Tensor]) -> dict[str, torch.Size]:
    return {name: value.shape for name, value in tensors.items()}


def _moment_shapes(parameter: Tensor) -> dict[str, torch.Size]:
    """What AdamW keeps of a parameter."""
    return {"step": torch.Size(()), "exp_avg": parameter.shape, "exp_avg_sq": parameter.shape}


def _part(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


def prepare_(network: DarknetNetwork, prior: float = 0.01) -> None:
    """Sets the objectness of each output to ``prior``, in place: nearly all anchors are negatives (Lin et al. 2017)."""
    config = network.config
    for layer in config.outputs:
        block = network.blocks[str(layer.index - 1)]
        assert isinstance(block, ConvolutionBlock)
        bias = block.convolution.bias
        assert bias is not None
        with torch.no_grad():
            bias.zero_()
            bias.view(-1, 5 + config.classes)[:, 4] = math.log(prior / (1 - prior))
