"""An outside detector for comparison: YOLOX as an ONNX file of its own project's layout."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from lookonce import Detections
from lookonce.boxes import clip

STRIDES_PX = (8, 16, 32)
PADDING_GREY = 114
IOU_THRESHOLD = 0.45


class Yolox:
    """Picture in, detections out, on one thread.

    The network takes (1, 3, S, S) float32 BGR from 0 to 255, the picture at the top left, and gives (1, cells,
    5 + classes): centre and size relative to the cell, objectness, class scores.

    Args:
        path: the ONNX file.
        names: class names by label.
        score_threshold: rows whose objectness times class score is above it are kept.
    """

    def __init__(self, path: Path, names: tuple[str, ...], score_threshold: float) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        cv2.setNumThreads(1)
        self._session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        self._input = self._session.get_inputs()[0]
        self._side = int(self._input.shape[2])
        self._corners, self._strides = _cells(self._side)
        self._score_threshold = score_threshold
        self.names = names

    def detect(self, image: NDArray[np.uint8]) -> Detections:
        """Detections in a picture (H, W, 3) uint8 RGB, in its px."""
        height, width = image.shape[:2]
        scale = min(self._side / height, self._side / width)
        scaled = cv2.resize(image, (int(width * scale), int(height * scale)), interpolation=cv2.INTER_LINEAR)
        canvas = np.full((self._side, self._side, 3), PADDING_GREY, np.uint8)
        canvas[: scaled.shape[0], : scaled.shape[1]] = scaled
        blob = np.ascontiguousarray(canvas[:, :, ::-1].transpose(2, 0, 1)[np.newaxis], np.float32)
        rows = self._session.run(None, {self._input.name: blob})[0][0]
        centre = (rows[:, :2] + self._corners) * self._strides
        half = np.exp(rows[:, 2:4]) * self._strides / 2
        xyxy = np.concatenate([centre - half, centre + half], axis=1) / scale
        scores = rows[:, 4:5] * rows[:, 5:]
        return self._suppress(clip(xyxy.astype(np.float32), (height, width)), scores)

    def _suppress(self, xyxy: NDArray[np.float32], scores: NDArray[np.float32]) -> Detections:
        """The rows that survive the NMS of their class; a box may have several classes."""
        is_inside = (xyxy[:, 2:] > xyxy[:, :2]).all(axis=1)
        boxes, labels = np.nonzero((scores > self._score_threshold) & is_inside[:, np.newaxis])
        if not len(boxes):
            return Detections.empty()
        ltwh = np.concatenate([xyxy[:, :2], xyxy[:, 2:] - xyxy[:, :2]], axis=1)[boxes].astype(np.float64)
        found = scores[boxes, labels]
        kept = cv2.dnn.NMSBoxesBatched(
            ltwh.tolist(), found.tolist(), labels.tolist(), self._score_threshold, IOU_THRESHOLD
        )
        rows = np.asarray(kept, np.int64)
        return Detections(xyxy[boxes[rows]], found[rows], labels[rows].astype(np.int64))


def _cells(side: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Column and row of each cell (R, 2), and the stride of its grid (R, 1), in the network's order."""
    corners, strides = [], []
    for stride in STRIDES_PX:
        count = side // stride
        rows, columns = np.divmod(np.arange(count * count), count)
        corners.append(np.stack([columns, rows], axis=1))
        strides.append(np.full((count * count, 1), stride))
    return np.concatenate(corners).astype(np.float32), np.concatenate(strides).astype(np.float32)
