"""What is compared on: sequences with truth, and the detections that every tracker gets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from lookonce.cli.evaluated_truth import TrueSequence
from lookonce.cli.stages import StageScreen
from lookonce.cli.track_run import SHIPPED_MODEL
from lookonce.compare.cameras import camera_motions
from lookonce.compare.contenders.registry import PLAIN_SCORE
from lookonce.compare.crops import CropDescriber, describe_crops
from lookonce.compare.describing import BoxReader, describe_sequence, described_file
from lookonce.compare.detecting import detect_sequence, detections_file, fingerprint_of
from lookonce.compare.detection_files import find_detection_file, given_file, read_detection_file
from lookonce.compare.detection_store import StoredDetections, read_detections, write_detections
from lookonce.compare.detections import DetectedSequence
from lookonce.datasets import usual_name
from lookonce.errors import ConfigError, VideoError
from lookonce.model import Model
from lookonce.pipeline import CAMERA_SIZE
from lookonce.video import open_video
from lookonce.video.opening import one_line

__all__ = [
    "DetectionSource",
    "DetectionsOption",
    "ModelOption",
    "Scene",
    "check_given",
    "gather",
    "labels_of",
    "look_at_pictures",
]

ModelOption = Annotated[
    str | None,
    typer.Option(
        "-m",
        "--model",
        help="Model file or name, for the detections; with --detections for descriptors at their boxes.",
        show_default=f"{SHIPPED_MODEL}; --detections: none",
    ),
]
DetectionsOption = Annotated[
    Path | None, typer.Option(help="Detections of others: a file, or a folder with one a sequence.", show_default=False)
]


@dataclass(frozen=True, slots=True)
class DetectionSource:
    """Where detections come from: a model, or files that others have made, which a model may describe.

    Attributes:
        model: finds them; None = they are in files.
        files: a file, or a folder with one for each sequence; None = from the model.
        crops: a second network for descriptors; None = there is none.
        labels: of the model's classes that are kept; empty = all.
        fps: of folders of pictures and of files; None = as the sequence says.
        cache: the folder where detections are kept.
        crops_from: boxes below this score are not described by the second network.
        describer: of the boxes in files; None = they have no descriptors.
        every: frame rates at which it is to be seen how the camera moves; none where no tracker asks.
        camera_score: boxes from here on are not looked into for that.
    """

    model: Model | None
    files: Path | None
    crops: CropDescriber | None
    labels: tuple[int, ...]
    fps: float | None
    cache: Path
    crops_from: float = PLAIN_SCORE
    describer: BoxReader | None = None
    every: tuple[int, ...] = ()
    camera_score: float = 0.0

    @property
    def camera_size(self) -> tuple[int, int]:
        """(height, width) of the pictures in which the camera's motion is looked for: as ``lookonce track``."""
        network = self.model or self.describer
        return CAMERA_SIZE if network is None else network.size


@dataclass(frozen=True, slots=True)
class Scene:
    """A sequence with truth and detections.

    Attributes:
        true: the truth.
        path: of the detections.
        stored: the same.
        crops_path: of the detections with descriptors of the second network; None = there is none.
        crops: the same.
    """

    true: TrueSequence
    path: Path
    stored: StoredDetections
    crops_path: Path | None = None
    crops: StoredDetections | None = None


def check_given(detections: Path) -> None:
    """Refuse a file or folder of detections that is not there, before any work.

    Raises:
        ConfigError: it is not.
    """
    if not detections.exists():
        raise ConfigError(f"{one_line(detections)}: no such file or folder; check --detections")


def labels_of(model: Model, classes: Sequence[str]) -> tuple[int, ...]:
    """The labels of the classes, by their usual names; none = all.

    Raises:
        ConfigError: the model finds none of them.
    """
    wanted = {usual_name(name) for name in classes}
    labels = tuple(label for label, name in enumerate(model.names) if usual_name(name) in wanted)
    if wanted and not labels:
        known = ", ".join(model.names[:12])
        raise ConfigError(f"{one_line(model.path)}: finds none of the classes {', '.join(classes)}; it has {known}")
    return labels


def gather(truth: Sequence[TrueSequence], source: DetectionSource, screen: StageScreen) -> list[Scene]:
    """The detections of all sequences, found or read.

    Raises:
        LookonceError: pictures or files are missing or wrong.
    """
    scenes = []
    for sequence in truth:
        if source.files:
            scene = _from_file(sequence, source, source.files, screen)
        else:
            scene = _from_model(sequence, source, screen)
        scenes.append(_follow_camera(scene, source, screen))
    return scenes


