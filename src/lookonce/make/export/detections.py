"""The detector's last step inside the graph: raw maps -> boxes, scores, labels of the objects that survive NMS.

Only anchors whose objectness passes the threshold are decoded: they are sorted by objectness, and every attribute of
theirs is looked up in the raw maps by its address. A score is objectness x class probability and so never above the
objectness: nothing is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import onnx_ir as ir
from numpy.typing import NDArray

from lookonce.make.export.graph import GraphWriter

__all__ = ["BEFORE_CLASSES", "OutputScale", "SelectedDetections", "write_detections"]

DEFAULT_SCORE_THRESHOLD = 0.25
DEFAULT_IOU_THRESHOLD = 0.45
DEFAULT_MAX_DETECTIONS = 1000
NAME_PREFIX = "detection_"
_BOX = 4
BEFORE_CLASSES = 5  # x, y, width, height, objectness


@dataclass(frozen=True, slots=True)
class OutputScale:
    """One output grid of a YOLO detector.

    Attributes:
        raw: the map (B, anchors x (5 + classes), rows, columns).
        anchors_px: (width, height) of each anchor, in px of the input.
        grid: rows, columns.
        stride_px: input px for one cell.
        scale_x_y: by how much the centre may leave its cell (1: not at all).
        new_coords: YOLOv4's later form: the map is already activated, sizes are squared instead of exponential.
        softmax: YOLOv2's form: the classes share one softmax instead of a logistic function each.
    """

    raw: ir.Value
    anchors_px: tuple[tuple[float, float], ...]
    grid: tuple[int, int]
    stride_px: int
    scale_x_y: float = 1.0
    new_coords: bool = False
    softmax: bool = False


@dataclass(frozen=True, slots=True)
class SelectedDetections:
    """The N detections of a batch, ordered by image, then by falling score.

    In the graph each tensor is named ``detection_`` and its field, so that descriptor heads can be added later.

    Attributes:
        image_index: (N,) int64.
        boxes: (N, 4) float32 xyxy in px of the input.
        scores: (N,) float32.
        labels: (N,) int64.
        scale: (N,) int64, index of the output grid that found it.
        cell: (N,) int64, row x columns + column of its cell in that grid.
        anchor: (N,) int64, which anchor of that cell.
    """

    image_index: ir.Value
    boxes: ir.Value
    scores: ir.Value
    labels: ir.Value
    scale: ir.Value
    cell: ir.Value
    anchor: ir.Value


@dataclass(frozen=True, slots=True)
class _AnchorTables:
    """Facts about all A anchors of all cells of all grids: the graph looks them up instead of computing them."""

    address: NDArray[np.int64]  # (A,) of the first attribute in an image's raw maps laid end to end
    step: NDArray[np.int64]  # (A,) from one attribute to the next
    geometry: NDArray[np.float32]  # (A, 6): column, row, stride, anchor width, anchor height, scale_x_y
    scale: NDArray[np.int64]  # (A,)
    cell: NDArray[np.int64]  # (A,)
    anchor: NDArray[np.int64]  # (A,)


def _tables(scales: Sequence[OutputScale], classes: int) -> _AnchorTables:
    addresses, steps, geometries, indices, cells, anchors = [], [], [], [], [], []
    start = 0
    for index, scale in enumerate(scales):
        rows, columns = scale.grid
        count, cell = len(scale.anchors_px), np.arange(rows * columns)
        first = np.arange(count)[:, None] * (BEFORE_CLASSES + classes) * len(cell) + cell  # (anchors, cells)
        geometry = np.empty((count, len(cell), 6), np.float32)
        geometry[..., 0], geometry[..., 1] = cell % columns, cell // columns
        geometry[..., 2], geometry[..., 5] = scale.stride_px, scale.scale_x_y
        geometry[..., 3:5] = np.array(scale.anchors_px, np.float32)[:, None, :]
        addresses.append(start + first.ravel())
        steps.append(np.full(first.size, len(cell)))
        geometries.append(geometry.reshape(-1, 6))
        indices.append(np.full(first.size, index))
        cells.append(np.tile(cell, count))
        anchors.append(np.repeat(np.arange(count), len(cell)))
        start += count * (BEFORE_CLASSES + classes) * len(cell)
    integers = [np.concatenate(parts).astype(np.int64) for parts in (addresses, steps, indices, cells, anchors)]
    return _AnchorTables(integers[0], integers[1], np.concatenate(geometries), *integers[2:])


def write_detections(g: GraphWriter, scales: Sequence[OutputScale], classes: int) -> SelectedDetections:
    """Append decoding and per-class NMS, with the thresholds as inputs that have defaults."""
    score_threshold = g.input_with_default(
        "score_threshold", np.array(DEFAULT_SCORE_THRESHOLD, np.float32), "scalar: detections above this score are kept"
    )
    iou_threshold = g.input_with_default(
        "iou_threshold",
        np.array(DEFAULT_IOU_THRESHOLD, np.float32),
        "scalar: of two boxes of a class, overlap that drops one",
    )
    max_detections = g.input_with_default(
        "max_detections",
        np.array(DEFAULT_MAX_DETECTIONS, np.int64),
        "scalar: at most so many for an image, the best ones",
    )
    tables = _tables(scales, classes)
    objectness, candidates = _candidates(g, scales, classes, score_threshold)
    attributes = _attributes(g, scales, tables, candidates, classes)  # (B, K, 5 + classes)
    boxes = _decode_boxes(g, scales[0], attributes, g("Gather", g.constant(tables.geometry), candidates))
    scores = _class_scores(g, scales[0], attributes, objectness)  # (B, classes, K)
    selected = g(  # (N, 3): image, class, candidate
        "NonMaxSuppression",
        boxes,
        scores,
        g("Reshape", max_detections, g.constant([1])),
        g("Reshape", iou_threshold, g.constant([1])),
        g("Reshape", score_threshold, g.constant([1])),
    )
    batch = g("Squeeze", g.size(scores, 0))
    selected, kept_scores = _order(g, selected, g("GatherND", scores, selected), batch, max_detections)
    image_and_candidate = g("Gather", selected, g.constant([0, 2]), axis=1)
    anchor = g("GatherND", candidates, image_and_candidate)
    found = SelectedDetections(
        image_index=_column(g, selected, 0),
        boxes=g("GatherND", boxes, image_and_candidate),
        scores=kept_scores,
        labels=_column(g, selected, 1),
        scale=g("Gather", g.constant(tables.scale), anchor),
        cell=g("Gather", g.constant(tables.cell), anchor),
        anchor=g("Gather", g.constant(tables.anchor), anchor),
    )
    for field in fields(found):
        getattr(found, field.name).name = f"{NAME_PREFIX}{field.name}"
    return found


def _candidates(
    g: GraphWriter, scales: Sequence[OutputScale], classes: int, threshold: ir.Value
) -> tuple[ir.Value, ir.Value]:
    """Objectness and anchor number, (B, K) each, best first; K = the most that any image has above the threshold."""
    parts = []
    for scale in scales:
        shape = g.constant([0, len(scale.anchors_px), BEFORE_CLASSES + classes, -1])
        attributes = g("Reshape", scale.raw, shape)
        one = g("Slice", attributes, g.constant([_BOX]), g.constant([_BOX + 1]), g.constant([2]))
        parts.append(g("Flatten", one, axis=1))
    objectness = g("Concat", *parts, axis=1) if len(parts) > 1 else parts[0]
    if not scales[0].new_coords:
        objectness = g("Sigmoid", objectness)
    passed = g.cast(g("Greater", objectness, threshold), ir.DataType.INT64)
    most = g("ReduceMax", g("ReduceSum", passed, g.constant([1]), keepdims=0), keepdims=1)
    count = g("Max", most, g.constant([1]))
    values, indices = g.many("TopK", 2, objectness, count, axis=1)
    return values, indices


def _attributes(
    g: GraphWriter, scales: Sequence[OutputScale], tables: _AnchorTables, candidates: ir.Value, classes: int
) -> ir.Value:
    """Every raw attribute of the candidates, (B, K, 5 + classes)."""
    flat = [g("Flatten", scale.raw, axis=1) for scale in scales]
    maps = g("Concat", *flat, axis=1) if len(flat) > 1 else flat[0]
    address = g("Unsqueeze", g("Gather", g.constant(tables.address), candidates), g.constant([2]))
    step = g("Unsqueeze", g("Gather", g.constant(tables.step), candidates), g.constant([2]))
    number = g.constant(np.arange(BEFORE_CLASSES + classes, dtype=np.int64))
    addresses = g("Add", address, g("Mul", step, number))
    values = g("GatherElements", maps, g("Flatten", addresses, axis=1), axis=1)
    return g("Reshape", values, g("Shape", addresses))


def _slice(g: GraphWriter, value: ir.Value, start: int, end: int) -> ir.Value:
    """``value[:, :, start:end]``."""
    return g("Slice", value, g.constant([start]), g.constant([end]), g.constant([2]))


def _decode_boxes(g: GraphWriter, form: OutputScale, attributes: ir.Value, geometry: ir.Value) -> ir.Value:
    """Boxes (B, K, 4) xyxy in px of the input; YOLOv2's and v3's equations, or v4's ``new_coords``."""
    cell, stride = _slice(g, geometry, 0, 2), _slice(g, geometry, 2, 3)
    anchor, scale_x_y = _slice(g, geometry, 3, 5), _slice(g, geometry, 5, 6)
    position, extent = _slice(g, attributes, 0, 2), _slice(g, attributes, 2, 4)
    if form.new_coords:  # anchor * (2 extent)^2
        extent = g("Mul", g("Mul", extent, extent), g.constant(4.0))
    else:
        position, extent = g("Sigmoid", position), g("Exp", extent)
    leeway = g("Mul", g("Sub", scale_x_y, g.constant(1.0)), g.constant(0.5))
    position = g("Sub", g("Mul", position, scale_x_y), leeway)
    centre = g("Mul", g("Add", position, cell), stride)
    half = g("Mul", g("Mul", extent, anchor), g.constant(0.5))
    return g("Concat", g("Sub", centre, half), g("Add", centre, half), axis=2)


