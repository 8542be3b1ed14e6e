"""Which anchors answer for which objects."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from lookonce.make.detector.grids import AnchorGrids, decode
from lookonce.make.detector.overlaps import row_iou, shape_iou

__all__ = ["assign"]

_LEAST_SHAPE_IOU = 0.2  # below, an anchor does not answer for an object of that shape; YOLOv4's iou_thresh is 0.213
_MOST_ANSWERS = 10  # anchors for one object, as in SimOTA
_IOU_COST = 3.0  # SimOTA's weight of the box against the class
_MARGIN_CELLS = 0.1  # a logistic function cannot quite reach the end of its range


def assign(
    outputs: Tensor, grids: AnchorGrids, xyxy: Tensor, labels: Tensor, image: Tensor, *, several: bool
) -> tuple[Tensor, Tensor]:
    """Anchors that answer for objects, each for one.

    With ``several``, of the anchors that can reach an object and are of a similar shape those with the lowest loss at
    present: as many as the sum of their ten best overlaps says, at least one (SimOTA, Ge et al. 2021). Otherwise the
    one of the most similar shape in the cell of the object's centre, as YOLOv3 has it.

    Args:
        outputs: raw, (B x A, 5 + C), without gradient.
        grids: the A anchors.
        xyxy: (T, 4) px, the objects.
        labels: (T,) their classes.
        image: (T,) the picture of each.
        several: see above.

    Returns:
        (P,) numbers of anchors in the batch, and (P,) rows of the objects they answer for.
    """
    row, anchor = _candidates(grids, xyxy, several=several)
    place = image[row] * len(grids) + anchor
    cost = torch.zeros(len(place), device=outputs.device)
    if several and len(place):
        cost, overlap = _costs(outputs[place], grids.facts[anchor], xyxy[row], labels[row])
        chosen = _lowest(row, cost, overlap, len(xyxy))
        row, place, cost = row[chosen], place[chosen], cost[chosen]
    kept = _one_object_each(place, cost, len(outputs))
    return place[kept], row[kept]


def _candidates(grids: AnchorGrids, xyxy: Tensor, *, several: bool) -> tuple[Tensor, Tensor]:
    """Pairs of an object (its row) and an anchor (its number within a picture) that could answer for it."""
    centre, extent = (xyxy[:, :2] + xyxy[:, 2:]) / 2, (xyxy[:, 2:] - xyxy[:, :2]).clamp(min=1e-3)
    similarity = shape_iou(extent, torch.cat([grid.shapes for grid in grids.grids]))
    if several:
        wanted = similarity >= similarity.amax(1, keepdim=True).clamp(max=_LEAST_SHAPE_IOU)
    else:
        wanted = functional.one_hot(similarity.argmax(1), similarity.shape[1]).bool()
    rows, anchors, shape = [], [], 0
    for grid in grids.grids:
        row, number = wanted[:, shape : shape + len(grid.shapes)].nonzero(as_tuple=True)
        shape += len(grid.shapes)
        position = centre[row] / grid.stride_px
        reach = (grid.scale_x_y - 1) / 2 - _MARGIN_CELLS if several else 0.0
        steps = (-1, 0, 1) if reach > 0 else (0,)
        limit = torch.tensor([grid.columns, grid.rows], device=xyxy.device)
        for step in ((x, y) for y in steps for x in steps):
            cell = (position.floor() + torch.tensor(step, device=xyxy.device)).long()
            within = position - cell
            fits = (cell >= 0) & (cell < limit) & (within >= -max(reach, 0)) & (within <= 1 + max(reach, 0))
            ok = fits.all(1)
            column, line = cell[ok].unbind(1)
            anchors.append(grid.first + (number[ok] * grid.rows + line) * grid.columns + column)
            rows.append(row[ok])
    return torch.cat(rows), torch.cat(anchors)


def _costs(outputs: Tensor, facts: Tensor, xyxy: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
    """Loss that each candidate would have, and its overlap, (N,) each."""
    overlap = row_iou(decode(outputs, facts), xyxy)
    probability = (torch.sigmoid(outputs[:, 5:]) * torch.sigmoid(outputs[:, 4:5])).sqrt()
    probability = probability.nan_to_num(0.5)  # of a network that diverged: its loss will tell; this here would crash
    target = functional.one_hot(labels, probability.shape[1]).float()
    classes = functional.binary_cross_entropy(probability, target, reduction="none").sum(1)
    return classes - _IOU_COST * (overlap + 1e-8).log(), overlap


def _lowest(row: Tensor, cost: Tensor, overlap: Tensor, objects: int) -> Tensor:
    """Numbers of the candidates with the lowest cost of each object, as many as its overlaps sum up to."""
    order = torch.sort(overlap, descending=True, stable=True).indices
    order = order[torch.sort(row[order], stable=True).indices]
    top = _rank(row[order]) < _MOST_ANSWERS
    total = torch.zeros(objects, device=row.device).index_add(0, row[order][top], overlap[order][top])
    wanted = total.floor().clamp(min=1)
    order = torch.sort(cost, stable=True).indices
    order = order[torch.sort(row[order], stable=True).indices]
    return order[_rank(row[order]) < wanted[row[order]]]


def _rank(groups: Tensor) -> Tensor:
    """Of sorted group numbers (N,) the place of each within its group."""
    number = torch.arange(len(groups), device=groups.device)
    starts = torch.ones(len(groups), dtype=torch.bool, device=groups.device)
    starts[1:] = groups[1:] != groups[:-1]
    return number - torch.where(starts, number, torch.zeros_like(number)).cummax(0).values


def _one_object_each(place: Tensor, cost: Tensor, places: int) -> Tensor:
    """Of candidates for one place the one with the lowest cost, of equals the first: mask (N,)."""
    lowest = torch.full((places,), math.inf, device=place.device).scatter_reduce(0, place, cost, "amin")
    is_lowest = cost <= lowest[place]
    number = torch.arange(len(place), device=place.device)
    first = torch.full((places,), len(place), device=place.device)
    first = first.scatter_reduce(0, place[is_lowest], number[is_lowest], "amin")
    return first[place] == number
