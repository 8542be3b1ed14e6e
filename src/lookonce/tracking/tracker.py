"""The tracker that users hold: one preset, one stream, ids from 1."""

from __future__ import annotations

import math
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lookonce.errors import ConfigError
from lookonce.structures import Detections, Tracks
from lookonce.tracking.paper import PaperConfig, PaperRule
from lookonce.tracking.rows import (
    SupervisionDetections,
    answer_supervision,
    check_rows,
    rows_of_supervision,
)

__all__ = ["PRESETS", "Tracker"]

PRESETS = {"paper": PaperConfig}


class Tracker:
    """Gives each detection the identity of its object, frame by frame, online.

    A tracker belongs to one stream. Ids start at 1 and come from the instance: two trackers never meet.

    Args:
        preset: ``"paper"``, or a preset's settings such as :class:`PaperConfig`.

    Attributes:
        config: the settings.
        dropped_rows: how many rows so far were bad (not finite, or of zero or negative size) and got no id.

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

    def __init__(self, preset: str | PaperConfig = "paper") -> None:
        if isinstance(preset, str):
            if preset not in PRESETS:
                raise ConfigError(f"tracker '{preset}': expected one of {', '.join(PRESETS)}")
            preset = PRESETS[preset]()
        self.config = preset
        self.dropped_rows = 0
        self._rule = PaperRule(preset)

    @overload
    def update(self, detections: Detections, time_s: float | None = None) -> Tracks: ...
    @overload
    def update(
        self, detections: NDArray[Any], time_s: float | None = None, *, descriptors: ArrayLike | None = None
    ) -> NDArray[np.float64]: ...
    @overload
    def update(self, detections: SupervisionDetections, time_s: float | None = None) -> SupervisionDetections: ...

    def update(
        self,
        detections: Detections | NDArray[Any] | SupervisionDetections,
        time_s: float | None = None,
        *,
        descriptors: ArrayLike | None = None,
    ) -> Tracks | NDArray[np.float64] | SupervisionDetections:
        """Identities for one frame's detections: one row for each row, in the same order.

        Args:
            detections: :class:`Detections`; or an array (N, 6) ``x1 y1 x2 y2 score label``; or
                ``supervision.Detections`` with descriptors in ``.data["descriptor"]``.
            time_s: when the frame was taken, in seconds. The preset ``paper`` goes by frames and does not use it.
            descriptors: (N, D) numbers, for the array form only; scaled to unit length.

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
            return self._rule.update(detections)
        if isinstance(detections, np.ndarray):
            ids = self._update_rows(detections, descriptors)
            return np.column_stack([detections, ids]).astype(np.float64)
        if isinstance(detections, SupervisionDetections):
            return answer_supervision(detections, self._update_rows(*rows_of_supervision(detections)))
        kind = type(detections).__name__
        raise TypeError(f"detections: expected Detections, an (N, 6) array or supervision.Detections, got {kind}")

    def _update_rows(self, rows: NDArray[Any], descriptors: ArrayLike | None) -> NDArray[np.int64]:
        checked = check_rows(rows, descriptors)
        self.dropped_rows += int(np.count_nonzero(~checked.is_good))
        return checked.spread(self._rule.update(checked.detections).ids)
