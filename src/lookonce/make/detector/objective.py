"""What a detector is trained to do: YOLOv3's objective, and what has since been found to be better.

YOLOv3 (Redmon and Farhadi 2018): of all anchors the one of the most similar shape answers for an object; its raw
outputs are drawn to the object's by squared errors, its objectness to 1, its classes by logistic losses; the objectness
of all others is drawn to 0, except where their box overlaps an object well. All of that can be had
(``positives="best"``, ``box_loss="squared"``, ``objectness="one"``). By default several anchors answer for an object,
boxes learn by the overlap itself (complete IoU), and objectness learns the overlap that was reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from lookonce.make.darknet.layers import DarknetConfig
from lookonce.make.detector.assignment import assign
from lookonce.make.detector.grids import AnchorGrids, decode, encode
from lookonce.make.detector.overlaps import complete_iou, generalized_iou, pair_iou, row_iou
from lookonce.make.detector.settings import DetectorConfig

__all__ = ["Losses", "Objective", "Truth"]

_NOTICED = 0.05  # objectness from which a negative is looked at closely: below, its gradient is next to nothing


@dataclass(frozen=True, slots=True)
class Truth:
    """What is to be found in B pictures.

    Attributes:
        xyxy: (T, 4) px of the input, labels: (T,), image: (T,): objects, and the picture of each.
        ignored: (I, 4), ignored_image: (I,): regions about which nothing is known.
        split: (B, 2), column and row in px where a picture's four quarters meet.
        labelled: (B, 4, C) bool, the classes that each quarter labels.
    """

    xyxy: Tensor
    labels: Tensor
    image: Tensor
    ignored: Tensor
    ignored_image: Tensor
    split: Tensor
    labelled: Tensor


@dataclass(frozen=True, slots=True)
class Losses:
    """The loss, which has a gradient, and its parts, which have none; each weighted, for one positive anchor."""

    total: Tensor
    box: Tensor
    objectness: Tensor
    classes: Tensor


class Objective:
    """The loss of a network's raw maps."""

    def __init__(self, network: DarknetConfig, settings: DetectorConfig, device: torch.device) -> None:
        self._grids = AnchorGrids(network, device)
        self._settings = settings

    def __call__(self, raw: Sequence[Tensor], truth: Truth) -> Losses:
        """The loss of a batch whose raw maps are (B, anchors x (5 + C), h, w)."""
        settings, grids = self._settings, self._grids
        outputs = grids.outputs(raw).flatten(0, 1)  # (B x A, 5 + C)
        seen = outputs.detach()
        several = settings.positives == "several"
        place, row = assign(seen, grids, truth.xyxy, truth.labels, truth.image, several=several)
        chosen, facts, wanted = outputs[place], grids.facts[place % len(grids)], truth.xyxy[row]
        boxes = decode(chosen, facts)
        target = torch.zeros_like(seen[:, 4])
        reached = row_iou(boxes.detach(), wanted) if settings.objectness == "overlap" else torch.ones_like(wanted[:, 0])
        target[place] = reached.clamp(0, 1)
        counts = torch.ones_like(target)
        counts[self._unknown(seen, truth)] = 0
        counts[place] = 1
        share = 1 / max(1, len(place))
        objectness = functional.binary_cross_entropy_with_logits(outputs[:, 4], target, counts, reduction="sum")
        objectness = objectness * settings.objectness_weight * share
        box = self._box_loss(chosen, boxes, wanted, facts) * settings.box_weight * share
        classes = self._class_loss(chosen[:, 5:], truth.labels[row]) * settings.class_weight * share
        return Losses(box + objectness + classes, box.detach(), objectness.detach(), classes.detach())

    def _box_loss(self, chosen: Tensor, boxes: Tensor, wanted: Tensor, facts: Tensor) -> Tensor:
        match self._settings.box_loss:
            case "ciou":
                return (1 - complete_iou(boxes, wanted)).sum()
            case "giou":
                return (1 - generalized_iou(boxes, wanted)).sum()
        position, size = encode(wanted, facts)
        return (torch.sigmoid(chosen[:, :2]) - position).square().sum() + (chosen[:, 2:4] - size).square().sum()

    def _class_loss(self, logits: Tensor, labels: Tensor) -> Tensor:
        smoothing = self._settings.label_smoothing
        target = functional.one_hot(labels, logits.shape[1]).float() * (1 - smoothing) + smoothing / logits.shape[1]
        return functional.binary_cross_entropy_with_logits(logits, target, reduction="sum")

    @torch.no_grad()
    def _unknown(self, outputs: Tensor, truth: Truth) -> Tensor:
        """Anchors that are no negatives (their numbers in the batch).

        Their box overlaps an object well, or lies mostly in an ignored region, or the network sees a class there that
        this part of the picture does not label. Only anchors whose objectness is noticed are looked at.
        """
        grids = self._grids
        noticed = (torch.sigmoid(outputs[:, 4]) > _NOTICED).nonzero().squeeze(1)
        if not len(noticed):
            return noticed
        image, anchor = noticed // len(grids), noticed % len(grids)
        boxes = decode(outputs[noticed], grids.facts[anchor])
        centre = (boxes[:, :2] + boxes[:, 2:]) / 2
        right, below = (centre >= truth.split[image]).long().unbind(1)
        labelled = truth.labelled[image, right + 2 * below]
        unknown = ~labelled.gather(1, outputs[noticed, 5:].argmax(1, keepdim=True)).squeeze(1)
        for picture in sorted(set(image.tolist())):
            rows = (image == picture).nonzero().squeeze(1)
            objects, ignored = truth.xyxy[truth.image == picture], truth.ignored[truth.ignored_image == picture]
            if len(objects):
                unknown[rows] |= pair_iou(boxes[rows], objects).amax(1) > self._settings.ignore_overlap
            if len(ignored):
                unknown[rows] |= _is_inside(boxes[rows], ignored)
        return noticed[unknown]


def _is_inside(boxes: Tensor, regions: Tensor) -> Tensor:
    """Whether half of a box (N, 4) lies in one region (M, 4): (N,)."""
    common = torch.minimum(boxes[:, None, 2:], regions[None, :, 2:]) - torch.maximum(
        boxes[:, None, :2], regions[None, :, :2]
    )
    share = common.clamp(min=0).prod(2) / (boxes[:, 2:] - boxes[:, :2]).prod(1, keepdim=True).clamp(min=1e-6)
    return (share >= 0.5).any(1)
