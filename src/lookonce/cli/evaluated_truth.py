"""The truth that `lookonce eval` holds results against: sequences by name, whatever layout they have."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from lookonce.datasets import LabelledSequence, open_sequences, picture_size
from lookonce.datasets.class_names import unite
from lookonce.datasets.detrac import PicturePlaces, annotation_files
from lookonce.datasets.detrac_xml import read_annotation
from lookonce.datasets.folders import folders_below
from lookonce.datasets.kitti import kitti_files
from lookonce.datasets.motchallenge import is_motchallenge
from lookonce.datasets.text import fault
from lookonce.datasets.truth import picture_folder
from lookonce.errors import ConfigError
from lookonce.evaluation import TrackingTruth, read_detrac_truth, read_motchallenge_truth
from lookonce.evaluation.tracking.motchallenge import Benchmark
from lookonce.video import open_video
from lookonce.video.images import frame_indices, natural_order, pictures_in, sequence_info
from lookonce.video.opening import one_line

__all__ = ["BENCHMARKS", "TrueSequence", "open_truth", "thin"]

BENCHMARKS = ("MOT15", "MOT16", "MOT17", "MOT20")

_ROOT_DEPTH = 2
_NO_OBJECT = "no object that counts; check that it is the right file, or leave this sequence out"


@dataclass(frozen=True, slots=True)
class TrueSequence:
    """A sequence with its truth.

    Attributes:
        name: unique among the sequences of one call.
        file: the truth file.
        truth: what is to be found.
        classes: class names by label, the same for all sequences; empty under a benchmark's rules.
        layout: one of ``lookonce.datasets.LAYOUTS``.
        pictures: a folder or a video; may not exist.
        fps: of a picture folder, where stated.
    """

    name: str
    file: Path
    truth: TrackingTruth
    classes: tuple[str, ...]
    layout: str
    pictures: Path
    fps: float | None


def open_truth(
    path: Path, *, frames: Path | None = None, protocol: str = "trackeval", benchmark: str = ""
) -> tuple[TrueSequence, ...]:
    """All sequences with truth at ``path``, in natural order of their names.

    Args:
        path: what ``open_sequences`` reads.
        frames: pictures of a single sequence.
        protocol: under ``detrac``, UA-DETRAC's XML is read as its toolkit does, without cutting boxes; no pictures are
            needed then.
        benchmark: one of ``BENCHMARKS``, whose rules are to be followed; no pictures are needed then. "" = none.

    Raises:
        LookonceError: there is no truth, it breaks its format, or nothing in it counts.
    """
    if not os.path.exists(path):  # pathlib raises for a name that is too long
        raise ConfigError(f"{one_line(path)}: no such folder or file; check the spelling")
    if benchmark:
        folders = _only_one(path, _mot_folders(path), frames)
        found = [_of_benchmark(folder, benchmark, frames) for folder in folders]
    elif protocol == "detrac" and (files := _only_one(path, _detrac_files(path), frames)):
        found = _of_detrac(files, frames)
    else:
        found = [_of_labelled(path, one) for one in open_sequences(path, pictures=frames)]
    by_name: dict[str, TrueSequence] = {}
    for one in found:
        if not one.truth.is_counted.any():
            raise fault(one.file, 0, _NO_OBJECT)
        twin = by_name.setdefault(one.name, one)
        if twin is not one:
            both = f"{one_line(twin.file)} and {one_line(one.file)}"
            raise ConfigError(f"two sequences are called {one_line(one.name)}: {both}; name one of them")
    return tuple(by_name[str(name)] for name in natural_order(Path(name) for name in by_name))


def _only_one(path: Path, places: list[Path], frames: Path | None) -> list[Path]:
    """``places`` themselves; pictures fit a single sequence."""
    if frames is not None and len(places) > 1:
        raise ConfigError(f"{one_line(path)}: holds {len(places)} sequences, and --frames fits one only; name one")
    if frames is not None and not os.path.exists(frames):
        raise ConfigError(f"{one_line(frames)}: no such folder or video; check --frames")
    return places


def _mot_folders(path: Path) -> list[Path]:
    if path.is_file() and path.name == "gt.txt":
        return [path.absolute().parent.parent]
    folders = [path] if is_motchallenge(path) else [one for one in _below(path) if is_motchallenge(one)]
    if not folders:
        raise ConfigError(f"{one_line(path)}: no gt/gt.txt in it or below; --benchmark is for MOTChallenge sequences")
    return folders


def _below(path: Path) -> list[Path]:
    return folders_below(path, _ROOT_DEPTH) if path.is_dir() else []


def _of_benchmark(folder: Path, benchmark: str, frames: Path | None) -> TrueSequence:
    file, info_file = folder / "gt" / "gt.txt", folder / "seqinfo.ini"
    info = sequence_info(info_file)
    pictures = picture_folder(folder if frames is None else frames)
    count, length = _frame_count(pictures), info.get("seqlength", "").strip()
    if length:
        if not (length.isascii() and length.isdecimal() and len(length) < 9):
            raise fault(info_file, 0, "seqLength: expected a whole number of frames; mend or remove it")
        count = int(length)
    try:
        truth = read_motchallenge_truth(file, cast(Benchmark, benchmark), count)
    except ValueError as exc:
        raise fault(
            file, 0, f"does not fit the {count} frames that the sequence has ({exc}); mend one of them"
        ) from exc
    return TrueSequence(folder.resolve().name, file, truth, (), "motchallenge", pictures, None)


def _frame_count(pictures: Path) -> int | None:
    """How many frames a folder of pictures has; None without pictures and for a video, whose length nobody knows."""
    paths = pictures_in(pictures)
    return frame_indices(paths)[-1] + 1 if paths else None


def _detrac_files(path: Path) -> list[Path]:
    """UA-DETRAC's XML where ``open_sequences`` would read it."""
    if path.is_file():
        return [path] if path.suffix.lower() == ".xml" else []
    if is_motchallenge(path) or kitti_files(path):
        return []
    return _xml_files(path)


