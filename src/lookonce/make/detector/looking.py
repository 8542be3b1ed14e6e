"""A look at the validation pictures: average precision of the very model file that would be kept."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lookonce.boxes import clip
from lookonce.evaluation.detection.precision import DetectionScores, average_precision
from lookonce.evaluation.detection.truth import DetectionTruth
from lookonce.make.darknet.importer import write_detector
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.detector.samples import Sample
from lookonce.make.training.pictures import open_picture
from lookonce.model import Model
from lookonce.structures import Detections

__all__ = ["look", "measure"]

_LEAST_SCORE = 0.005  # precision counts as 0 beyond the last detection's recall
_MOST_DETECTIONS = 300


def look(
    network: DarknetNetwork, samples: Sequence[Sample], classes: tuple[str, ...], *, threads: int
) -> DetectionScores:
    """COCO's figures of a network on some pictures."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "look.onnx"
        write_detector(network, classes, path, descriptors=False, license="unknown", source={})
        return measure(path, samples, classes, threads=threads)


def measure(path: Path, samples: Sequence[Sample], classes: tuple[str, ...], *, threads: int) -> DetectionScores:
    """COCO's figures of a model file on some pictures; detections in ignored regions do not count."""
    model = Model(path, threads=threads, score_threshold=_LEAST_SCORE, max_detections=_MOST_DETECTIONS)
    truths, detections = [], []
    for sample in samples:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"PIL\.")
            picture, factor = open_picture(sample.picture, model.size)
        found = model.detect(np.asarray(picture))
        truths.append(_truth(sample, factor.astype(np.float32), (picture.height, picture.width)))
        detections.append(Detections(found.xyxy, found.scores, found.labels))
    return average_precision(truths, detections, classes)


def _truth(
    sample: Sample, factor: np.ndarray[tuple[int], np.dtype[np.float32]], size: tuple[int, int]
) -> DetectionTruth:
    """A sample as the evaluation has it: an ignored region is a crowd of every labelled class."""
    known = np.flatnonzero(sample.labelled)
    ignored = clip(sample.ignored * factor, size)
    ignored = ignored[(ignored[:, 2:] > ignored[:, :2]).all(axis=1)]
    xyxy = clip(sample.xyxy * factor, size)
    kept = (xyxy[:, 2:] > xyxy[:, :2]).all(axis=1) & np.isin(sample.labels, known)
    regions = np.repeat(ignored, len(known), axis=0)
    return DetectionTruth(
        np.concatenate([xyxy[kept], regions]).astype(np.float32),
        np.concatenate([sample.labels[kept], np.tile(known, len(ignored))]).astype(np.int64),
        np.arange(kept.sum() + len(regions)) >= kept.sum(),
        frozenset(known.tolist()),
    )
