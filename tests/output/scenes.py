"""Small tracks and frames for the tests of the sinks."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lookonce.structures import Tracks
from lookonce.video.frame import Frame

NO_BOXES = np.zeros((0, 4), np.float32)


def make_tracks(
    ids: Sequence[int] = (),
    xyxy: Sequence[Sequence[float]] = (),
    scores: Sequence[float] | None = None,
    labels: Sequence[int] | None = None,
    unseen: Sequence[tuple[int, Sequence[float]]] = (),
) -> Tracks:
    return Tracks(
        ids=np.array(ids, np.int64),
        xyxy=np.array(xyxy, np.float32).reshape(-1, 4),
        scores=np.array([0.5] * len(ids) if scores is None else scores, np.float32),
        labels=np.array([0] * len(ids) if labels is None else labels, np.int64),
        unseen_ids=np.array([identity for identity, _ in unseen], np.int64),
        unseen_xyxy=np.array([box for _, box in unseen], np.float32).reshape(-1, 4),
    )


def grey(height: int = 60, width: int = 80) -> NDArray[np.uint8]:
    return np.full((height, width, 3), 100, np.uint8)


def make_frame(index: int = 0, time_s: float = 0.0, height: int = 60, width: int = 80) -> Frame:
    return Frame(index, time_s, grey(height, width))
