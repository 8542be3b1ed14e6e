"""What is kept beside a trained model file: enough to know what made it, and to make it again."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from matplotlib.figure import Figure

from lookonce.errors import ConfigError, OutputError
from lookonce.make.training.config import FitConfig
from lookonce.make.training.fit import FitData, FitResult
from lookonce.make.training.loop import History

__all__ = ["fingerprint", "open_run", "write_record"]

_PACKAGES = ("lookonce", "torch", "onnxruntime", "onnx-ir", "numpy", "pillow", "av")
_IDENTITY = "run.json"


def fingerprint(data: FitData) -> dict[str, str]:
    """A digest of each piece of data: its labels, and names and sizes of its pictures; of a video the whole file."""
    digests: dict[str, str] = {}
    for sequence in data.sequences:
        content = hashlib.sha256(str(sequence.pictures.name).encode())
        for frame in sequence.frames:
            content.update(
                f"{frame.index}".encode() + frame.objects.xyxy.tobytes() + frame.objects.identities.tobytes()
            )
        digests[f"{sequence.layout} {sequence.name}"] = content.hexdigest()
    for stills in data.stills:
        content = hashlib.sha256()
        for path, objects in zip(stills.pictures, stills.objects, strict=True):
            content.update(f"{path.name} {path.stat().st_size}".encode() + objects.xyxy.tobytes())
        digests[f"stills {stills.name}"] = content.hexdigest()
    for path in data.videos:
        digests[f"video {path.name}"] = _digest(path)
    return digests


def _digest(path: Path) -> str:
    content = hashlib.sha256()
    try:
        if path.is_dir():
            for picture in sorted(path.iterdir()):
                content.update(f"{picture.name} {picture.stat().st_size}".encode())
            return content.hexdigest()
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be read ({exc.strerror}); check the path") from exc


def open_run(folder: Path, identity: dict[str, object], *, resume: bool, overwrite: bool) -> None:
    """Make the folder of a run, or find the one of the same run that was interrupted.

    Args:
        folder: beside the model file to be written.
        identity: all that the result depends on.
        resume: go on with what is there.
        overwrite: throw away what is there.

    Raises:
        ConfigError: there is another run in the folder, or nothing to resume.
        OutputError: the folder cannot be written.
    """
    path, text = folder / _IDENTITY, json.dumps(identity, sort_keys=True, indent=1)
    if overwrite and not resume:
        for old in (*folder.glob("features/chunk-*.npz"), folder / "checkpoint.safetensors", path):
            old.unlink(missing_ok=True)
    if not path.exists():
        if resume and folder.exists():
            raise ConfigError(f"{folder}: nothing to go on with; run again without --resume")
        _write(path, text)
    elif not resume:
        raise ConfigError(f"{folder}: there is a run already; go on with --resume, or replace it with --overwrite")
    elif path.read_text(encoding="utf-8") != text:
        raise ConfigError(
            f"{folder}: that run had other data or settings; give the same, or replace it with --overwrite"
        )


def write_record(
    folder: Path, result: FitResult, config: FitConfig, identity: dict[str, object], seconds: float
) -> None:
    """Write ``record.json`` and ``curves.png``.

    Raises:
        OutputError: they cannot be written.
    """
    about = {
        **identity,
        "seconds": round(seconds, 1),
        "readings": result.rows,
        "identities": result.identities,
        "validation": asdict(result.validation),
        "history": asdict(result.history),
        "versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
        "machine": platform.machine(),
        "config": asdict(config),
    }
    _write(folder / "record.json", json.dumps(about, indent=1, sort_keys=True))
    _draw_curves(folder / "curves.png", result.history)


def _draw_curves(path: Path, history: History) -> None:
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.plot(history.step, history.loss, color="#0072b2", marker="o", markersize=3, label="training loss")
    axes.set_xlabel("step")
    axes.set_ylabel("training loss", color="#0072b2")
    right = axes.twinx()
    right.plot(history.step, history.error_rate, color="#d55e00", marker="s", markersize=3, linestyle="--")
    right.set_ylabel("equal error rate of held-out identities", color="#d55e00")
    best = history.best
    right.axvline(history.step[best], color="#d55e00", linewidth=0.8, linestyle=":")
    axes.set_title(f"best: {history.error_rate[best]:.3f} after {history.step[best]} steps")
    try:
        figure.savefig(path, dpi=120, metadata={"Software": None})
    except OSError as exc:
        raise OutputError(f"{path}: cannot be written ({exc.strerror}); make room") from exc


def _write(path: Path, text: str) -> None:
    unfinished = path.with_suffix(".unfinished")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_text(text, encoding="utf-8")
        os.replace(unfinished, path)
    except OSError as exc:
        with suppress(OSError):
            unfinished.unlink()
        raise OutputError(f"{path}: cannot be written ({exc.strerror}); choose another place with -o") from exc


def write_curves_for_tensorboard(folder: Path, history: History) -> None:
    """Write the curves as TensorBoard events.

    Raises:
        ConfigError: the package tensorboard is not installed.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ModuleNotFoundError as exc:
        raise ConfigError("--tensorboard needs the package tensorboard; pip install tensorboard") from exc
    with SummaryWriter(folder) as writer:
        for number, step in enumerate(history.step):
            for name in ("loss", "error_rate", "learning_rate"):
                writer.add_scalar(name, getattr(history, name)[number], step)