def _xml_files(path: Path) -> list[Path]:
    beside = annotation_files(path) or [xml for folder in _below(path) for xml in folder.glob("MVI_*.xml")]
    return natural_order(beside)


def _of_detrac(files: Sequence[Path], frames: Path | None) -> list[TrueSequence]:
    places = PicturePlaces()
    annotations = [read_annotation(file) for file in files]
    classes, numbers = unite([tuple(one.types) for one in annotations])
    found = []
    for file, annotation, new in zip(files, annotations, numbers, strict=True):
        name = annotation.name or file.stem
        if not name.isprintable() or "/" in name or "\\" in name:
            raise fault(file, 0, "the name of <sequence> is no plain name such as MVI_20011; mend it")
        pictures = places.find(file, name) if frames is None else picture_folder(frames)
        truth = _detrac_truth(file, pictures)
        truth = replace(truth, labels=new[truth.labels] if len(new) else truth.labels)
        found.append(TrueSequence(name, file, truth, classes, "ua-detrac", pictures, None))
    return found


def _detrac_truth(file: Path, pictures: Path) -> TrackingTruth:
    count, paths = _frame_count(pictures), pictures_in(pictures)
    size = picture_size(paths[0]) if paths else None
    if pictures.is_file():
        with open_video(pictures, max_frames=1) as video:
            size = video.size
    try:
        return read_detrac_truth(file, count) if size is None else read_detrac_truth(file, count, size)
    except ValueError as exc:
        message = f"does not fit the {count} pictures in {one_line(pictures)} ({exc}); mend one of them"
        raise fault(file, 0, message) from exc


def _of_labelled(path: Path, sequence: LabelledSequence) -> TrueSequence:
    truth = TrackingTruth.of_sequence(sequence, _frame_count(sequence.pictures))
    file = _truth_file(path, sequence)
    return TrueSequence(sequence.name, file, truth, sequence.classes, sequence.layout, sequence.pictures, sequence.fps)


def _truth_file(path: Path, sequence: LabelledSequence) -> Path:
    """The file that ``open_sequences`` has read this sequence from."""
    if path.is_file():
        return path
    if sequence.layout == "kitti":
        files = [file for file in kitti_files(path) if file.stem == sequence.name]
    elif sequence.layout == "ua-detrac":
        every = _xml_files(path)
        files = [file for file in every if file.stem == sequence.name]
        files = files or [file for file in every if read_annotation(file).name == sequence.name]
    else:
        folders = [folder for folder in (path, *_below(path)) if is_motchallenge(folder)]
        files = [folder / "gt" / "gt.txt" for folder in folders if folder.resolve().name == sequence.name]
    assert files  # or there would be no sequence
    return files[0]


def thin(sequence: TrueSequence, every: int) -> TrueSequence:
    """The same sequence with every so many-th frame only, from the first."""
    thinned = sequence.truth.in_frames(sequence.truth.frames % every == 0)
    if not thinned.is_counted.any():
        raise ConfigError(f"{one_line(sequence.file)}: no object that counts in every {every}th frame; take more")
    return replace(sequence, truth=thinned)
