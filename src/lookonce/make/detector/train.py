"""A network description and labelled pictures in, a detector's model file out."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from lightning_fabric import Fabric
from numpy.typing import NDArray

from lookonce.datasets import picture_size, usual_name
from lookonce.errors import ConfigError, OutputError
from lookonce.evaluation.detection.precision import DetectionScores
from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.importer import write_detector
from lookonce.make.darknet.layers import DarknetConfig, Yolo
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.darknet.weights import read_weights
from lookonce.make.darknet.writing import cfg_with, weights_bytes
from lookonce.make.detector.anchors import fit_anchors, mean_best_overlap
from lookonce.make.detector.gather import DetectorData, Gathered, Teacher, gather
from lookonce.make.detector.learning import CHECKPOINT, DetectorHistory, learn, prepare_
from lookonce.make.detector.looking import measure
from lookonce.make.detector.samples import Sample
from lookonce.make.detector.settings import DetectorConfig
from lookonce.model import ModelMetadata, available_cpus
from lookonce.video.opening import one_line

__all__ = ["DetectorResult", "NetworkSource", "Progress", "train_detector"]


@dataclass(frozen=True, slots=True)
class NetworkSource:
    """The network to train.

    Attributes:
        cfg: its description.
        weights: Darknet weights to start from; None: random ones.
        names: class names of ``weights``, for taking over what it knows of classes by name.
        size: input (height, width) in px instead of the cfg's own.
        change_classes: whether to change the cfg's number of classes to the data's, where they differ.
    """

    cfg: Path
    weights: Path | None = None
    names: tuple[str, ...] = ()
    size: tuple[int, int] | None = None
    change_classes: bool = False


@dataclass(frozen=True, slots=True)
class DetectorResult:
    """What came out.

    Attributes:
        metadata: of the model file.
        scores: of the model file on the validation pictures.
        history: of the training.
        pictures: trained on.
    """

    metadata: ModelMetadata
    scores: DetectionScores
    history: DetectorHistory
    pictures: int


class Progress(Protocol):
    """Who watches."""

    def stage(self, name: str, done: int, total: int | None, note: str = "") -> None:
        """So much of a stage is done."""
        ...

    def say(self, text: str) -> None:
        """A finding that stays on the screen."""
        ...


def train_detector(
    source: NetworkSource,
    data: DetectorData,
    classes: tuple[str, ...],
    output: Path,
    config: DetectorConfig,
    *,
    folder: Path,
    teacher: Teacher | None = None,
    license: str = "unknown",
    device: str = "auto",
    devices: int = 1,
    threads: int | None = None,
    progress: Progress,
) -> DetectorResult:
    """Train a detector.

    Args:
        source: the network.
        data: what to learn from.
        classes: names of what is learnt, by label.
        output: the model file to write.
        config: settings.
        folder: for checkpoints, the changed cfg and the weights in Darknet's format.
        teacher: labels what is not labelled.
        license: terms of the result, kept in the file.
        device: ``auto``, ``cpu`` or ``cuda``.
        devices: how many of them train together.
        threads: processors to use; all by default.
        progress: who watches.

    Raises:
        LookonceError: an input is wrong, or the disk is full; what was made so far is kept in ``folder``.
    """
    threads = threads or available_cpus()
    fabric = _fabric(device, devices, config)
    original = read_cfg(source.cfg, source.size)
    _check_network(original, source, classes)
    gathered = gather(
        data, classes, config, teacher, folder, size=original.size, report=progress.stage, say=progress.say
    )
    progress.say(f"{len(gathered.training)} pictures to learn from, {len(gathered.validation)} to validate on")
    fitted = _network_file(source, original, gathered, config, folder, progress)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with torch.random.fork_rng([]):
            torch.manual_seed(config.seed)
            network = DarknetNetwork(fitted)
            prepare_(network)
            if source.weights is not None:
                _take_over_(network, original, source, classes)
            network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
            history = learn(network, gathered, config, folder, fabric=fabric, threads=threads, report=progress.stage)
            about = _about(config, data, gathered)
            metadata = _write(network.cpu().eval(), classes, output, folder, source, license, about)
    finally:
        torch.set_num_threads(before)
    progress.say("measuring the model file")
    scores = measure(output, gathered.validation, classes, threads=threads)
    return DetectorResult(metadata, scores, history, len(gathered.training))


def _fabric(device: str, devices: int, config: DetectorConfig) -> Fabric:
    if device not in ("auto", "cpu", "cuda"):
        raise ConfigError(f"device '{device}': expected auto, cpu or cuda")
    if device == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device 'cuda': PyTorch sees no CUDA device here; use --device cpu")
    chosen = ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device
    if config.batch % devices:
        raise ConfigError(f"batch {config.batch}: expected a multiple of the {devices} devices")
    precision = config.precision
    if precision == "auto":
        precision = "bf16-mixed" if chosen == "cuda" or _has_bfloat16() else "32-true"
    fabric = Fabric(accelerator=chosen, devices=devices, precision=precision)  # type: ignore[arg-type]
    if devices > 1:
        fabric.launch()
    return fabric


def _has_bfloat16() -> bool:
    """Whether this CPU computes in bfloat16 (AVX-512 or AMX): without, it would be slower than float32."""
    return bool(torch.ops.mkldnn._is_mkldnn_bf16_supported()) and torch.backends.cpu.get_cpu_capability() == "AVX512"


def _check_network(network: DarknetConfig, source: NetworkSource, classes: tuple[str, ...]) -> None:
    for layer in network.outputs:
        if not isinstance(layer.spec, Yolo) or layer.spec.new_coords:
            raise ConfigError(
                f"{source.cfg}:{layer.line}: only [yolo] outputs without new_coords can be trained; choose a YOLOv3 or "
                "YOLOv4 network"
            )
    if network.classes != len(classes) and not source.change_classes:
        raise ConfigError(
            f"{source.cfg}: has {network.classes} classes, but the data have {len(classes)} ({', '.join(classes)}); "
            "give --change-classes, or name the classes with --names"
        )
    if source.names and source.weights is not None and len(source.names) != network.classes:
        raise ConfigError(
            f"{source.cfg}: has {network.classes} classes, but {len(source.names)} names were given for it"
        )


def _network_file(
    source: NetworkSource,
    original: DarknetConfig,
    gathered: Gathered,
    config: DetectorConfig,
    folder: Path,
    progress: Progress,
) -> DarknetConfig:
    """The network with the data's classes and fitted anchors; its cfg lies in ``folder`` afterwards."""
    path = folder / "network.cfg"
    if not (path.exists() and (folder / CHECKPOINT).exists()):
        anchors = None
        if config.fit_anchors:
            extents = _extents(gathered.training, original.size)
            anchors = fit_anchors(extents, original, np.random.default_rng([config.seed, 6]))
            before = [shape for layer in original.outputs for shape in original.output_spec(layer).anchors]
            after = [shape for own in anchors for shape in own]
            progress.say(
                f"anchors fitted: {', '.join(f'{w:.0f}x{h:.0f}' for w, h in after)} px; mean overlap with the objects "
                f"{mean_best_overlap(extents, after):.2f}, the cfg's {mean_best_overlap(extents, before):.2f}"
            )
        text = source.cfg.read_text(encoding="utf-8", errors="replace")
        classes = len(gathered.classes)
        changed = cfg_with(text, original, anchors=anchors, classes=classes, size=original.size)
        _write_file(path, changed.encode())
    return read_cfg(path)