def _class_scores(g: GraphWriter, form: OutputScale, attributes: ir.Value, objectness: ir.Value) -> ir.Value:
    """Objectness x class probability, (B, classes, K)."""
    probability = _slice(g, attributes, BEFORE_CLASSES, np.iinfo(np.int64).max)
    if form.softmax:
        probability = g("Softmax", probability, axis=2)
    elif not form.new_coords:
        probability = g("Sigmoid", probability)
    scores = g("Mul", probability, g("Unsqueeze", objectness, g.constant([2])))
    return g("Transpose", scores, perm=[0, 2, 1])


def _column(g: GraphWriter, rows: ir.Value, column: int) -> ir.Value:
    return g("Gather", rows, g.constant(column), axis=1)


def _order(
    g: GraphWriter, selected: ir.Value, scores: ir.Value, batch: ir.Value, max_detections: ir.Value
) -> tuple[ir.Value, ir.Value]:
    """The rows by image, then falling score (ties: lowest class), and of each image the first ``max_detections``."""
    count = g.size(selected, 0)
    position = g("Range", g.constant(0), g("Squeeze", count), g.constant(1))
    _, by_score = g.many("TopK", 2, scores, count, axis=0)
    images = g("Gather", _column(g, selected, 0), by_score)
    # Not every engine keeps equals in their order: sort by a number that is different for each row.
    _, by_image = g.many("TopK", 2, g("Add", g("Mul", images, count), position), count, axis=0, largest=0)
    order = g("Gather", by_score, by_image)
    images = g("Gather", images, by_image)
    number = g("Unsqueeze", g("Range", g.constant(0), batch, g.constant(1)), g.constant([1]))
    is_of_image = g.cast(g("Equal", g("Unsqueeze", images, g.constant([0])), number), ir.DataType.INT64)  # (B, N)
    counts = g("ReduceSum", is_of_image, g.constant([1]), keepdims=0)
    first = g("Gather", g("CumSum", counts, g.constant(0), exclusive=1), images)
    is_kept = g("Less", g("Sub", position, first), max_detections)
    order = g("Compress", order, is_kept, axis=0)
    return g("Gather", selected, order), g("Gather", scores, order)
