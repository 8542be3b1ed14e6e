"""What is kept beside a trained model file: enough to know what made it, and to make it again."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Protocol

from matplotlib.figure import Figure

from lookonce.datasets import LabelledObjects, LabelledSequence, LabelledStills
from lookonce.errors import ConfigError, OutputError
from lookonce.make.training.chunks import is_whole_chunk
from lookonce.video.opening import one_line

__all__ = [
    "Curve",
    "Data",
    "check_tensorboard",
    "fingerprint",
    "open_run",
    "write_curves_for_tensorboard",
    "write_record",
]

_PACKAGES = (
    *("lookonce", "torch", "lightning-fabric", "onnx-ir", "numpy", "pillow", "av"),
    *("onnxruntime", "onnxruntime-gpu", "onnxruntime-openvino"),
)
_IDENTITY = "run.json"


class Data(Protocol):
    """What a training learns from."""

    @property
    def sequences(self) -> Sequence[LabelledSequence]:
        """Labelled videos."""
        ...

    @property
    def stills(self) -> Sequence[LabelledStills]:
        """Pictures."""
        ...

    @property
    def videos(self) -> Sequence[Path]:
        """Without labels."""
        ...


@dataclass(frozen=True, slots=True)
class Curve:
    """A line of the picture of a training, a value for each look.

    Attributes:
        name: for the axis.
        values: as many as there were looks.
    """

    name: str
    values: Sequence[float]


def fingerprint(data: Data) -> dict[str, str]:
    """A digest of each piece of data: its labels, and names and sizes of its pictures; of a video the whole file.

    Raises:
        ConfigError: a file cannot be read.
    """
    digests: dict[str, str] = {}
    for number, sequence in enumerate(data.sequences, 1):
        content = hashlib.sha256(_digest(sequence.pictures).encode())
        for frame in sequence.frames:
            content.update(f"{frame.index} {len(frame.objects)}".encode() + _labels(frame.objects))
        digests[f"{sequence.layout} {number} {sequence.name}"] = content.hexdigest()
    for number, stills in enumerate(data.stills, 1):
        content = hashlib.sha256()
        for path, objects in zip(stills.pictures, stills.objects, strict=True):
            content.update(_name_and_size(path) + _labels(objects))
        digests[f"stills {number} {stills.name}"] = content.hexdigest()
    for number, path in enumerate(data.videos, 1):
        digests[f"video {number} {path.name}"] = _digest(path)
    return digests


def _labels(objects: LabelledObjects) -> bytes:
    return b"".join(a.tobytes() for a in (objects.xyxy, objects.identities, objects.labels, objects.visibility))


def _name_and_size(path: Path) -> bytes:
    try:
        return f"{path.name} {path.stat().st_size} ".encode(errors="replace")
    except OSError as exc:
        raise _unreadable(path, exc) from exc


def _digest(path: Path) -> str:
    content = hashlib.sha256()
    try:
        if path.is_dir():
            for picture in sorted(path.iterdir()):
                content.update(_name_and_size(picture))
            return content.hexdigest()
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as exc:
        raise _unreadable(path, exc) from exc


def _unreadable(path: Path, exc: OSError) -> ConfigError:
    return ConfigError(f"{one_line(path)}: cannot be read ({exc.strerror}); check the path and its permissions")


def open_run(folder: Path, identity: Mapping[str, object], *, resume: bool, overwrite: bool) -> None:
    """Make the folder of a run, or find the one of the same run that was interrupted.

    A folder in which nothing has been made yet counts as empty: its run failed early.

    Args:
        folder: beside the model file to be written.
        identity: all that the result depends on; features depend on all but ``settings``.
        resume: go on with what is there.
        overwrite: throw away what is there, except whole features that this run would make again.

    Raises:
        ConfigError: there is another run in the folder, or nothing to resume.
        OutputError: the folder cannot be written.
    """
    path, text = folder / _IDENTITY, json.dumps(identity, sort_keys=True, indent=1)
    chunks, checkpoint = sorted(folder.glob("features/chunk-*.npz")), folder / "checkpoint.safetensors"
    earlier = _read_identity(path)
    shown = one_line(folder)
    if resume and earlier is None:
        raise ConfigError(f"{shown}: nothing to go on with; run again without --resume")
    if resume and earlier != json.loads(text):
        raise ConfigError(f"{shown}: that run had other data or settings; give the same, or begin with --overwrite")
    if resume:
        return
    if (chunks or checkpoint.exists()) and not overwrite:
        raise ConfigError(f"{shown}: there is a run already; go on with --resume, or replace it with --overwrite")
    has_same_features = earlier is not None and _of_features(earlier) == _of_features(json.loads(text))
    _remove(checkpoint)
    for chunk in chunks:
        if not (has_same_features and is_whole_chunk(chunk)):
            _remove(chunk)
    _write(path, text)


def _read_identity(path: Path) -> dict[str, object] | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _of_features(identity: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in identity.items() if name != "settings"}


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as exc:
        raise OutputError(
            f"{one_line(path)}: cannot be removed ({exc.strerror}); choose another place with -o"
        ) from exc


def write_record(
    folder: Path,
    identity: Mapping[str, object],
    result: Mapping[str, object],
    seconds: float,
    *,
    x: Curve,
    loss: Curve,
    quality: Curve,
    best: int,
) -> None:
    """Write ``record.json`` (what made the model file, and how well it went) and ``curves.png``.

    Args:
        folder: of the run.
        identity: all that the result depends on.
        result: what came out; must be fit for JSON.
        seconds: that it took.
        x: steps or epochs of the looks.
        loss: of the training.
        quality: on what was held out.
        best: number of the look whose weights were kept.

    Raises:
        OutputError: they cannot be written.
    """
    about = {
        **identity,
        **result,
        "seconds": round(seconds, 1),
        "versions": _versions(),
        "machine": platform.machine(),
    }
    _write(folder / "record.json", json.dumps(about, indent=1, sort_keys=True))
    _draw_curves(folder / "curves.png", x, loss, quality, best)


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):  # one of the onnxruntime is installed
            versions[name] = version(name)
    return versions


def _draw_curves(path: Path, x: Curve, loss: Curve, quality: Curve, best: int) -> None:
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.plot(x.values, loss.values, color="#0072b2", marker="o", markersize=3, label=loss.name)
    axes.set_xlabel(x.name)
    axes.set_ylabel(loss.name, color="#0072b2")
    right = axes.twinx()
    right.plot(x.values, quality.values, color="#d55e00", marker="s", markersize=3, linestyle="--")
    right.set_ylabel(quality.name, color="#d55e00")
    right.axvline(x.values[best], color="#d55e00", linewidth=0.8, linestyle=":")
    axes.set_title(f"best: {quality.values[best]:.3f} at {x.name} {x.values[best]}")
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


def check_tensorboard() -> None:
    """Look whether the package tensorboard is there, before the work is done.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import torch.utils.tensorboard  # noqa: F401
    except ModuleNotFoundError as exc:
        raise ConfigError("--tensorboard needs the package tensorboard; pip install tensorboard") from exc


def write_curves_for_tensorboard(folder: Path, steps: Sequence[int], curves: Mapping[str, Sequence[float]]) -> None:
    """Write curves as TensorBoard events: of each name a value for each of ``steps``."""
    from torch.utils.tensorboard import SummaryWriter

    with SummaryWriter(folder) as writer:
        for name, values in curves.items():
            for step, value in zip(steps, values, strict=True):
                writer.add_scalar(name, value, step)
