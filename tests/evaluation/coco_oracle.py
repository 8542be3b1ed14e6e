"""Random pictures with boxes, and what COCO's own program says about them."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from lookonce import Detections
from lookonce.evaluation import DetectionTruth


def boxes(*xyxy: Sequence[float]) -> NDArray[np.float32]:
    return np.array(xyxy, np.float32).reshape(-1, 4)


def make_truth(xyxy: object, labels: object, **fields: object) -> DetectionTruth:
    return DetectionTruth(np.asarray(xyxy, np.float32).reshape(-1, 4), np.asarray(labels, np.int64), **fields)


def make_found(xyxy: object, scores: object, labels: object) -> Detections:
    return Detections(
        np.asarray(xyxy, np.float32).reshape(-1, 4), np.asarray(scores, np.float32), np.asarray(labels, np.int64)
    )


def random_pictures(seed: int) -> tuple[list[DetectionTruth], list[Detections], int]:
    """Up to 6 pictures of up to 4 classes; some without boxes, some with hundreds, crowds, ties, whole-numbered boxes.

    The detections are true boxes with noise of many strengths, doubled ones, ones of another class, and others.
    """
    rng = np.random.default_rng(seed)
    classes, is_whole, has_ties = int(rng.integers(1, 5)), rng.random() < 0.3, rng.random() < 0.4
    most = 250 if rng.random() < 0.1 else 25  # detections
    truths, detections = [], []
    for _ in range(rng.integers(1, 7)):
        count = int(rng.integers(0, 12)) * int(rng.random() < 0.8)
        true = _random_boxes(rng, count, is_whole)
        labels = rng.integers(0, classes, count)
        truths.append(make_truth(true, labels, is_crowd=rng.random(count) < 0.15))
        chosen = rng.integers(0, count, rng.integers(0, most)) if count else np.zeros(0, np.int64)
        noise = rng.normal(size=(len(chosen), 4)) * rng.choice([0, 0.5, 2, 8], (len(chosen), 1))
        near = true[chosen] + (np.rint(noise) if is_whole else noise)
        near = np.concatenate([np.minimum(near[:, :2], near[:, 2:] - 1), near[:, 2:]], axis=1)
        far = _random_boxes(rng, int(rng.integers(0, most)) * int(rng.random() < 0.7), is_whole)
        other = rng.integers(0, classes, len(near) + len(far))
        own = np.concatenate([labels[chosen], other[len(near) :]])
        scores = rng.random(len(own))
        scores = np.rint(scores * 8) / 8 if has_ties else scores
        rows = rng.permutation(len(own))
        given = np.where(rng.random(len(own)) < 0.1, other, own)
        detections.append(make_found(np.concatenate([near, far])[rows], scores, given[rows]))
    return truths, detections, classes


def _random_boxes(rng: np.random.Generator, count: int, is_whole: bool) -> NDArray[np.float64]:
    corner = rng.uniform(0, 400, (count, 2))
    side = np.exp(rng.uniform(np.log(3), np.log(300), (count, 2)))
    xyxy = np.concatenate([corner, corner + side], axis=1)
    return np.rint(xyxy) if is_whole else xyxy


def coco_evaluation(truths: Sequence[DetectionTruth], detections: Sequence[Detections], classes: int) -> COCOeval:
    """COCO's program after its last step; pictures and boxes are numbered from 1, categories from 0."""
    with contextlib.redirect_stdout(io.StringIO()):
        evaluation = COCOeval(
            _coco([_rows(t.xyxy, t.labels, iscrowd=t.is_crowd) for t in truths], classes),
            _coco([_rows(d.xyxy, d.labels, score=d.scores) for d in detections], classes),
            "bbox",
        )
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return evaluation


def _rows(
    xyxy: NDArray[np.float32], labels: NDArray[np.int64], **column: NDArray[np.float32] | NDArray[np.bool_]
) -> list[dict[str, object]]:
    ((name, values),) = column.items()
    rows = []
    for (left, top, right, bottom), label, value in zip(xyxy.tolist(), labels.tolist(), values.tolist(), strict=True):
        ltwh = [left, top, right - left, bottom - top]
        rows.append({"bbox": ltwh, "area": ltwh[2] * ltwh[3], "category_id": label, "iscrowd": 0, name: value})
    return rows


def _coco(pictures: Sequence[list[dict[str, object]]], classes: int) -> COCO:
    coco = COCO()
    annotations = [row | {"image_id": number} for number, rows in enumerate(pictures, 1) for row in rows]
    coco.dataset = {
        "images": [{"id": number} for number in range(1, len(pictures) + 1)],
        "categories": [{"id": label, "name": str(label)} for label in range(classes)],
        "annotations": [row | {"id": number} for number, row in enumerate(annotations, 1)],
    }
    coco.createIndex()
    return coco
