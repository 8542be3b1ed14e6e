"""Detections of a model in all frames of a sequence, found once and kept on disk."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

from lookonce.compare.detection_store import StoredDetections, read_detections, write_detections
from lookonce.compare.detections import DetectedFrame, DetectedSequence
from lookonce.errors import VideoError
from lookonce.letterbox import Letterboxer
from lookonce.model import Model
from lookonce.video import open_video
from lookonce.video.images import pictures_in
from lookonce.video.opening import one_line

__all__ = ["detect_sequence", "detections_file", "fingerprint_of"]

_FORMAT = 3  # raised where other detections, or other motion of the camera, come of the same settings


def fingerprint_of(pictures: Path) -> str:
    """Names, sizes and times of the picture files, or of the video, as one number: another one, other pictures.

    Raises:
        VideoError: one of them is not there.
    """
    files = pictures_in(pictures) if pictures.is_dir() else [pictures]
    total = hashlib.sha256()
    for file in files:
        try:
            status = os.stat(file)
        except OSError as exc:
            raise VideoError(f"{one_line(file)}: cannot be read ({exc.strerror}); put it there or remove it") from exc
        total.update(f"{file.name}\0{status.st_size}\0{status.st_mtime_ns}\n".encode("utf-8", "surrogateescape"))
    return total.hexdigest()


def detections_file(folder: Path, name: str, pictures: Path, model: Model, fps: float | None) -> Path:
    """Where the detections of a sequence are kept; the name changes with everything that they depend on."""
    settings = [_FORMAT, fingerprint_of(pictures), model.sha256, model.score_threshold, model.iou_threshold]
    settings += [model.max_detections, model.provider, fps or 0]
    key = hashlib.sha256(json.dumps(settings).encode()).hexdigest()[:16]
    return folder / f"{name}-{key}.npz"


def detect_sequence(
    path: Path, pictures: Path, model: Model, fps: float | None, report: Callable[[int, int | None], None]
) -> StoredDetections:
    """The detections of a model in all frames, from ``path`` where they are kept, else found and kept there.

    Args:
        path: as ``detections_file`` names it.
        pictures: a folder or a video.
        model: finds, and describes where it can.
        fps: of a folder of pictures.
        report: told how many frames are done, of how many.

    Raises:
        LookonceError: the pictures cannot be read, or the file cannot be written.
    """
    if path.exists():
        return read_detections(path)
    frames, seconds = [], 0.0
    letterbox = Letterboxer(model.size)
    with open_video(pictures, fps=fps) as video:
        for frame in video:
            start = time.perf_counter()
            canvas, placed = letterbox(frame.picture, frame.rotation)
            (found,) = model.run(canvas[None], [placed])
            seconds += time.perf_counter() - start
            frames.append(DetectedFrame(frame.index, frame.time_s, found))
            report(len(frames), video.frame_count)
    descriptor = model.metadata.descriptor
    threshold = (descriptor.match_threshold or 0.0) if descriptor else 0.0
    stored = StoredDetections(DetectedSequence.of_frames(frames, threshold, video.size), seconds)
    write_detections(path, stored)
    return stored