def _extents(samples: Sequence[Sample], size: tuple[int, int]) -> NDArray[np.float64]:
    """Widths and heights (N, 2) of all objects in px of the network's input."""
    found = []
    for sample in samples:
        if len(sample.xyxy):
            height, width = picture_size(sample.picture)
            fit = min(size[0] / height, size[1] / width)
            found.append((sample.xyxy[:, 2:] - sample.xyxy[:, :2]).astype(np.float64) * fit)
    return np.concatenate(found)


def _take_over_(
    network: DarknetNetwork, original: DarknetConfig, source: NetworkSource, classes: tuple[str, ...]
) -> None:
    """Starts from a weights file, in place: all of it, but of other classes only those that have the same name."""
    assert source.weights is not None
    weights, _ = read_weights(source.weights, original)
    own = network.weights()
    if original.classes == len(classes) and (not source.names or source.names == classes):
        network.load_weights_(weights)
        return
    rows = {usual_name(name): number for number, name in enumerate(source.names)}
    for layer in original.outputs:
        index, anchors = layer.index - 1, len(original.output_spec(layer).anchors)
        theirs, ours = weights[index], own[index]
        kernel = ours.kernel.reshape(anchors, 5 + len(classes), *ours.kernel.shape[1:]).copy()
        bias = ours.bias.reshape(anchors, 5 + len(classes)).copy()
        their_kernel = theirs.kernel.reshape(anchors, 5 + original.classes, *theirs.kernel.shape[1:])
        their_bias = theirs.bias.reshape(anchors, 5 + original.classes)
        pairs = [(n, n) for n in range(5)]
        pairs += [(5 + n, 5 + rows[name]) for n, name in enumerate(map(usual_name, classes)) if name in rows]
        for mine, other in pairs:
            kernel[:, mine], bias[:, mine] = their_kernel[:, other], their_bias[:, other]
        weights[index] = replace(theirs, kernel=kernel.reshape(ours.kernel.shape), bias=bias.ravel())
    network.load_weights_(weights)


def _write(
    network: DarknetNetwork,
    classes: tuple[str, ...],
    output: Path,
    folder: Path,
    source: NetworkSource,
    license: str,
    about: dict[str, str],
) -> ModelMetadata:
    """The model file; and beside the checkpoints network, weights and names as Darknet has them."""
    _write_file(folder / "network.weights", weights_bytes(network.weights()))
    _write_file(folder / "network.names", "".join(f"{name}\n" for name in classes).encode())
    origin = {"cfg": source.cfg.name, "started_from": source.weights.name if source.weights else "random weights"}
    return write_detector(network, classes, output, descriptors=True, license=license, source=origin, training=about)


def _write_file(path: Path, content: bytes) -> None:
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_bytes(content)
        unfinished.replace(path)
    except OSError as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(
            f"{path}: cannot be written ({exc.strerror}); make room or choose another place with -o"
        ) from exc


def _about(config: DetectorConfig, data: DetectorData, gathered: Gathered) -> dict[str, str]:
    """What the model file says about its training."""
    names = [*(s.name for s in data.stills), *(s.name for s in data.sequences), *(p.name for p in data.videos)]
    return {
        "data": one_line(", ".join(names))[:5000],
        "settings": ", ".join(f"{name}={value}" for name, value in asdict(config).items()),
        "pictures": str(len(gathered.training)),
        "torch": version("torch"),
    }
