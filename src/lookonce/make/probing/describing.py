"""From labelled sequences to described objects: what a model file says of every box whose identity is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets import LabelledSequence
from lookonce.errors import VideoError
from lookonce.evaluation import DescribedObjects
from lookonce.letterbox import Fit, Letterboxer
from lookonce.make.descriptors.anchors import labels_of_names
from lookonce.make.probing.reading import BoxReader, SeenBoxes, TruthReader
from lookonce.video import Frame, VideoSource, open_video, prefetch
from lookonce.video.opening import one_line

__all__ = ["OnFrame", "Reading", "Tally", "describe_sequences", "read_sequences"]


OnFrame = Callable[[str, int, int], None]
"""Called after each frame: what is read, how many frames are done, of how many."""

_FRAMES_AHEAD = 4


@dataclass(frozen=True, slots=True)
class Tally:
    """What became of one sequence.

    Attributes:
        name: of the sequence.
        frames: how many frames with truth were read.
        lost_frames: how many could not be read.
        rate: frames per second; None where not known.
        truth_boxes: in the frames that were read.
        found_boxes: of them, those that the detector found; all of them where truth boxes are described.
        described_boxes: of the found ones, those that have a descriptor.
    """

    name: str
    frames: int
    lost_frames: int
    rate: float | None
    truth_boxes: int
    found_boxes: int
    described_boxes: int


@dataclass(frozen=True, slots=True)
class Reading:
    """Described objects and where they came from.

    Attributes:
        objects: N rows in order of sequence and frame; ``sequences`` counts from 0 in the order given.
        xyxy: (N, 4) float32, the described boxes in px of the picture.
        tallies: one for each sequence, in the order given.
    """

    objects: DescribedObjects
    xyxy: NDArray[np.float32]
    tallies: tuple[Tally, ...]


def describe_sequences(
    model: Path | BoxReader,
    sequences: Sequence[LabelledSequence],
    *,
    every: int = 1,
    fps: float | None = None,
    on_frame: OnFrame | None = None,
) -> DescribedObjects:
    """Every labelled box of some sequences with the descriptor that a model file gives it.

    Args:
        model: a model file, whose descriptors are then read at the truth boxes; or what ``open_reader`` opened.
        sequences: labelled; row k of the result's ``sequences`` is number k in this order.
        every: only frames whose index is a multiple of this.
        fps: frames per second of picture folders; None = as stated for each, else 25.
        on_frame: told of the progress.

    Returns:
        N rows in order of sequence, frame and truth; sizes in px of the pictures, times in seconds of each sequence's
        own clock. Boxes without a descriptor and frames that cannot be read are left out.

    Raises:
        ModelError: the model file is damaged or has no descriptors.
        VideoError: pictures cannot be read, change their size, or end before the truth does.
        ConfigError: a setting cannot work.
    """
    reader = TruthReader.open(model) if isinstance(model, Path) else model
    return read_sequences(reader, sequences, every=every, fps=fps, on_frame=on_frame).objects


def read_sequences(
    reader: BoxReader,
    sequences: Sequence[LabelledSequence],
    *,
    every: int = 1,
    fps: float | None = None,
    on_frame: OnFrame | None = None,
) -> Reading:
    """The same as ``describe_sequences``, with the boxes and an account of what was read."""
    rows = _Rows()
    tallies = tuple(
        _read_sequence_(reader, number, sequence, rows, every=every, fps=fps, on_frame=on_frame)
        for number, sequence in enumerate(sequences)
    )
    return rows.reading(tallies)


class _Prepared(NamedTuple):
    frame: Frame
    canvas: NDArray[np.uint8]
    placed: Fit


def _read_sequence_(
    reader: BoxReader,
    number: int,
    sequence: LabelledSequence,
    rows: _Rows,
    *,
    every: int,
    fps: float | None,
    on_frame: OnFrame | None,
) -> Tally:
    """Read one sequence, adding to ``rows``."""
    truth = {frame.index: frame.objects for frame in sequence.frames if frame.index % every == 0 and len(frame.objects)}
    labels = labels_of_names(reader.metadata, sequence.classes)
    done = truth_boxes = found_boxes = described_boxes = 0
    with open_video(sequence.pictures, every=every, fps=sequence.fps if fps is None else fps) as video:
        letterboxed = _letterboxed(sequence, video, truth.keys(), reader.metadata.size)
        with prefetch(letterboxed, depth=_FRAMES_AHEAD) as prepared:
            for frame, canvas, placed in prepared:
                objects = truth[frame.index]
                seen = reader(canvas, placed, objects.xyxy, labels[objects.labels])
                kept = np.flatnonzero(_has_length(seen.descriptors))
                rows.add(number, frame, objects.identities[seen.rows[kept]], seen[kept])
                done, truth_boxes = done + 1, truth_boxes + len(objects)
                found_boxes, described_boxes = found_boxes + len(seen.rows), described_boxes + len(kept)
                if on_frame is not None:
                    on_frame(sequence.name, done, len(truth))
        rate = video.rate
    return Tally(sequence.name, done, len(truth) - done, rate, truth_boxes, found_boxes, described_boxes)


def _has_length(descriptors: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,) bool: False for rows of zeros, which say that there is no descriptor, and for NaN."""
    has_length: NDArray[np.bool_] = np.einsum("nd,nd->n", descriptors, descriptors) > 0.5
    return has_length


