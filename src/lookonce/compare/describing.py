"""Descriptors of a model at the boxes of others, in all frames of a sequence, read once and kept on disk."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lookonce.compare.detecting import fingerprint_of
from lookonce.compare.detection_store import StoredDetections, read_detections, rows_digest, write_detections
from lookonce.compare.detections import DetectedSequence
from lookonce.letterbox import Fit, Letterboxer
from lookonce.model import DescriptorInfo
from lookonce.video import open_video

__all__ = ["BoxReader", "describe_sequence", "described_file"]

_FORMAT = 3  # raised where other descriptors, or other motion of the camera, come of the same settings


class BoxReader(Protocol):
    """Reads descriptors at given boxes."""

    @property
    def size(self) -> tuple[int, int]:
        """The network's input (height, width) in px."""
        ...

    @property
    def path(self) -> Path:
        """The model file."""
        ...

    @property
    def sha256(self) -> str:
        """Digest of the model file."""
        ...

    @property
    def descriptor(self) -> DescriptorInfo:
        """What the descriptors are."""
        ...

    def read(self, canvas: NDArray[np.uint8], placed: Fit, xyxy: NDArray[np.float32], /) -> NDArray[np.float32]:
        """(N, D) descriptors of N boxes of a letterboxed picture; zeros for a box that has none."""
        ...


def described_file(folder: Path, name: str, pictures: Path, sequence: DetectedSequence, reader: BoxReader) -> Path:
    """Where the described detections of a sequence are kept; the name changes with everything that they depend on."""
    key = rows_digest(sequence, [_FORMAT, fingerprint_of(pictures), reader.sha256])
    return folder / f"{name}-described-{key}.npz"


def describe_sequence(
    path: Path,
    sequence: DetectedSequence,
    pictures: Path,
    reader: BoxReader,
    fps: float | None,
    report: Callable[[int, int | None], None],
) -> StoredDetections:
    """The same detections with descriptors, from ``path`` where they are kept, else read and kept there.

    Args:
        path: as ``described_file`` names it.
        sequence: the detections.
        pictures: a folder or a video; frames that it lacks have no descriptors.
        reader: of the descriptors.
        fps: of a folder of pictures.
        report: told how many frames are done, of how many.

    Raises:
        LookonceError: the pictures cannot be read, or the file cannot be written.
    """
    if path.exists():
        return read_detections(path)
    descriptors = np.zeros((len(sequence), reader.descriptor.size), np.float32)
    places = {index: slice(*sequence.starts[n : n + 2].tolist()) for n, index in enumerate(sequence.frames.tolist())}
    letterbox, seconds, done = Letterboxer(reader.size), 0.0, 0
    with open_video(pictures, fps=fps) as video:
        for frame in video:
            rows = places.get(frame.index, slice(0, 0))
            start = time.perf_counter()
            canvas, placed = letterbox(frame.picture, frame.rotation)
            descriptors[rows] = reader.read(canvas, placed, sequence.xyxy[rows])
            seconds, done = seconds + time.perf_counter() - start, done + 1
            report(done, video.frame_count)
    threshold = reader.descriptor.match_threshold or 0.0
    described = replace(sequence, descriptors=descriptors, match_threshold=threshold, size=video.size)
    stored = StoredDetections(described, describe_s=seconds)
    write_detections(path, stored)
    return stored
