"""Where a run stands, kept beside its results, so that it can go on after whatever ended it."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from lookonce.errors import FormatError, OutputError
from lookonce.output.sink import Sink
from lookonce.structures import Tracks
from lookonce.video.frame import Frame

__all__ = ["CHECKPOINT_FILE", "Checkpoint", "CheckpointSink", "read_checkpoint"]

CHECKPOINT_FILE = "checkpoint.json"
_FORMAT, _VERSION = "lookonce-checkpoint", 1
_EVERY_S = 5.0  # a kill loses so much work at most
_MOST_BYTES = 1 << 16
_LARGEST = 1 << 62


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where a run stands.

    Attributes:
        frame: the number of the last frame in the results, as in the source.
        sizes: name of each result file -> bytes that belong to these frames.
        state: the file with the tracker's state.
    """

    frame: int
    sizes: Mapping[str, int]
    state: Path


class CheckpointSink(Sink):
    """The last sink of a run: every few seconds, and when it is closed early, it keeps where the run stands.

    A state that was kept is replaced only once the next one is whole.

    Args:
        folder: of the results.
        save_state: writes the tracker's state to a file.
        sizes: gives name and size in bytes of each result file.
        state: the file that the run goes on from, where it does.

    Raises:
        OutputError: the folder cannot be written, at the first checkpoint.
    """

    def __init__(
        self,
        folder: Path,
        save_state: Callable[[Path], None],
        sizes: Callable[[], Mapping[str, int]],
        state: Path | None = None,
    ) -> None:
        self.path = folder / CHECKPOINT_FILE
        self._save_state, self._sizes = save_state, sizes
        self._frame: int | None = None
        self._kept: int | None = None
        self._next_s = time.monotonic() + _EVERY_S
        self._state = state

    def write(self, frame: Frame, tracks: Tracks) -> None:
        """Take note of a frame that all other sinks have."""
        self._frame = frame.index
        if time.monotonic() >= self._next_s:
            self._keep()
            self._next_s = time.monotonic() + _EVERY_S

    def _keep(self) -> None:
        state = self.path.with_name(f"tracker-{self._frame}.state")
        self._save_state(state)
        record = {"format": _FORMAT, "format_version": _VERSION, "frame": self._frame}
        draft = self.path.with_name(f"{self.path.name}.{os.getpid()}.part")
        try:
            draft.write_text(json.dumps(record | {"sizes": dict(self._sizes()), "state": state.name}))
            draft.replace(self.path)
        except OSError as exc:
            raise OutputError(f"{self.path}: cannot be written ({exc.strerror}); free some space") from exc
        if self._state != state:
            self._remove_state()
        self._state, self._kept = state, self._frame

    def _remove_state(self) -> None:
        if self._state is not None:
            with contextlib.suppress(OSError):
                self._state.unlink()
            self._state = None

    def finish(self) -> None:
        """The run is complete: nothing is left to go on with."""
        self._frame = None
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
        self._remove_state()

    def close(self) -> None:
        """Keep where the run stands, unless it is complete; a second call does nothing."""
        if self._frame is not None and self._frame != self._kept:
            self._keep()
        self._frame = None


def read_checkpoint(folder: Path) -> Checkpoint | None:
    """Where the run in a folder stands; None: there is nothing to go on with.

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
        if record["format"] != _FORMAT or record["format_version"] != _VERSION:
            raise ValueError("of another version")
        frame, sizes, state = record["frame"], record["sizes"], record["state"]
        whole = [frame, *sizes.values()]
        if not all(isinstance(one, int) and not isinstance(one, bool) and 0 <= one < _LARGEST for one in whole):
            raise ValueError("numbers out of range")
        if (
            not isinstance(state, str)
            or Path(state).name != state
            or not all(Path(name).name == name for name in sizes)
        ):
            raise ValueError("names outside the folder")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as exc:
        raise FormatError(path, 0, f"is no checkpoint ({exc}); start again with --overwrite") from exc
    return Checkpoint(frame, sizes, folder / state)