def _letterboxed(
    sequence: LabelledSequence, video: VideoSource, wanted: Set[int], size: tuple[int, int]
) -> Iterator[_Prepared]:
    """The wanted frames as the network takes them; runs in the reading thread."""
    letterbox = Letterboxer(size)
    last_wanted, last_read = max(wanted, default=-1), -1
    for frame in video:
        last_read = frame.index
        if frame.index in wanted:
            if frame.size != video.size:
                raise VideoError(_two_sizes(sequence, frame, video.size))
            yield _Prepared(frame, *letterbox(frame.picture, frame.rotation))
        if frame.index >= last_wanted:
            return
    # A folder's pictures are held against the truth when it is opened: what is missing there cannot be read.
    if last_read < last_wanted and not sequence.pictures.is_dir():
        raise VideoError(_too_short(sequence, sorted(index for index in wanted if index > last_read), last_read))


def _two_sizes(sequence: LabelledSequence, frame: Frame, size: tuple[int, int] | None) -> str:
    (height, width), first = frame.size, size or (0, 0)
    return (
        f"{one_line(sequence.pictures)}: frame {frame.index} has {width} x {height} px, the first one "
        f"{first[1]} x {first[0]}; truth boxes fit one size only, so make all frames the same"
    )


def _too_short(sequence: LabelledSequence, beyond: list[int], last_read: int) -> str:
    more = f" and {len(beyond) - 1:,} more" if len(beyond) > 1 else ""
    return (
        f"{one_line(sequence.pictures)}: its last frame is {last_read}, but {one_line(sequence.name)} has truth for "
        f"frame {beyond[0]}{more} (counted from 0); is it the right video?"
    )


class _Rows:
    """The columns of the objects, frame by frame."""

    def __init__(self) -> None:
        self._seen: list[SeenBoxes] = []
        self._identities: list[NDArray[np.int64]] = []
        self._places: list[tuple[int, int, float]] = []  # sequence, frame, time in seconds

    def add(self, sequence: int, frame: Frame, identities: NDArray[np.int64], seen: SeenBoxes) -> None:
        self._seen.append(seen)
        self._identities.append(identities)
        self._places.append((sequence, frame.index, frame.time_s))

    def reading(self, tallies: tuple[Tally, ...]) -> Reading:
        """All rows; empties itself, so that descriptors are not held twice for longer than it takes."""
        if not self._seen:
            zero, none = np.zeros(0, np.float32), np.zeros(0, np.int64)
            objects = DescribedObjects(zero.reshape(0, 1), none, none, none, np.zeros(0), zero, zero)
            return Reading(objects, np.zeros((0, 4), np.float32), tallies)
        counts = [len(seen.rows) for seen in self._seen]
        xyxy = np.concatenate([seen.xyxy for seen in self._seen])
        grids = np.concatenate([seen.grids for seen in self._seen])
        descriptors = np.concatenate([seen.descriptors for seen in self._seen])
        self._seen.clear()
        sequences, frames, times_s = (np.repeat(column, counts) for column in zip(*self._places, strict=True))
        objects = DescribedObjects(
            descriptors,
            np.concatenate(self._identities),
            sequences.astype(np.int64),
            frames.astype(np.int64),
            times_s.astype(np.float64),
            xyxy[:, 3] - xyxy[:, 1],
            xyxy[:, 2] - xyxy[:, 0],
            grids,
        )
        return Reading(objects, xyxy, tallies)
