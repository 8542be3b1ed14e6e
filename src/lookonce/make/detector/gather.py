"""What there is to learn from, as samples: labelled stills and sequences, and what a teacher finds elsewhere."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.boxes import iou
from lookonce.datasets import LabelledSequence, LabelledStills, usual_name
from lookonce.errors import ConfigError, OutputError, VideoError
from lookonce.make.detector.samples import Sample
from lookonce.make.detector.settings import DetectorConfig
from lookonce.make.training.pictures import open_picture
from lookonce.structures import Detections
from lookonce.video import open_video
from lookonce.video.opening import one_line

__all__ = ["DetectorData", "Gathered", "Teacher", "gather"]

_SAME_OBJECT = 0.5  # overlap from which a teacher's box is one that is labelled already
_JPEG_QUALITY = 92
_LEAST_VISIBLE = 0.25  # of an object in a sequence: below, it is neither taught nor a negative
_MANY_SEQUENCES = 5
_VALIDATION_BLOCK = 8  # neighbouring pictures that stay together: they are often of one camera


class Teacher(Protocol):
    """Finds objects where there are no labels."""

    @property
    def names(self) -> tuple[str, ...]:
        """Class names, by label."""
        ...

    def detect(self, image: NDArray[np.uint8]) -> Detections:
        """Objects in an (H, W, 3) RGB picture, down to low scores."""
        ...


@dataclass(frozen=True, slots=True)
class DetectorData:
    """What to learn from, any mixture.

    Attributes:
        stills: labelled pictures.
        sequences: labelled videos.
        videos: without labels, for a teacher.
        labelled: set or sequence name -> classes whose every object is labelled there. By default those that occur.
        left_out: pictures that are not used at all, by the end of their path, such as ``atl/images/a.jpg``.
    """

    stills: tuple[LabelledStills, ...] = ()
    sequences: tuple[LabelledSequence, ...] = ()
    videos: tuple[Path, ...] = ()
    labelled: dict[str, tuple[str, ...]] = field(default_factory=dict)
    left_out: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Gathered:
    """All samples.

    Attributes:
        classes: names of what is learnt, by label.
        training, validation: the samples.
    """

    classes: tuple[str, ...]
    training: list[Sample]
    validation: list[Sample]


Report = Callable[[str, int, int | None], None]


def gather(
    data: DetectorData,
    classes: tuple[str, ...],
    config: DetectorConfig,
    teacher: Teacher | None,
    folder: Path,
    *,
    size: tuple[int, int],
    report: Report,
    say: Callable[[str], None],
) -> Gathered:
    """Collect samples.

    Args:
        data: what there is.
        classes: names of what is learnt.
        config: settings.
        teacher: labels what is not labelled; None: unlabelled videos are an error.
        folder: where frames of videos are put as pictures.
        size: (height, width) of the network's input in px.
        report: called with stage, done, total.
        say: called with findings.

    Raises:
        ConfigError: a class is unknown, or there is too little to learn from.
        LookonceError: a picture or video cannot be read.
    """
    helper = _Labeller(teacher, classes, config, size) if teacher is not None else None
    training: list[Sample] = []
    validation: list[Sample] = []
    _check_names(data, classes)
    for stills in data.stills:
        found = _of_stills(stills, classes, data)
        if helper:
            found = _complete(found, helper, stills.name, report)
        kept, held = _divide(found, config)
        training += kept
        validation += held
        _tell(stills.name, found, classes, say)
    of_sequences = []
    for sequence in data.sequences:
        found = _of_sequence(sequence, classes, data, config, folder, report)
        if helper:
            found = _complete(found, helper, sequence.name, report)
        of_sequences.append(found)
        _tell(sequence.name, found, classes, say)
    kept, held = _divide_sequences(of_sequences, config, is_alone=not data.stills)
    training += kept
    validation += held
    for path in data.videos:
        if helper is None:
            raise ConfigError(f"{one_line(path)}: has no labels; give --teacher MODEL.onnx, or label it")
        frames = [picture for _, picture in _frames(path, config.video_frames, folder, path.stem, None, report)]
        found = [helper.label(_nothing_known(picture, len(classes))) for picture in frames]
        found = [sample for sample in found if len(sample.labels)]  # a teacher that sees nothing may just be blind here
        training += found
        _tell(path.stem, found, classes, say)
    if not any(len(sample.labels) for sample in training):
        raise ConfigError("no labelled object to learn from; give labelled pictures, or --teacher MODEL.onnx")
    if not any(sample.labelled[sample.labels].any() for sample in validation):
        raise ConfigError("no labelled object to validate on; give more labelled stills, or a larger held_out")
    return Gathered(classes, training, validation)


def _check_names(data: DetectorData, classes: tuple[str, ...]) -> None:
    by_name: dict[str, str] = {}
    for name in classes:
        if twin := by_name.get(usual_name(name)):
            raise ConfigError(f"classes '{twin}' and '{name}' are one; name the classes with --names, or rename one")
        by_name[usual_name(name)] = name
    sets = {stills.name for stills in data.stills} | {sequence.name for sequence in data.sequences}
    for name, wanted in data.labelled.items():
        if name not in sets:
            raise ConfigError(f"labelled '{name}': no such set; expected one of {', '.join(sorted(sets))}")
        if unknown := set(wanted) - set(classes):
            raise ConfigError(f"labelled '{name}': '{min(unknown)}' is no class here; expected {', '.join(classes)}")


def _of_stills(stills: LabelledStills, classes: tuple[str, ...], data: DetectorData) -> list[Sample]:
    numbers = _numbers(stills.classes, classes)
    occurring = {int(numbers[n]) for objects in stills.objects for n in objects.labels} - {-1}
    labelled = _mask(data.labelled.get(stills.name), occurring, classes)
    samples = []
    for picture, objects in zip(stills.pictures, stills.objects, strict=True):
        if _is_left_out(picture, data.left_out):
            continue
        labels = numbers[objects.labels]
        kept = labels >= 0
        empty = np.zeros((0, 4), np.float32)
        samples.append(Sample(picture, objects.xyxy[kept], labels[kept], labelled, empty))
    return samples


def _of_sequence(
    sequence: LabelledSequence,
    classes: tuple[str, ...],
    data: DetectorData,
    config: DetectorConfig,
    folder: Path,
    report: Report,
) -> list[Sample]:
    numbers = _numbers(sequence.classes, classes)
    occurring = {int(numbers[n]) for frame in sequence.frames for n in frame.objects.labels} - {-1}
    labelled = _mask(data.labelled.get(sequence.name), occurring, classes)
    objects = {frame.index: frame.objects for frame in sequence.frames}
    frames = _frames(sequence.pictures, config.video_frames, folder, sequence.name, set(objects), report)
    samples = []
    for index, picture in frames:
        there = objects[index]
        labels = numbers[there.labels]
        is_known, is_seen = labels >= 0, there.visibility >= _LEAST_VISIBLE
        ignored = np.concatenate([sequence.ignored, there.xyxy[is_known & ~is_seen]])
        taught = is_known & is_seen
        samples.append(Sample(picture, there.xyxy[taught], labels[taught], labelled, ignored))
    return samples


def _numbers(own: tuple[str, ...], classes: tuple[str, ...]) -> NDArray[np.int64]:
    """By label of a set the class's number here; -1 for a class that is not learnt."""
    known = {usual_name(name): number for number, name in enumerate(classes)}
    return np.array([known.get(usual_name(name), -1) for name in own], np.int64)


