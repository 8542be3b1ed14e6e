"""How the camera moved at one frame rate, as `lookonce track` tells it to the tracker."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.camera import CameraMotion, luma_of_canvas
from lookonce.compare.detections import DetectedSequence
from lookonce.letterbox import Letterboxer
from lookonce.video import open_video

__all__ = ["camera_motions"]

_NO_BOXES = np.zeros((0, 4), np.float32)
_AT_REST = np.eye(2, 3)


def camera_motions(
    pictures: Path,
    fps: float | None,
    every: int,
    detections: DetectedSequence,
    size: tuple[int, int],
    report: Callable[[int, int | None], None],
) -> dict[int, NDArray[np.float64]]:
    """Where pixels of the frame before are now, of the detections' frames in which the camera moved.

    Args:
        pictures: a folder or a video.
        fps: of a folder of pictures.
        every: every so many-th frame is looked at.
        detections: whose boxes are not looked into.
        size: (height, width) of the model's input, in which the pictures are compared.
        report: told how many frames are done, of how many.

    Returns:
        Frame number -> (2, 3) float64, px of the frame.

    Raises:
        VideoError: the pictures cannot be read.
    """
    boxes = {frame.index: frame.detections.xyxy for frame in detections}
    camera, letterbox = CameraMotion(), Letterboxer(size)
    found: dict[int, NDArray[np.float64]] = {}
    with open_video(pictures, every=every, fps=fps) as video:
        for done, frame in enumerate(video, 1):
            canvas, placed = letterbox(frame.picture, frame.rotation)
            luma = luma_of_canvas(canvas, placed)
            motion = camera.update(luma, boxes.get(frame.index, _NO_BOXES), frame.size, frame.time_s)
            if frame.index in boxes and not np.array_equal(motion, _AT_REST):
                found[frame.index] = motion
            report(done, video.frame_count)
    return found
