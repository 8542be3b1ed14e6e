"""The truth of UA-DETRAC as its annotation file says it, before anything is cut at the picture's border."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lookonce.datasets.detrac_xml import ROW_LENGTH, read_annotation
from lookonce.datasets.track_rows import first_twins
from lookonce.errors import FormatError
from lookonce.evaluation.tracking.values import TrackingTruth, all_frames

__all__ = ["read_detrac_truth"]

_PICTURE = (540, 960)  # height, width of all of UA-DETRAC


def read_detrac_truth(
    path: Path, frame_count: int | None = None, picture_size: tuple[int, int] = _PICTURE
) -> TrackingTruth:
    """The truth of one annotation file for the protocol ``detrac``.

    Unlike ``open_sequences`` it needs no pictures and cuts no boxes: the protocol rounds left, top, width and height,
    which a cut box has no more. Every target counts, whatever its class, truncation and occlusion.

    Args:
        path: the XML file.
        frame_count: how many frames the video has; None = up to the last one with a target.
        picture_size: (height, width) in px, at which ignored regions end.

    Raises:
        FormatError: it breaks its format.
        ValueError: targets lie beyond ``frame_count``.
    """
    annotation = read_annotation(path)
    values = np.array(annotation.rows, np.float64).reshape(-1, ROW_LENGTH)
    whole = values[:, [0, 1, 2, 8]].astype(np.int64)
    frames, ids, labels, lines = whole[:, 0] - 1, whole[:, 1], whole[:, 2], whole[:, 3]
    if twins := first_twins(frames, ids):
        first, second = twins
        message = f"identity {ids[first]} a second time in frame {frames[first] + 1}; remove one of the two"
        raise FormatError(path, int(lines[second]), message)
    height, width = picture_size
    ignored = np.array(annotation.ignored, np.float64).reshape(-1, 5)[:, :4]
    ignored = np.minimum(ignored, [width, height, width, height])
    every = np.ones(len(ids), np.bool_)
    last = int(frames.max(initial=-1))
    try:
        return TrackingTruth(
            frames=all_frames(last + 1 if frame_count is None else frame_count),
            row_frames=frames,
            ids=ids,
            xyxy=values[:, 3:7].copy(),
            labels=labels,
            is_counted=every,
            is_distractor=~every,
            ignored=ignored[(ignored[:, 2:] > ignored[:, :2]).all(axis=1)],
            left_out=dict(annotation.left_out),
        )
    except ValueError as exc:
        if frame_count is not None and last >= frame_count:
            raise
        raise FormatError(path, 0, f"{exc}; mend the file or get it again") from exc
