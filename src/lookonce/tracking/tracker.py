"""The tracker that users hold: one preset, one stream, ids from 1."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lookonce.errors import ConfigError
from lookonce.structures import Detections, GivenBack, Tracks
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

__all__ = ["PRESETS", "Tracker", "TrackerConfig"]

TrackerConfig = DefaultConfig | PaperConfig
PRESETS: dict[str, Callable[[], TrackerConfig]] = {"default": DefaultConfig, "iou": iou_config, "paper": PaperConfig}
"""What makes the settings of each preset."""


class Tracker:
    """Gives each detection the identity of its object, frame by frame, online.

    A tracker belongs to one stream. Ids start at 1 and come from the instance: two trackers never meet.

    Args:
        preset: ``"default"`` (motion and appearance, through gaps), ``"iou"`` (the same without appearance) or
            ``"paper"`` (appearance against the frame before); or settings such as :class:`DefaultConfig`.

    Attributes:
        config: the settings.
        dropped_rows: how many rows so far were bad (not finite, or of zero or negative size) and got no id.
        given_back: rows of earlier frames whose object the last update confirmed; frames count updates from 0.

    Raises:
        ConfigError: there is no such preset.

    >>> import numpy as np
    >>> tracker = Tracker("paper")
    >>> boxes = np.array([[10, 10, 50, 80, 0.9, 0], [200, 10, 240, 80, 0.8, 0]], np.float32)
    >>> looks = np.eye(2, 128)
    >>> tracker.update(boxes, descriptors=looks)[:, 6]
    array([1., 2.])
    >>> tracker.update(boxes[::-1], descriptors=looks[::-1])[:, 6]
    array([2., 1.])
    """

    def __init__(self, preset: str | TrackerConfig = "default") -> None:
        if isinstance(preset, str):
            if preset not in PRESETS:
                raise ConfigError(f"tracker '{preset}': expected one of {', '.join(PRESETS)}")
            preset = PRESETS[preset]()
        self.config = preset
        self.dropped_rows = 0
        self.given_back = GivenBack.nothing()
        self._rule: DefaultRule | PaperRule = (
            PaperRule(preset) if isinstance(preset, PaperConfig) else DefaultRule(preset)
        )

    @overload
    def update(
        self, detections: Detections, time_s: float | None = None, *, camera: NDArray[np.float64] | None = None
    ) -> Tracks: ...
    @overload
    def update(
        self,
        detections: NDArray[Any],
        time_s: float | None = None,
        *,
        descriptors: ArrayLike | None = None,
        camera: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]: ...
    @overload
    def update(
        self,
        detections: SupervisionDetections,
        time_s: float | None = None,
        *,
        camera: NDArray[np.float64] | None = None,
    ) -> SupervisionDetections: ...

    def update(
        self,
        detections: Detections | NDArray[Any] | SupervisionDetections,
        time_s: float | None = None,
        *,
        descriptors: ArrayLike | None = None,
        camera: NDArray[np.float64] | None = None,
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

        Returns:
            In kind: :class:`Tracks`; or an array (N, 7) float64 with the id as last column; or a copy of the
            ``supervision.Detections`` with ``tracker_id`` set. An id of -1: no identity (yet), or a bad row.

        Raises:
            ValueError: wrong shapes, no descriptors where the preset needs them, descriptors of another length than
                before, or a time that is not finite.
            TypeError: the detections are none of the three forms.
        """
        if time_s is not None and not math.isfinite(time_s):
            raise ValueError(f"time_s: expected finite seconds, got {time_s}")
        if isinstance(detections, Detections):
            if descriptors is not None:
                raise ValueError("descriptors: Detections carry their own; give them there")
            return self._identify(detections, time_s, camera)
        if isinstance(detections, np.ndarray):
            ids = self._update_rows(check_rows(detections, descriptors), time_s, camera)
            return np.column_stack([detections, ids]).astype(np.float64)
        if isinstance(detections, SupervisionDetections):
            rows = check_rows(*rows_of_supervision(detections))
            return answer_supervision(detections, self._update_rows(rows, time_s, camera))
        kind = type(detections).__name__
        raise TypeError(f"detections: expected Detections, an (N, 6) array or supervision.Detections, got {kind}")

    def _update_rows(
        self, checked: CheckedRows, time_s: float | None, camera: NDArray[np.float64] | None
    ) -> NDArray[np.int64]:
        self.dropped_rows += int(np.count_nonzero(~checked.is_good))
        tracks = self._identify(checked.detections, time_s, camera, np.flatnonzero(checked.is_good))
        return checked.spread(tracks.ids)

    def _identify(
        self,
        detections: Detections,
        time_s: float | None,
        camera: NDArray[np.float64] | None,
        numbers: NDArray[np.int64] | None = None,
    ) -> Tracks:
        if isinstance(self._rule, PaperRule):
            return self._rule.update(detections)
        tracks = self._rule.update(detections, time_s, camera, numbers)
        self.given_back = tracks.given_back
        return tracks
