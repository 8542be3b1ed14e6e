"""A model file in, labelled or unlabelled pictures beside it, the same model file with trained descriptors out."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray

from lookonce.datasets import LabelledObjects, LabelledSequence, LabelledStills
from lookonce.errors import ConfigError, ModelError
from lookonce.make.descriptors.head import DESCRIPTOR_SIZE
from lookonce.make.export.reopen import RowReader, replace_descriptors
from lookonce.make.training.config import FitConfig
from lookonce.make.training.linking import Links, link_detections
from lookonce.make.training.loop import History, train
from lookonce.make.training.pictures import open_picture
from lookonce.make.training.readings import Readings, read_features
from lookonce.make.training.rendered import CrowdSource, knows_people
from lookonce.make.training.sources import SequenceSource, Source, TrackedBoxes
from lookonce.make.training.stills import StillsSource
from lookonce.make.training.trainables import Head, Kind, kind_of, settled, trainable_for
from lookonce.make.training.validation import Validation, are_comparable, check_comparable
from lookonce.model import DescriptorInfo, Model, ModelMetadata, available_cpus, describe_model
from lookonce.video import open_video
from lookonce.video.opening import one_line

__all__ = ["FitData", "FitResult", "Progress", "fit"]

_FEWEST_IDENTITIES = 4
_MANY_SEQUENCES = 5  # from here on whole sequences are held out
_LEAST_THRESHOLD = 1e-4  # a model file's must be above 0


@dataclass(frozen=True, slots=True)
class FitData:
    """What to learn from, any mixture.

    Attributes:
        sequences: with identities.
        stills: each box its own identity; pictures without any label are searched for objects by the detector.
        videos: without labels.
    """

    sequences: tuple[LabelledSequence, ...] = ()
    stills: tuple[LabelledStills, ...] = ()
    videos: tuple[Path, ...] = ()


@dataclass(frozen=True, slots=True)
class FitResult:
    """What came out.

    Attributes:
        metadata: of the new model file.
        validation: of its descriptors, on identities that were held out.
        history: of the training.
        rows: readings in all.
        identities: trained on.
    """

    metadata: ModelMetadata
    validation: Validation
    history: History
    rows: int
    identities: int


class Progress(Protocol):
    """Who watches."""

    def stage(self, name: str, done: int, total: int | None, note: str = "") -> None:
        """So much of a stage is done."""
        ...

    def say(self, text: str) -> None:
        """A finding that stays on the screen."""
        ...


def fit(
    model: Path,
    data: FitData,
    output: Path,
    config: FitConfig,
    *,
    folder: Path,
    device: str = "auto",
    threads: int | None = None,
    progress: Progress,
) -> FitResult:
    """Train descriptor heads on a frozen detector.

    Args:
        model: a lookonce model file, with or without descriptors.
        data: what to learn from.
        output: the model file to write.
        config: settings.
        folder: for features and checkpoints; what is there already is not made again.
        device: ``auto``, ``cpu`` or ``cuda``.
        threads: processors to use; all by default.
        progress: who watches.

    Raises:
        LookonceError: an input is wrong, or the disk is full; what was made so far is kept in ``folder``.
    """
    metadata = describe_model(model)
    if not metadata.features:
        raise ModelError(
            f"{model}: names no features that descriptors could read; make it again with 'lookonce import'"
        )
    kind = kind_of(config.kind, metadata)
    target = _device(device)
    threads = threads or available_cpus()
    readings = settled(kind, _gather(model, metadata, data, kind, config, folder, threads, progress))
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with torch.random.fork_rng([target] if target.type == "cuda" else []):  # the caller's draws stay as they were
            head, history, validation = _train(kind, readings, config, folder, target, progress)
    finally:
        torch.set_num_threads(before)
    trained = _write(model, output, metadata, kind, head, _about(config, data, readings, validation), validation)
    identities = int((~readings.held_out[np.unique(readings.identity)]).sum())
    return FitResult(trained, validation, history, len(readings), identities)


def _gather(
    model: Path,
    metadata: ModelMetadata,
    data: FitData,
    kind: Kind,
    config: FitConfig,
    folder: Path,
    threads: int,
    progress: Progress,
) -> Readings:
    """All that training sees. The sources with what they keep in memory, and the detector, are gone afterwards."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=r"PIL\.")  # of pictures that are large, and of damaged EXIF
        sources = _sources(model, metadata, data, config, threads, progress)
        _refuse_too_few([len(source.held_out) for source in sources], sources)
        check_comparable([source.lifetimes[source.held_out] for source in sources])
        return _read(model, kind, sources, _crowds(metadata, data, config), config, folder, threads, progress)


