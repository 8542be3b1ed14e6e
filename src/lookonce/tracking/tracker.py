"""The tracker that users hold: one preset, one stream, ids from 1."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lookonce.errors import ConfigError
from lookonce.structures import Detections, Filled, GivenBack, Tracks, check_array, check_cameras
from lookonce.tracking.default import DefaultRule
from lookonce.tracking.default_config import DefaultConfig, iou_config
from lookonce.tracking.paper import PaperConfig, PaperRule
from lookonce.tracking.rows import (
    CheckedRows,
    SupervisionDetections,
    answer_supervision,
    check_rows,
    rows_of_supervision,
)
from lookonce.tracking.state import load_rule, save_rule

__all__ = ["PRESETS", "Tracker", "TrackerConfig"]

TrackerConfig = DefaultConfig | PaperConfig
PRESETS: dict[str, Callable[[], TrackerConfig]] = {"default": DefaultConfig, "iou": iou_config, "paper": PaperConfig}
"""What makes the settings of each preset."""

_LATEST_S = 1e20  # beyond, a state could not be kept


class Tracker:
    """Gives each detection the identity of its object, frame by frame, online.

    A tracker belongs to one stream. Ids start at 1 and come from the instance: two trackers never meet.

    Args:
        preset: ``"default"`` (motion and appearance, through gaps), ``"iou"`` (the same without appearance) or
            ``"paper"`` (appearance against the frame before); or settings such as :class:`DefaultConfig`.
        explain: whether :class:`Tracks` carry the story of each frame; it costs time.

    Attributes:
        config: the settings.
        dropped_rows: how many rows so far were bad (not finite, or of zero or negative size) and got no id.
        given_back: rows of earlier frames whose object the last update confirmed.
        filled: boxes of earlier frames, of objects that were missed there and that the last update saw again.

    Raises:
        ConfigError: there is no such preset, or it cannot explain.

    >>> import numpy as np
    >>> tracker = Tracker("paper")
    >>> boxes = np.array([[10, 10, 50, 80, 0.9, 0], [200, 10, 240, 80, 0.8, 0]], np.float32)
    >>> looks = np.eye(2, 128)
    >>> tracker.update(boxes, descriptors=looks)[:, 6]
    array([1., 2.])
    >>> tracker.update(boxes[::-1], descriptors=looks[::-1])[:, 6]
    array([2., 1.])
    """

    def __init__(self, preset: str | TrackerConfig = "default", *, explain: bool = False) -> None:
        if isinstance(preset, str):
            if preset not in PRESETS:
                raise ConfigError(f"tracker '{preset}': expected one of {', '.join(PRESETS)}")
            preset = PRESETS[preset]()
        if not isinstance(preset, DefaultConfig | PaperConfig):
            got = type(preset).__name__
            raise ConfigError(f"tracker: expected a preset's name, or settings such as DefaultConfig, got {got}")
        if explain and isinstance(preset, PaperConfig):
            raise ConfigError("tracker 'paper' does not explain: it only takes the nearest; use default or iou")
        self.config = preset
        self.dropped_rows = 0
        self.given_back, self.filled = GivenBack.nothing(), Filled.nothing()
        self._rule: DefaultRule | PaperRule = (
            PaperRule(preset) if isinstance(preset, PaperConfig) else DefaultRule(preset, explain)
        )

    @overload
    def update(
        self,
        detections: Detections,
        time_s: float | None = None,
        *,
        camera: NDArray[np.float64] | None = None,
        size: tuple[int, int] | None = None,
        frame: int | None = None,
    ) -> Tracks: ...
    @overload
    def update(
        self,
        detections: NDArray[Any],
        time_s: float | None = None,
        *,
        descriptors: ArrayLike | None = None,
        camera: NDArray[np.float64] | None = None,
        size: tuple[int, int] | None = None,
        frame: int | None = None,
    ) -> NDArray[np.float64]: ...
    @overload
    def update(
        self,
        detections: SupervisionDetections,
        time_s: float | None = None,
        *,
        camera: NDArray[np.float64] | None = None,
        size: tuple[int, int] | None = None,
        frame: int | None = None,
    ) -> SupervisionDetections: ...

    def update(
        self,
        detections: Detections | NDArray[Any] | SupervisionDetections,
        time_s: float | None = None,
        *,
        descriptors: ArrayLike | None = None,
        camera: NDArray[np.float64] | None = None,
        size: tuple[int, int] | None = None,
        frame: int | None = None,
    ) -> Tracks | NDArray[np.float64] | SupervisionDetections:
        """Identities for one frame's detections: one row for each row, in the same order.

        Args:
            detections: :class:`Detections`; or an array (N, 6) ``x1 y1 x2 y2 score label``; or
                ``supervision.Detections`` with descriptors in ``.data["descriptor"]``.
            time_s: when the frame was taken, in seconds on any clock that goes forward. Without it frames count as
                evenly spaced. A time that stands still or goes back counts as a millisecond later; after a gap longer
                than the preset's memory all objects are new. The preset ``paper`` goes by frames and does not use it.
            descriptors: (N, D) numbers, for the array form only; scaled to unit length.
            camera: (2, 3) float64 affine map from the picture before to this one, px; None: the camera stood still.
            size: (height, width) of the picture, px: who goes over its border has left. None: after ten objects the
                border is taken to be where boxes have been.
            frame: what ``given_back`` and ``filled`` call this frame later, a number above those before; by default
                that of the update, from 0.

        Returns:
            In kind: :class:`Tracks`; or an array (N, 7) float64 with the id as last column; or a copy of the
            ``supervision.Detections`` with ``tracker_id`` set; in the last two the boxes are as given. An id of -1: no
            identity (yet), or a bad row.

        Raises:
            ValueError: wrong shapes, no descriptors where the preset needs them, descriptors of another length than
                before, a time that is not finite or beyond 1e20 s, a camera's motion that cannot be undone, or a size
                that is none.
            TypeError: the detections are none of the three forms.
        """
        if time_s is not None:
            time_s = float(time_s)  # of NumPy's, too
            if not abs(time_s) <= _LATEST_S:
                raise ValueError(f"time_s: expected finite seconds, at most {_LATEST_S:g} from 0, got {time_s}")
        if camera is not None:
            check_array("camera", camera, (2, 3), np.float64)
            check_cameras("camera", camera[np.newaxis])
        if size is not None and not (len(size) == 2 and min(size) > 0):
            raise ValueError(f"size: expected (height, width) in px, got {size}")
        if isinstance(detections, Detections):
            if descriptors is not None:
                raise ValueError("descriptors: Detections carry their own; give them there")
            return self._identify(detections, time_s, camera, size, frame)
        if isinstance(detections, np.ndarray):
            ids = self._update_rows(check_rows(detections, descriptors), time_s, camera, size, frame)
            return np.column_stack([detections, ids]).astype(np.float64)
        if isinstance(detections, SupervisionDetections):
            rows = check_rows(*rows_of_supervision(detections))
            return answer_supervision(detections, self._update_rows(rows, time_s, camera, size, frame))
        kind = type(detections).__name__
        raise TypeError(f"detections: expected Detections, an (N, 6) array or supervision.Detections, got {kind}")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the whole state to one file; :meth:`load` goes on with it as if nothing had happened.

        Raises:
            OutputError: it cannot be written.
        """
        save_rule(Path(path), self._rule, self.dropped_rows)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, explain: bool = False) -> Self:
        """A tracker as it was when it was saved; the file is checked, and nothing in it is unpickled or run.

        Raises:
            FormatError: the file is something else, of another version, damaged or cut short.
            ConfigError: its preset cannot explain.
        """
        rule, dropped_rows = load_rule(Path(path))
        tracker = cls(rule.config, explain=explain)
        if isinstance(rule, DefaultRule):
            rule.explains = explain
        tracker._rule, tracker.dropped_rows = rule, dropped_rows
        return tracker

    def _update_rows(
        self,
        checked: CheckedRows,
        time_s: float | None,
        camera: NDArray[np.float64] | None,
        size: tuple[int, int] | None,
        frame: int | None,
    ) -> NDArray[np.int64]:
        tracks = self._identify(checked.detections, time_s, camera, size, frame, np.flatnonzero(checked.is_good))
        self.dropped_rows += int(np.count_nonzero(~checked.is_good))
        return checked.spread(tracks.ids)

    def _identify(
        self,
        detections: Detections,
        time_s: float | None,
        camera: NDArray[np.float64] | None,
        size: tuple[int, int] | None,
        frame: int | None,
        numbers: NDArray[np.int64] | None = None,
    ) -> Tracks:
        if isinstance(self._rule, PaperRule):
            return self._rule.update(detections)
        tracks = self._rule.update(detections, time_s, camera, size, numbers, frame)
        self.given_back, self.filled = tracks.given_back, tracks.filled
        return tracks
