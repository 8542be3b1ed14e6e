"""A scene on disk, in the layouts that people train and score on."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.errors import ConfigError, OutputError
from lookonce.synthetic.scene import SyntheticFrame, SyntheticScene
from lookonce.synthetic.write_detrac import DetracWriter
from lookonce.synthetic.write_mot import MotWriter
from lookonce.synthetic.write_yolo import YoloWriter
from lookonce.video import VideoWriter

__all__ = ["WRITE_LAYOUTS", "WriteOptions", "WrittenScene", "write_scene"]

WRITE_LAYOUTS = ("mot", "ua-detrac", "yolo")
_DETRAC_FPS = 25.0


@dataclass(frozen=True, slots=True)
class WriteOptions:
    """How a scene is written.

    Attributes:
        name: of the sequence; "" = from the seed.
        part: "train" or "test"; only UA-DETRAC keeps them apart.
        quality: of the JPEG pictures, 1 to 95.
        every: only every so many-th frame is written, 1 or more; other than 1 for YOLO only.
        min_visibility: objects of which less can be seen get no YOLO label, 0 to 1; the others have a column for it.
        has_video: whether NAME.mp4 is written too; not for YOLO.
        overwrite: whether files of an earlier sequence of that name are replaced.

    Raises:
        ConfigError: a setting is out of its range.
    """

    name: str = ""
    part: str = "train"
    quality: int = 90
    every: int = 1
    min_visibility: float = 0.15
    has_video: bool = False
    overwrite: bool = False

    def __post_init__(self) -> None:
        if self.name and not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}", self.name):
            raise ConfigError(f"name = {self.name!r}: expected letters, digits, and . _ - such as street-1")
        if self.part not in ("train", "test"):
            raise ConfigError(f"part = {self.part!r}: expected train or test")
        if not 1 <= self.quality <= 95:
            raise ConfigError(f"quality = {self.quality}: expected 1 to 95")
        if self.every < 1:
            raise ConfigError(f"every = {self.every}: expected 1 or more")
        if not 0 <= self.min_visibility <= 1:
            raise ConfigError(f"min_visibility = {self.min_visibility}: expected 0 to 1")


@dataclass(frozen=True, slots=True)
class WrittenScene:
    """What was written.

    Attributes:
        name: of the sequence.
        path: its folder or truth file, for ``open_sequences`` or ``open_stills``.
        pictures: how many.
        rows: of truth: objects, each counted in each picture.
        identities: different objects.
        left_out: why -> rows that are not among these.
    """

    name: str
    path: Path
    pictures: int
    rows: int
    identities: int
    left_out: dict[str, int] = field(default_factory=dict)


class SceneWriter(Protocol):
    """Writes one sequence in one layout."""

    path: Path

    def write(self, frame: SyntheticFrame, jpeg: Callable[[Path], None]) -> tuple[NDArray[np.int64], dict[str, int]]:
        """Writes a frame: identities of the rows of truth, and why -> rows left out."""

    def close(self) -> None:
        """Completes the sequence."""


def write_scene(
    scene: SyntheticScene,
    out: Path,
    layout: str,
    progress: Callable[[int, int], None] | None = None,
    options: WriteOptions | None = None,
) -> WrittenScene:
    """Renders a scene and writes it.

    ``mot``: OUT/NAME/img1/000001.jpg, gt/gt.txt, gt/labels.txt, ignore.txt, seqinfo.ini. ``ua-detrac``: the folders as
    distributed, see docs/ua-detrac.md. ``yolo``: OUT/images/NAME-000001.jpg, labels/, classes.txt. Whatever ends it,
    pictures and truth written before are valid; the XML of UA-DETRAC gets its name at the end.

    Args:
        scene: the scene.
        out: folder; made where it is missing.
        layout: one of ``WRITE_LAYOUTS``.
        progress: called with frames done and frames in all.
        options: name, picture quality and the like.

    Raises:
        ConfigError: options and layout do not fit.
        OutputError: files are there already, or cannot be written.
    """
    options = options or WriteOptions()
    _check(scene, layout, options)
    names = {"mot": f"synth-{scene.config.seed:04d}", "ua-detrac": f"MVI_{90_000 + scene.config.seed % 10_000}"}
    name = options.name or names.get(layout, f"synth-{scene.config.seed:04d}")
    try:
        return _write(scene, out, layout, name, progress, options)
    except OSError as exc:
        reason = (exc.strerror or str(exc)).lower()
        raise OutputError(f"{out}: cannot be written ({reason}); check the folder and its space") from exc


def _check(scene: SyntheticScene, layout: str, options: WriteOptions) -> None:
    if layout not in WRITE_LAYOUTS:
        raise ConfigError(f"layout = {layout!r}: expected one of {', '.join(WRITE_LAYOUTS)}")
    if layout != "yolo" and options.every != 1:
        raise ConfigError(f"every = {options.every}: {layout} has every frame; choose another fps, or the layout yolo")
    if layout == "yolo" and options.has_video:
        raise ConfigError("a video goes with sequences, not with stills; choose the layout mot, or leave the video out")
    if layout == "ua-detrac" and scene.fps != _DETRAC_FPS:
        raise ConfigError(f"fps = {scene.fps:g}: UA-DETRAC has 25 frames per second; use 25, or the layout mot")


def _open(scene: SyntheticScene, out: Path, layout: str, name: str, options: WriteOptions) -> SceneWriter:
    if layout == "mot":
        return MotWriter(scene, out, name, overwrite=options.overwrite)
    if layout == "ua-detrac":
        return DetracWriter(scene, out, name, options.part, overwrite=options.overwrite)
    return YoloWriter(scene, out, name, options.min_visibility, overwrite=options.overwrite)


def _write(
    scene: SyntheticScene,
    out: Path,
    layout: str,
    name: str,
    progress: Callable[[int, int], None] | None,
    options: WriteOptions,
) -> WrittenScene:
    writer = _open(scene, out, layout, name, options)
    video = None
    if options.has_video:
        video_path = out / f"{name}.mp4"
        if video_path.exists() and not options.overwrite:
            raise OutputError(f"{video_path} exists; give --overwrite to replace it, or another folder")
        video = VideoWriter(video_path, scene.fps, scene.size)
    left_out: Counter[str] = Counter()
    identities: set[int] = set()
    pictures = rows = 0
    try:
        for frame in scene:
            if frame.index % options.every == 0:
                kept, omitted = writer.write(frame, _saver(frame.image, options.quality))
                left_out.update(frame.truth.left_out)
                left_out.update(omitted)
                identities.update(kept.tolist())
                pictures, rows = pictures + 1, rows + len(kept)
                if video is not None:
                    video.write(frame.image, frame.time_s)
            if progress is not None:
                progress(frame.index + 1, len(scene))
    finally:
        if video is not None:
            video.close()
    writer.close()
    return WrittenScene(name, writer.path, pictures, rows, len(identities), dict(left_out))


def _saver(image: NDArray[np.uint8], quality: int) -> Callable[[Path], None]:
    def save(path: Path) -> None:
        Image.fromarray(image).save(path, "JPEG", quality=quality)

    return save