def _train(
    kind: Kind, readings: Readings, config: FitConfig, folder: Path, device: torch.device, progress: Progress
) -> tuple[Head, History, Validation]:
    torch.manual_seed(config.seed)
    head = trainable_for(kind, readings, config)

    def report(step: int, history: History) -> None:
        note = f"error rate {min(history.error_rate):.3f}" if history.step else ""
        progress.stage("train", step, config.steps, note)

    history, validation = train(head, readings, config, folder, device=device, report=report)
    progress.stage("train", history.step[-1], config.steps, f"error rate {validation.error_rate:.3f}")
    return head, history, validation


def _device(name: str) -> torch.device:
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if name not in ("cpu", "cuda"):
        raise ConfigError(f"device '{name}': expected auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device 'cuda': PyTorch sees no CUDA device here; use --device cpu")
    return torch.device(name)


def _sources(
    model: Path, metadata: ModelMetadata, data: FitData, config: FitConfig, threads: int, progress: Progress
) -> list[Source]:
    """Every kind of data as sources; identities are dealt out to training and validation here."""
    rng = np.random.default_rng([config.seed, 0])
    tracked = [TrackedBoxes.of_sequence(sequence) for sequence in data.sequences]
    detector = _Detector(model, config.score, threads, progress)
    tracked += [TrackedBoxes.of_links(path.stem, path, detector.link(path)) for path in data.videos]
    tracked = [boxes for boxes in tracked if len(boxes.frames)]
    fit_for_it = [number for number, boxes in enumerate(tracked) if are_comparable(boxes.lifetimes())]
    whole_ones = rng.permutation(fit_for_it)[: max(1, round(config.held_out * len(tracked)))]
    sources: list[Source] = []
    for number, boxes in enumerate(tracked):
        whole = bool(number in whole_ones) if len(tracked) >= _MANY_SEQUENCES else None
        held = _held_identities(boxes, whole, config.held_out, rng)
        seed = [config.seed, 1, number]
        sources.append(SequenceSource(boxes, metadata.size, frames=config.sequence_frames, held_out=held, seed=seed))
    for number, stills in enumerate(data.stills):
        seed = [config.seed, 2, number]
        sources.append(
            StillsSource(
                detector.complete(stills),
                metadata.size,
                views=config.views,
                collages=config.collages,
                variants=config.variants,
                held_out=config.held_out,
                seed=seed,
            )
        )
    return [source for source in sources if source.task_count]


def _crowds(metadata: ModelMetadata, data: FitData, config: FitConfig) -> list[Source]:
    """Rendered people beside what is real, for a detector that knows people."""
    if not (config.crowds and knows_people(metadata.names)):
        return []
    backdrops = [path for stills in data.stills for path in stills.pictures]
    return [CrowdSource(metadata.size, crowds=config.crowds, backdrops=backdrops, seed=[config.seed, 3])]


def _held_identities(boxes: TrackedBoxes, whole: bool | None, share: float, rng: Generator) -> NDArray[np.bool_]:
    """Which identities of a sequence are kept for validation: all or none where there are many sequences.

    Of tracks made by linking those around one moment are: they can be compared with each other, and other pieces of the
    same objects, which are near in time too, are among them rather than among those that are trained on.
    """
    middle = boxes.spans().mean(axis=1)
    count = len(middle)
    if whole is not None:
        return np.full(count, whole)
    held = max(2, round(share * count)) if count >= _FEWEST_IDENTITIES else 0
    order = rng.permutation(count)
    if held and not boxes.is_complete:
        order = order[np.argsort(np.abs(middle[order] - middle[order[0]]), kind="stable")]
    return np.isin(np.arange(count), order[:held])


def _refuse_too_few(identities: Sequence[int], sources: Sequence[Source]) -> None:
    count = sum(identities)
    if count < _FEWEST_IDENTITIES:
        names = ", ".join(one_line(source.name) for source in sources)
        raise ConfigError(
            f"{names or 'nothing to learn from'}: {count} identities in all, expected at least {_FEWEST_IDENTITIES}; "
            "give more data"
        )