def _follow_camera(scene: Scene, source: DetectionSource, screen: StageScreen) -> Scene:
    """The scene with how its camera moves, of which what was not known yet is found and kept."""
    stored, sequence = scene.stored, scene.stored.sequence
    known = dict(sequence.cameras) if stored.camera_score == source.camera_score else {}
    missing = [step for step in source.every if step not in known] if sequence.size is not None else []
    if not missing:
        return _at_rates(scene, source.every)
    pictures, fps = _pictures(scene.true, source)
    boxes = sequence.rows(sequence.scores >= source.camera_score)
    for step in missing:

        def report(done: int, total: int | None, step: int = step) -> None:
            screen.stage(f"camera {scene.true.name}, every {step}", done, total, "frames")

        known[step] = camera_motions(pictures, fps, step, boxes, source.camera_size, report)
    stored = replace(stored, sequence=replace(sequence, cameras=known), camera_score=source.camera_score)
    write_detections(scene.path, stored)
    return _at_rates(replace(scene, stored=stored), source.every)


def _at_rates(scene: Scene, every: Sequence[int]) -> Scene:
    """The scene without what is known of the camera at other frame rates, so that nothing depends on what is kept."""
    sequence = scene.stored.sequence
    cameras = {step: maps for step, maps in sequence.cameras.items() if step in every}
    return replace(scene, stored=replace(scene.stored, sequence=replace(sequence, cameras=cameras)))


def _from_file(sequence: TrueSequence, source: DetectionSource, files: Path, screen: StageScreen) -> Scene:
    """Detections of a text file, kept in the form that trackers' processes read; described where a model can."""
    text = find_detection_file(files, sequence.name)
    count = int(sequence.truth.frames[-1]) + 1 if len(sequence.truth.frames) else None
    found = read_detection_file(text, count, source.fps or sequence.fps)
    if source.describer is not None:
        return _described(sequence, source, source.describer, found, screen)
    size, fingerprint = look_at_pictures(sequence.pictures)
    found = replace(found, size=size)
    path = given_file(source.cache, sequence.name, fingerprint, found)
    if not path.exists():
        write_detections(path, StoredDetections(found))
    return Scene(sequence, path, read_detections(path))


def look_at_pictures(pictures: Path) -> tuple[tuple[int, int] | None, str]:
    """(height, width) of the first picture and the fingerprint of all; None and "" where they cannot be read.

    With detections of a file nothing needs them.
    """
    if not os.path.exists(pictures):
        return None, ""
    try:
        with open_video(pictures) as video:
            return video.size, fingerprint_of(pictures)
    except VideoError:
        return None, ""


def _described(
    sequence: TrueSequence, source: DetectionSource, reader: BoxReader, found: DetectedSequence, screen: StageScreen
) -> Scene:
    pictures, fps = _pictures(sequence, source)
    path = described_file(source.cache, sequence.name, pictures, found, reader)

    def report(done: int, total: int | None) -> None:
        screen.stage(f"describe {sequence.name}", done, total, "frames")

    return Scene(sequence, path, describe_sequence(path, found, pictures, reader, fps, report))


def _pictures(sequence: TrueSequence, source: DetectionSource) -> tuple[Path, float | None]:
    """The pictures, and their frame rate where they have no clock of their own, as a video has."""
    pictures = sequence.pictures
    if not os.path.exists(pictures):
        raise ConfigError(f"{one_line(pictures)}: no pictures to look at; put them there, or name --frames")
    return pictures, None if pictures.is_file() else source.fps or sequence.fps


def _from_model(sequence: TrueSequence, source: DetectionSource, screen: StageScreen) -> Scene:
    assert source.model is not None
    pictures, fps = _pictures(sequence, source)
    path = detections_file(source.cache, sequence.name, pictures, source.model, fps)

    def report(stage: str, done: int, total: int | None) -> None:
        screen.stage(f"{stage} {sequence.name}", done, total, "frames")

    stored = detect_sequence(path, pictures, source.model, fps, lambda done, total: report("detect", done, total))
    if source.crops is None:
        return Scene(sequence, path, stored)
    key = f"{source.crops.sha256[:12]}-{source.crops_from:g}"
    crops_path = path.with_name(f"{path.stem}-crops-{key}.npz")
    crops = describe_crops(
        crops_path,
        stored,
        pictures,
        source.crops,
        fps,
        source.crops_from,
        lambda done, total: report("describe", done, total),
    )
    return Scene(sequence, path, stored, crops_path, crops)
