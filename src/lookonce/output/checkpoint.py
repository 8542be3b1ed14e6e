"""Where a run stands, kept beside its results, so that it can go on after whatever ended it."""

from __future__ import annotations

import contextlib
import json
import os
import re
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from lookonce.errors import FormatError, OutputError
from lookonce.output.sink import Sink
from lookonce.structures import Tracks
from lookonce.video.frame import Frame

__all__ = ["CHECKPOINT_FILE", "Checkpoint", "CheckpointSink", "read_checkpoint"]

CHECKPOINT_FILE = "checkpoint.json"
_FORMAT, _VERSION = "lookonce-checkpoint", 2  # 1: without the camera's state
_STATE_FILE = re.compile(r"checkpoint-\d+\.(tracker|camera)(\.\d+\.part)?")
_EVERY_S = 5.0  # a kill loses so much work at most
_MOST_BYTES = 1 << 16
_LARGEST = 1 << 62


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where a run stands.

    Attributes:
        frame: the number of the last frame in the results, as in the source; -1 = it has begun, and nothing is kept.
        sizes: name of each result file -> bytes that belong to these frames.
        states: what it is of, such as "tracker" -> the file with its state.
    """

    frame: int
    sizes: Mapping[str, int]
    states: Mapping[str, Path]


class CheckpointSink(Sink):
    """The last sink of a run: every few seconds, and when it is closed early, it keeps where the run stands.

    States that were kept are removed only once the next ones are whole. ``begin`` comes before there are any results,
    so that these are never without a checkpoint unless they are complete.

    Args:
        folder: of the results.
        save_states: what it is of, such as "tracker" -> writes its state to a file.
        sizes: gives name and size in bytes of each result file.

    Raises:
        OutputError: the folder cannot be written, at a checkpoint.
    """

    def __init__(
        self,
        folder: Path,
        save_states: Mapping[str, Callable[[Path], None]],
        sizes: Callable[[], Mapping[str, int]],
    ) -> None:
        self.path = folder / CHECKPOINT_FILE
        self._save_states, self._sizes = save_states, sizes
        self._frame: int | None = None
        self._kept: int | None = None
        self._next_s = time.monotonic() + _EVERY_S

    def write(self, frame: Frame, tracks: Tracks) -> None:
        """Take note of a frame that all other sinks have."""
        self._frame = frame.index
        if time.monotonic() >= self._next_s:
            self._keep()
            self._next_s = time.monotonic() + _EVERY_S

    def _keep(self) -> None:
        folder, frame = self.path.parent, self._frame
        states = {name: f"checkpoint-{frame}.{name}" for name in self._save_states}
        for name, save in self._save_states.items():
            save(folder / states[name])
        _write(self.path, {"frame": frame, "sizes": dict(self._sizes()), "states": states})
        _remove_states(folder, states.values())
        self._kept = frame

    @staticmethod
    def begin(folder: Path) -> None:
        """Say that a run has begun in ``folder``, of which nothing is kept yet.

        Raises:
            OutputError: the folder cannot be written.
        """
        _write(folder / CHECKPOINT_FILE, {"frame": -1, "sizes": {}, "states": {}})

    def finish(self) -> None:
        """The run is complete: nothing is left to go on with."""
        self._frame = None
        self.remove(self.path.parent)

    @staticmethod
    def remove(folder: Path) -> None:
        """Remove what an earlier run left to go on with, readable or not."""
        with contextlib.suppress(OSError):
            (folder / CHECKPOINT_FILE).unlink(missing_ok=True)
        _remove_states(folder)

    def close(self) -> None:
        """Keep where the run stands, unless it is complete; a second call does nothing."""
        if self._frame is not None and self._frame != self._kept:
            self._keep()
        self._frame = None


def _write(path: Path, record: Mapping[str, object]) -> None:
    """Replace a checkpoint by another one, at once."""
    draft = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        draft.write_text(json.dumps({"format": _FORMAT, "format_version": _VERSION, **record}))
        draft.replace(path)
    except OSError as exc:
        raise OutputError(f"{path}: cannot be written ({exc.strerror}); free some space") from exc


def _remove_states(folder: Path, but: Collection[str] = ()) -> None:
    """Remove files of states, also those that a kill left half written or without a checkpoint."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if _STATE_FILE.fullmatch(path.name) and path.name not in but:
                path.unlink(missing_ok=True)


def read_checkpoint(folder: Path) -> Checkpoint | None:
    """Where the run in a folder stands; None: there is none, or it is complete.

    Raises:
        FormatError: the file is something else, or damaged.
    """
    path = folder / CHECKPOINT_FILE
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES)
    except FileNotFoundError:
        return None
    except OSError as exc:
        raise FormatError(path, 0, f"cannot be read ({exc.strerror}); start again with --overwrite") from exc
    try:
        record = json.loads(data)
        if record["format"] != _FORMAT:
            raise ValueError("of another kind")
        if record["format_version"] != _VERSION:
            raise ValueError(f"of version {record['format_version']!s:.20}, expected {_VERSION}")
        frame, sizes, states = record["frame"], record["sizes"], record["states"]
        if (frame, sizes, states) == (-1, {}, {}):
            return Checkpoint(frame, sizes, states)
        whole = [frame, *sizes.values()]
        if not all(isinstance(one, int) and not isinstance(one, bool) and 0 <= one < _LARGEST for one in whole):
            raise ValueError("numbers out of range")
        if not all(Path(name).name == name for name in [*sizes, *states.values()]):
            raise ValueError("names outside the folder")
        if "tracker" not in states:
            raise ValueError("without the tracker's state")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as exc:
        raise FormatError(path, 0, f"is no checkpoint ({exc}); start again with --overwrite") from exc
    return Checkpoint(frame, sizes, {name: folder / file for name, file in states.items()})