def _mask(wanted: Sequence[str] | None, occurring: Iterable[int], classes: tuple[str, ...]) -> NDArray[np.bool_]:
    if wanted is not None:
        return np.array([name in wanted for name in classes])
    return np.isin(np.arange(len(classes)), list(occurring))


def _is_left_out(picture: Path, endings: frozenset[str]) -> bool:
    parts = picture.as_posix().split("/")
    return any("/".join(parts[-n:]) in endings for n in range(1, min(len(parts), 4) + 1))


def _divide(samples: list[Sample], config: DetectorConfig) -> tuple[list[Sample], list[Sample]]:
    """Blocks of neighbouring pictures are held out: those beside each other are often of one camera."""
    length = min(_VALIDATION_BLOCK, max(1, len(samples) // 3))
    blocks = [samples[start : start + length] for start in range(0, len(samples), length)]
    rng = np.random.default_rng([config.seed, 3])
    count = round(config.held_out * len(blocks)) or int(len(blocks) > 1)
    held = set(rng.permutation(len(blocks))[:count].tolist())
    training = [sample for number, block in enumerate(blocks) for sample in block if number not in held]
    return training, [sample for number, block in enumerate(blocks) for sample in block if number in held]


def _divide_sequences(
    sequences: list[list[Sample]], config: DetectorConfig, *, is_alone: bool
) -> tuple[list[Sample], list[Sample]]:
    """Of many sequences some are held out whole; of few only where there are no stills to validate on."""
    count = len(sequences)
    if count == 1 and is_alone:
        end = len(sequences[0]) - max(1, round(config.held_out * len(sequences[0])))
        return sequences[0][:end], sequences[0][end:]
    held: set[int] = set()
    if count >= _MANY_SEQUENCES or (is_alone and count):
        order = np.random.default_rng([config.seed, 7]).permutation(count)
        held = set(order[: max(1, round(config.held_out * count))].tolist())
    training = [sample for number, part in enumerate(sequences) for sample in part if number not in held]
    return training, [sample for number, part in enumerate(sequences) for sample in part if number in held]


def _frames(
    source: Path, limit: int, folder: Path, name: str, wanted: set[int] | None, report: Report
) -> Iterator[tuple[int, Path]]:
    """Evenly spread frames as picture files, by index; those that are there already are used again."""
    place = _place_of_frames(source, folder, name)
    with open_video(source) as video:
        total = video.frame_count
        indices = None if wanted is None else sorted(wanted)
        if indices is None and total is not None:
            indices = list(range(total))
        picked = None if indices is None else set(_spread(indices, limit))
        done = 0
        for frame in video:
            if picked is not None and frame.index not in picked:
                continue
            path = place / f"{frame.index:06d}.jpg"
            if not path.exists():
                _save(frame.image, path)
            done += 1
            report(f"frames of {one_line(name)}", done, None if picked is None else len(picked))
            yield frame.index, path
            if done >= limit or (picked is not None and done >= len(picked)):
                return


def _place_of_frames(source: Path, folder: Path, name: str) -> Path:
    """A folder for the frames of this very video: another one of that name, or a later version, has another."""
    try:
        about = source.stat()
    except OSError as exc:
        raise VideoError(f"{one_line(source)}: cannot be read ({exc.strerror}); check the path") from exc
    known = f"{source.resolve()} {about.st_size} {about.st_mtime_ns}"
    mark = hashlib.sha256(known.encode(errors="surrogateescape")).hexdigest()[:8]
    return folder / "frames" / f"{one_line(name).replace('/', '_')}-{mark}"


def _spread(indices: Sequence[int], limit: int) -> list[int]:
    if len(indices) <= limit:
        return list(indices)
    return [indices[int(n)] for n in np.linspace(0, len(indices) - 1, limit).round()]


def _save(image: NDArray[np.uint8], path: Path) -> None:
    unfinished = path.with_suffix(".unfinished")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(image).save(unfinished, "JPEG", quality=_JPEG_QUALITY)
        unfinished.replace(path)
    except OSError as exc:
        raise OutputError(
            f"{one_line(path)}: cannot be written ({exc.strerror}); make room or choose another -o"
        ) from exc


def _nothing_known(picture: Path, classes: int) -> Sample:
    empty = np.zeros((0, 4), np.float32)
    return Sample(picture, empty, np.zeros(0, np.int64), np.zeros(classes, np.bool_), empty)


def _complete(samples: list[Sample], helper: _Labeller, name: str, report: Report) -> list[Sample]:
    """Samples with the teacher's labels for classes that are not labelled."""
    if all(sample.labelled[helper.known].all() for sample in samples):
        return samples
    done = []
    for sample in samples:
        done.append(helper.label(sample))
        report(f"teacher on {one_line(name)}", len(done), len(samples))
    return done


def _tell(name: str, samples: Sequence[Sample], classes: tuple[str, ...], say: Callable[[str], None]) -> None:
    labels = np.concatenate([np.zeros(0, np.int64), *(sample.labels for sample in samples)])
    counts = np.bincount(labels, minlength=len(classes))
    found = ", ".join(f"{n} {c}" for c, n in zip(classes, counts, strict=True) if n) or "no objects"
    silent = ", ".join(c for n, c in enumerate(classes) if not any(sample.labelled[n] for sample in samples))
    note = f"; says nothing of {silent}" if silent and samples else ""
    say(f"{one_line(name)}: {len(samples)} pictures, {found}{note}")


class _Labeller:
    """A teacher's detections as labels of the classes that a picture does not label."""

    def __init__(
        self, teacher: Teacher, classes: tuple[str, ...], config: DetectorConfig, size: tuple[int, int]
    ) -> None:
        self._teacher, self._config, self._size = teacher, config, size
        self._numbers = _numbers(teacher.names, classes)
        self.known = np.isin(np.arange(len(classes)), self._numbers)  # (C,) classes that the teacher knows
        if not self.known.any():
            raise ConfigError(f"the teacher knows none of the classes {', '.join(classes)}")

    def label(self, sample: Sample) -> Sample:
        """The sample with confident detections as labels, and doubtful ones as ignored regions."""
        wanted = ~sample.labelled & self.known
        if not wanted.any():
            return sample
        picture, factor = open_picture(sample.picture, self._size)
        found = self._teacher.detect(np.asarray(picture))
        labels = self._numbers[found.labels]
        is_new = (labels >= 0) & wanted[labels] & (found.scores >= self._config.teacher_doubt)
        xyxy = (found.xyxy / factor).astype(np.float32)
        if len(sample.xyxy) and len(xyxy):
            is_new &= iou(xyxy, sample.xyxy).max(axis=1) < _SAME_OBJECT
        is_sure = is_new & (found.scores >= self._config.teacher_score)
        return replace(
            sample,
            xyxy=np.concatenate([sample.xyxy, xyxy[is_sure]]),
            labels=np.concatenate([sample.labels, labels[is_sure]]),
            labelled=sample.labelled | wanted,
            ignored=np.concatenate([sample.ignored, xyxy[is_new & ~is_sure]]),
        )