class _Detector:
    """The model file's own detections where there are no labels; opened when first needed."""

    def __init__(self, path: Path, score: float, threads: int, progress: Progress) -> None:
        self._path, self._score, self._threads, self._progress = path, score, threads, progress
        self._opened: Model | None = None

    @property
    def _model(self) -> Model:
        if self._opened is None:
            self._opened = Model(self._path, threads=self._threads, score_threshold=self._score)
        return self._opened

    def link(self, path: Path) -> Links:
        """Pure tracks of an unlabelled video."""
        frames = []
        with open_video(path) as video:
            for frame in video:
                frames.append((frame.index, frame.time_s, self._model.detect(frame)))
                self._progress.stage(f"link {one_line(path.name)}", len(frames), video.frame_count)
        links = link_detections(frames)
        self._progress.say(
            f"{one_line(path.name)}: {links.tracks} tracks of {len(links.rows)} detections in {len(frames)} frames; "
            f"cut {links.ambiguous} times for being ambiguous, {links.short} detections in tracks that were too short"
        )
        return links

    def complete(self, stills: LabelledStills) -> LabelledStills:
        """Stills whose pictures without labels have the detector's boxes."""
        if any(len(objects) for objects in stills.objects):
            return stills
        found, name = [], one_line(stills.name)
        for index, path in enumerate(stills.pictures):
            picture, factor = open_picture(path, self._model.size)
            detections = self._model.detect(np.asarray(picture))
            xyxy, count = (detections.xyxy / factor).astype(np.float32), len(detections)
            numbers = np.arange(count, dtype=np.int64)
            found.append(LabelledObjects(xyxy, numbers, detections.labels, np.ones(count, np.float32)))
            self._progress.stage(f"detect in {name}", index + 1, len(stills.pictures))
        self._progress.say(f"{name}: no labels; the detector found {sum(map(len, found))} objects")
        return replace(stills, objects=tuple(found), classes=self._model.names)


def _read(
    model: Path,
    kind: Kind,
    sources: Sequence[Source],
    crowds: Sequence[Source],
    config: FitConfig,
    folder: Path,
    threads: int,
    progress: Progress,
) -> Readings:
    """What the head reads at every box of the real sources, then of the rendered ones."""
    done = total = 0

    def report(now: int, of: int) -> None:
        nonlocal done, total
        done, total = now, of
        progress.stage("read features", done, total)

    readings = read_features(
        [*sources, *crowds],
        lambda: RowReader(model, kind.write_reading),
        folder / "features",
        workers=threads,
        limit_bytes=round(config.cache_gb * 1e9),
        report=report,
    )
    real = readings.source < len(sources)
    _refuse_too_few([len(np.unique(readings.identity[real]))], sources)
    seen = len(np.unique(readings.identity))
    of_all = sum(source.task_count for source in [*sources, *crowds])
    limit = f"; for all {of_all} pictures cache_gb={config.cache_gb:g} is too small" if total < of_all else ""
    progress.say(f"{len(readings)} readings of {seen} identities in {total} pictures{limit}")
    return readings


def _about(config: FitConfig, data: FitData, readings: Readings, validation: Validation) -> dict[str, str]:
    """What the model file says about its training."""
    settings = ", ".join(f"{name}={value}" for name, value in asdict(config).items())
    names = [*(s.name for s in data.sequences), *(s.name for s in data.stills), *(path.name for path in data.videos)]
    return {
        "data": one_line(", ".join(names))[:5000],
        "settings": settings,
        "readings": str(len(readings)),
        "identities": str(len(np.unique(readings.identity))),
        "validation": f"equal error rate {validation.error_rate:.4f}, {validation.identities} identities held out",
        "torch": version("torch"),
    }


def _write(
    model: Path,
    output: Path,
    metadata: ModelMetadata,
    kind: Kind,
    head: Head,
    about: dict[str, str],
    validation: Validation,
) -> ModelMetadata:
    threshold = max(round(validation.threshold, 4), _LEAST_THRESHOLD)
    info = DescriptorInfo(kind.name, DESCRIPTOR_SIZE, kind.layers, threshold)
    trained = replace(metadata, descriptor=info, training=about, made_by=version("lookonce"))
    head.module.cpu().eval()
    replace_descriptors(model, head.write, trained, output)
    return trained
