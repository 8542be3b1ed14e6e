"""What `lookonce tune` searches on, and what it holds out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lookonce.cli.compare_scenes import DetectionSource, gather
from lookonce.cli.evaluated_truth import TrueSequence, open_truth
from lookonce.cli.stages import StageScreen
from lookonce.datasets import usual_name
from lookonce.errors import ConfigError
from lookonce.evaluation import TrackingTruth
from lookonce.tuning.scenes import TuningScene
from lookonce.video.opening import one_line

__all__ = ["TuningData", "find_scenes", "hold_out", "open_all"]

_MAX_BYTES = 4_000_000_000  # of detections in memory


@dataclass(frozen=True, slots=True)
class TuningData:
    """Scenes in two parts.

    Attributes:
        searched: what the search sees.
        held_out: what it does not.
        in_words: which these are, for the screen.
    """

    searched: tuple[TuningScene, ...]
    held_out: tuple[TuningScene, ...]
    in_words: str


def open_all(data: Sequence[Path], frames: Path | None, benchmark: str) -> list[TrueSequence]:
    """The truth of all folders.

    Raises:
        LookonceError: there is none, it is wrong, or two sequences have one name.
    """
    if frames is not None and len(data) != 1:
        raise ConfigError(f"--frames belongs to one DATA, but there are {len(data)}")
    found: dict[str, TrueSequence] = {}
    for path in data:
        for sequence in open_truth(path, frames=frames, benchmark=benchmark):
            twin = found.setdefault(sequence.name, sequence)
            if twin is not sequence:
                both = f"{one_line(twin.file)} and {one_line(sequence.file)}"
                raise ConfigError(f"two sequences are called {one_line(sequence.name)}: {both}; rename one")
    return list(found.values())


def find_scenes(
    truth: Sequence[TrueSequence],
    source: DetectionSource,
    classes: Sequence[str],
    screen: StageScreen,
) -> list[TuningScene]:
    """The sequences with their detections, found once and kept in the source's folder.

    Args:
        truth: the sequences.
        source: of the detections.
        classes: whose objects count.
        screen: where progress goes.

    Raises:
        LookonceError: pictures are missing or wrong, or there are more detections than memory should hold.
    """
    scenes, size = [], 0
    for sequence in truth:
        (scene,) = gather([sequence], source, screen)
        found = scene.stored.sequence
        if source.labels:
            found = found.rows(np.isin(found.labels, source.labels))
        size += len(found) * (64 + (0 if found.descriptors is None else found.descriptors[0:1].nbytes))
        if size > _MAX_BYTES:
            raise ConfigError(
                f"{one_line(sequence.name)}: with it more than {_MAX_BYTES // 10**9} GB of detections; tune on fewer"
            )
        scenes.append(TuningScene(sequence.name, _of_classes(sequence, classes, screen), found))
    return scenes


def _of_classes(sequence: TrueSequence, classes: Sequence[str], screen: StageScreen) -> TrackingTruth:
    """The truth in which only objects of these classes count; all do where it has none of them."""
    wanted = {usual_name(name) for name in classes}
    labels = [label for label, name in enumerate(sequence.classes) if usual_name(name) in wanted]
    if not labels:
        if wanted:
            screen.say(f"{one_line(sequence.name)}: truth has no such classes; all its objects count")
        return sequence.truth
    return replace(sequence.truth, is_counted=sequence.truth.is_counted & np.isin(sequence.truth.labels, labels))


def hold_out(scenes: Sequence[TuningScene], names: Sequence[str]) -> TuningData:
    """The named scenes are held out; without names the second half of each.

    Raises:
        ConfigError: there is no such scene, none is left, or a scene is too short to be cut.
    """
    if not names:
        halves = [scene.cut(2) for scene in scenes]
        for scene, parts in zip(scenes, halves, strict=True):
            if len(parts) < 2 or not all(part.has_objects for part in parts):
                remedy = "take a longer sequence, or name others with --holdout"
                raise ConfigError(f"{one_line(scene.name)}: a half of it has no object that counts; {remedy}")
        first, second = zip(*halves, strict=True)
        of = one_line(scenes[0].name) if len(scenes) == 1 else f"each of {len(scenes)} sequences"
        return TuningData(
            tuple(first), tuple(second), f"searched on the first half of {of}; the second half is held out"
        )
    known = {scene.name for scene in scenes}
    for name in names:
        if name not in known:
            raise ConfigError(f"--holdout {name!r}: no such sequence; expected some of {', '.join(sorted(known))}")
    searched = tuple(scene for scene in scenes if scene.name not in names)
    if not searched:
        raise ConfigError("--holdout: nothing is left to search on; hold out fewer sequences")
    held = tuple(scene for scene in scenes if scene.name in names)
    shown = ", ".join(one_line(scene.name) for scene in held)
    return TuningData(
        searched, held, f"searched on {len(searched)} sequence{'s' * (len(searched) > 1)}; {shown} held out"
    )
