"""One model file on labelled data: how far its descriptors tell objects apart, before any tracking."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lookonce.datasets import LabelledFrame, LabelledSequence
from lookonce.errors import ConfigError
from lookonce.evaluation import Aspect, BreakdownBin, advice, break_down
from lookonce.make.probing.describing import OnFrame, Reading, Tally, read_sequences
from lookonce.make.probing.gaps import GapLimits
from lookonce.make.probing.measuring import Measures, measure
from lookonce.make.probing.reading import BoxReader, open_reader
from lookonce.model import ModelMetadata
from lookonce.video.opening import one_line

__all__ = ["ASPECTS", "ProbeResult", "ProbeSettings", "choose_classes", "probe"]

ASPECTS: tuple[Aspect, ...] = ("time_gap", "size_change", "height", "grid_change")


@dataclass(frozen=True, slots=True)
class ProbeSettings:
    """What a probe depends on besides the files, checked on construction.

    Attributes:
        boxes: ``truth`` or ``detections``, as for ``open_reader``.
        limits: which boxes are compared.
        classes: names of the data's classes; none = all.
        every: only frames whose index is a multiple of this, 1 or more.
        score: detections above this score are kept, 0 to 1; without effect on truth boxes.
        fps: frames per second of picture folders; None = as stated for each, else 25.
        match_threshold: distance below which a tracker takes two boxes for one object, above 0 and up to 2; None = the
            model file's, or where it has none that of the equal error rate.

    Raises:
        ConfigError: a field is out of range.
    """

    boxes: str = "truth"
    limits: GapLimits = field(default_factory=GapLimits)
    classes: tuple[str, ...] = ()
    every: int = 1
    score: float = 0.1
    fps: float | None = None
    match_threshold: float | None = None

    def __post_init__(self) -> None:
        if self.every < 1:
            raise ConfigError(f"every: expected a whole number >= 1, got {self.every}")
        if self.match_threshold is not None and not 0 < self.match_threshold <= 2:
            raise ConfigError(f"match_threshold: expected above 0, up to 2, got {self.match_threshold}")


@dataclass(frozen=True, slots=True)
class ProbeResult:
    """All that a probe found.

    Attributes:
        path: the model file.
        sha256: its digest.
        metadata: what it says about itself.
        settings: as given.
        match_threshold: the distance that the rates and parts refer to.
        threshold_source: where it comes from: ``model file``, ``setting`` or ``equal error rate``.
        overall: of all sequences together.
        by_sequence: of each, in the order given.
        parts: by aspect, from the smallest value.
        advice: one sentence for people.
        reading: the objects themselves.
    """

    path: Path
    sha256: str
    metadata: ModelMetadata
    settings: ProbeSettings
    match_threshold: float
    threshold_source: str
    overall: Measures
    by_sequence: tuple[Measures, ...]
    parts: Mapping[Aspect, tuple[BreakdownBin, ...]]
    advice: str
    reading: Reading

    @property
    def tallies(self) -> tuple[Tally, ...]:
        """What became of each sequence, in the order given."""
        return self.reading.tallies


def probe(
    model: Path | BoxReader,
    sequences: Sequence[LabelledSequence],
    settings: ProbeSettings | None = None,
    *,
    provider: str = "cpu",
    threads: int | None = None,
    on_frame: OnFrame | None = None,
) -> ProbeResult:
    """How far the descriptors of a model file tell the objects of labelled sequences apart.

    Args:
        model: a model file, or what ``open_reader`` opened with the same ``boxes`` and ``score``.
        sequences: with truth; boxes of different ones are never compared.
        settings: the defaults of ``ProbeSettings`` without any.
        provider: ``cpu`` or ``cuda``; of no effect on an opened reader, like ``threads``.
        threads: for one inference; all processors by default.
        on_frame: told of the progress.

    Raises:
        ModelError: the model file is damaged or has no descriptors.
        VideoError: pictures cannot be read, change their size, or end before the truth does.
        ConfigError: a setting cannot work, or there is nothing to compare.
    """
    settings = settings or ProbeSettings()
    sequences = choose_classes(sequences, settings.classes)
    if isinstance(model, Path):
        reader = open_reader(model, settings.boxes, score=settings.score, provider=provider, threads=threads)
    else:
        reader = model
    reading = read_sequences(reader, sequences, every=settings.every, fps=settings.fps, on_frame=on_frame)
    _refuse_nothing_found(reading, settings)
    stated, source = _threshold(reader.metadata, settings)
    overall = measure(reading.objects, settings.limits, stated)
    _refuse_no_pairs(overall, settings)
    threshold = overall.equal_error_threshold if stated is None else stated
    parts = _parts(reading, settings.limits, threshold)
    return ProbeResult(
        path=reader.path,
        sha256=_digest(reader.path),
        metadata=reader.metadata,
        settings=settings,
        match_threshold=threshold,
        threshold_source=source,
        overall=overall,
        by_sequence=_by_sequence(reading, settings.limits, threshold, overall),
        parts=parts,
        advice=advice(overall.pairs, parts["time_gap"], parts["height"]),
        reading=reading,
    )


def choose_classes(sequences: Sequence[LabelledSequence], classes: Sequence[str]) -> tuple[LabelledSequence, ...]:
    """The sequences with the objects of these classes only; without classes as they are.

    Raises:
        ConfigError: there is no such class, or no sequence has two identities, so that there is nothing to tell apart.
    """
    known = sorted({name for sequence in sequences for name in sequence.classes})
    unknown = [name for name in classes if name not in known]
    if unknown:
        raise ConfigError(f"class '{one_line(unknown[0])}' is not in the data; it has {one_line(', '.join(known))}")
    chosen = tuple(_only(sequence, classes) for sequence in sequences) if classes else tuple(sequences)
    counts = [_identities(sequence) for sequence in chosen]
    if max(counts, default=0) < 2:
        names = one_line(", ".join(sequence.name for sequence in chosen)) or "no sequence"
        found = "no identity" if max(counts, default=0) == 0 else "one identity"
        of_classes = f" of class {one_line(', '.join(classes))}" if classes else ""
        raise ConfigError(f"{names}: {found}{of_classes}; telling objects apart needs two or more in one sequence")
    return chosen


def _only(sequence: LabelledSequence, classes: Sequence[str]) -> LabelledSequence:
    labels = [label for label, name in enumerate(sequence.classes) if name in classes]
    frames = (
        LabelledFrame(frame.index, frame.objects[np.isin(frame.objects.labels, labels)]) for frame in sequence.frames
    )
    return replace(sequence, frames=tuple(frames))


def _identities(sequence: LabelledSequence) -> int:
    return len({identity for frame in sequence.frames for identity in frame.objects.identities.tolist()})


def _refuse_nothing_found(reading: Reading, settings: ProbeSettings) -> None:
    if len(reading.objects):
        return
    boxes = sum(tally.truth_boxes for tally in reading.tallies)
    if not boxes:
        raise ConfigError(f"no frame with truth is left with every={settings.every}; take a smaller step")
    if sum(tally.found_boxes for tally in reading.tallies):
        raise ConfigError(f"none of {boxes:,} boxes has a descriptor: the model's features are all zero there")
    raise ConfigError(
        f"the model finds none of {boxes:,} truth boxes at score {settings.score:g}; lower the score, or describe the "
        "truth boxes themselves (boxes truth)"
    )


def _refuse_no_pairs(overall: Measures, settings: ProbeSettings) -> None:
    if overall.pairs.genuine_count and overall.pairs.impostor_count:
        return
    which = "two different objects" if overall.pairs.genuine_count else "one and the same object"
    raise ConfigError(
        f"no boxes of {which} lie {settings.limits} apart; choose smaller gaps (--min-gap), or longer sequences"
    )


def _threshold(metadata: ModelMetadata, settings: ProbeSettings) -> tuple[float | None, str]:
    """The match threshold, None = that of the equal error rate, and where it comes from."""
    if settings.match_threshold is not None:
        return settings.match_threshold, "setting"
    assert metadata.descriptor is not None  # the reader is open
    if metadata.descriptor.match_threshold is not None:
        return metadata.descriptor.match_threshold, "model file"
    return None, "equal error rate"


def _by_sequence(reading: Reading, limits: GapLimits, threshold: float, overall: Measures) -> tuple[Measures, ...]:
    if len(reading.tallies) == 1:
        return (overall,)
    sequences = reading.objects.sequences
    return tuple(
        measure(reading.objects[sequences == number], limits, threshold) for number in range(len(reading.tallies))
    )


def _parts(reading: Reading, limits: GapLimits, threshold: float) -> dict[Aspect, tuple[BreakdownBin, ...]]:
    window = limits.window(reading.objects)
    assert not math.isnan(threshold)  # there are pairs
    return {by: break_down(window.objects, window.least, window.most, by, threshold) for by in ASPECTS}


def _digest(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
