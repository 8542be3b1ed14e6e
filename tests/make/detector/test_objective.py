"""The loss: it can be driven down, it says nothing where nothing is known, and it is finite whatever comes in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from lookonce.make.detector.assignment import assign
from lookonce.make.detector.grids import AnchorGrids, decode
from lookonce.make.detector.objective import Objective, Truth
from lookonce.make.detector.overlaps import row_iou
from lookonce.make.detector.settings import DetectorConfig
from make.detector.rectangles import network_of, one_grid, tensor

CPU = torch.device("cpu")
PLAIN = DetectorConfig(label_smoothing=0)
PUBLISHED = replace(PLAIN, positives="best", box_loss="squared", objectness="one")
BOXES = [[6.0, 6, 24, 26], [34, 30, 62, 52]]
FIRST = 0 * 16 + 1 * 4 + 0  # the 16 x 16 anchor in row 1, column 0: the best for the first box


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return network_of(tmp_path_factory.mktemp("net"), one_grid())


def truth(
    boxes=(), labels=None, image=None, *, ignored=(), ignored_image=None, labelled=None, split=None, pictures=1
) -> Truth:
    count = len(boxes)
    return Truth(
        xyxy=tensor(boxes).reshape(-1, 4),
        labels=tensor([0, 1][:count] if labels is None else labels, torch.int64),
        image=tensor([0] * count if image is None else image, torch.int64),
        ignored=tensor(ignored).reshape(-1, 4),
        ignored_image=tensor([0] * len(ignored) if ignored_image is None else ignored_image, torch.int64),
        split=tensor([[64, 64]] * pictures if split is None else split),
        labelled=torch.ones(pictures, 4, 2, dtype=torch.bool) if labelled is None else tensor(labelled, torch.bool),
    )


def maps(outputs: torch.Tensor) -> torch.Tensor:
    """(B, A, 7) by anchor, row, column -> the raw map (B, 21, 4, 4)."""
    return outputs.reshape(len(outputs), 3, 4, 4, 7).permute(0, 1, 4, 2, 3).reshape(len(outputs), 21, 4, 4)


def objectness_gradient(network, config, outputs, known) -> torch.Tensor:
    """(B, A) slope of the loss by each anchor's objectness."""
    outputs = outputs.clone().requires_grad_()
    Objective(network, config, CPU)([maps(outputs)], known).total.backward()
    assert torch.isfinite(outputs.grad).all()
    return outputs.grad[:, :, 4]


@pytest.mark.parametrize("objectness", ["overlap", "one"])
@pytest.mark.parametrize("box_loss", ["ciou", "giou", "squared"])
@pytest.mark.parametrize("positives", ["several", "best"])
def test_descent_finds_the_objects_of_a_picture(network, positives, box_loss, objectness):
    config = replace(PLAIN, positives=positives, box_loss=box_loss, objectness=objectness)
    objective, grids = Objective(network, config, CPU), AnchorGrids(network, CPU)
    generator = torch.Generator().manual_seed(0)
    raw = torch.randn(1, 21, 4, 4, generator=generator).mul_(0.5).requires_grad_()
    optimizer = torch.optim.Adam([raw], lr=0.1)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 250)
    known, first = truth(BOXES), None
    for _ in range(250):
        losses = objective([raw], known)
        first = losses.total.detach() if first is None else first
        optimizer.zero_grad()
        losses.total.backward()
        optimizer.step()
        schedule.step()
    assert float(losses.total.detach()) < 0.05 * float(first)
    outputs = grids.outputs([raw.detach()])[0]
    scores = torch.sigmoid(outputs[:, 4:5]) * torch.sigmoid(outputs[:, 5:])
    found = scores.amax(1) > 0.5
    assert found.sum() >= 2
    boxes, labels = decode(outputs[found], grids.facts[found]), scores[found].argmax(1)
    overlaps = torch.stack([row_iou(boxes, tensor([box]).expand(len(boxes), 4)) for box in BOXES], 1)
    assert (overlaps.amax(1) > 0.9).all()
    assert (overlaps.argmax(1) == labels).all()
    assert set(labels.tolist()) == {0, 1}


def test_parts_sum_up_to_the_total_and_follow_their_weights(network):
    raw, known = [torch.randn(1, 21, 4, 4, generator=torch.Generator().manual_seed(1))], truth(BOXES)
    one = Objective(network, PLAIN, CPU)(raw, known)
    torch.testing.assert_close(one.total, one.box + one.objectness + one.classes)
    for name in ("box", "objectness", "class"):
        weight = getattr(PLAIN, f"{name}_weight")
        other = Objective(network, replace(PLAIN, **{f"{name}_weight": weight * 3}), CPU)(raw, known)
        part = "classes" if name == "class" else name
        torch.testing.assert_close(getattr(other, part), 3 * getattr(one, part))
        torch.testing.assert_close(other.total, one.total + 2 * getattr(one, part))


def test_published_loss_is_that_of_the_paper(network):
    """YOLOv3: squared errors of the raw outputs, logistic losses of objectness and classes."""
    generator = torch.Generator().manual_seed(2)
    outputs = torch.randn(1, 48, 7, generator=generator)
    outputs[..., 4] -= 6  # no negative is noticed
    number = 1 * 16 + 2 * 4 + 3  # the 30 x 20 anchor in row 2, column 3
    losses = Objective(network, PUBLISHED, CPU)([maps(outputs)], truth([[34, 30, 62, 52]], [1]))
    x, y, w, h, objectness, *classes = outputs[0, number].double().numpy()

    def sigmoid(value):
        return 1 / (1 + np.exp(-value))

    box = (sigmoid(x) - 0.0) ** 2 + (sigmoid(y) - 9 / 16) ** 2 + (w - np.log(28 / 30)) ** 2 + (h - np.log(22 / 20)) ** 2
    assert float(losses.box) == pytest.approx(PUBLISHED.box_weight * box, rel=1e-5)
    negatives = np.delete(outputs[0, :, 4].double().numpy(), number)
    logistic = -np.log(sigmoid(objectness)) - np.log(1 - sigmoid(negatives)).sum()
    assert float(losses.objectness) == pytest.approx(logistic, rel=1e-5)
    assert float(losses.classes) == pytest.approx(
        -np.log(1 - sigmoid(classes[0])) - np.log(sigmoid(classes[1])), rel=1e-5
    )


def test_objectness_learns_the_overlap_or_one(network):
    outputs = torch.full((1, 48, 7), -9.0)
    outputs[..., :4] = 0
    outputs[..., 5:] = 0
    known = truth([BOXES[0]], [0])
    overlap = float(row_iou(tensor([[0.0, 16, 16, 32]]), known.xyxy))
    for objectness, target in (("overlap", overlap), ("one", 1.0)):
        config = replace(PUBLISHED, objectness=objectness)
        for value, sign in ((np.log(target / (1 - target + 1e-6)), 0), (-3, -1), (12, 1)):
            outputs[0, FIRST, 4] = float(np.clip(value, -20, 14))
            slope = float(objectness_gradient(network, config, outputs, known)[0, FIRST])
            assert abs(slope) < 1e-4 if sign == 0 or (objectness, sign) == ("one", 1) else slope * sign > 0.1


def noisy(seed: int = 0, pictures: int = 1) -> torch.Tensor:
    """Outputs whose objectness is noticed everywhere."""
    outputs = torch.randn(pictures, 48, 7, generator=torch.Generator().manual_seed(seed)) * 0.3
    outputs[..., 4] = 0.5
    return outputs


def test_without_objects_everything_is_negative(network):
    slope = objectness_gradient(network, PLAIN, noisy(), truth())
    assert (slope > 0).all()


def test_boxes_in_ignored_regions_are_no_negatives(network):
    outputs = noisy()
    boxes = decode(outputs[0], AnchorGrids(network, CPU).facts)
    region = tensor([0.0, 0, 30, 64])
    corner = torch.minimum(boxes[:, 2:], region[2:]) - torch.maximum(boxes[:, :2], region[:2])
    inside = corner.clamp(min=0).prod(1) / (boxes[:, 2:] - boxes[:, :2]).prod(1) >= 0.5
    assert 10 < inside.sum() < 40
    slope = objectness_gradient(network, PLAIN, outputs, truth(ignored=[region.tolist()]))
    assert ((slope[0] == 0) == inside).all()


def test_ignored_regions_belong_to_their_picture(network):
    outputs = noisy(pictures=2)
    known = truth(ignored=[[0, 0, 64, 64], [0, 0, 1, 1]], ignored_image=[1, 0], pictures=2)
    slope = objectness_gradient(network, PLAIN, outputs, known)
    assert (slope[0] > 0).all()
    facts = AnchorGrids(network, CPU).facts
    boxes = decode(outputs[1], facts)
    shown = (boxes.clamp(0, 64)[:, 2:] - boxes.clamp(0, 64)[:, :2]).prod(1)
    is_in = shown / (boxes[:, 2:] - boxes[:, :2]).prod(1) >= 0.5
    assert is_in.sum() > 30
    assert ((slope[1] == 0) == is_in).all()


def test_objects_in_ignored_regions_are_learnt_all_the_same(network):
    slope = objectness_gradient(network, PUBLISHED, noisy(), truth([BOXES[0]], ignored=[[0, 0, 64, 64]]))
    assert slope[0, FIRST] < 0  # the anchor of the object, towards 1


def test_what_looks_like_an_unlabelled_class_is_no_negative(network):
    outputs = noisy()
    boxes = decode(outputs[0], AnchorGrids(network, CPU).facts)
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    split = [[28.0, 40.0]]
    quarter = (centre[:, 0] >= 28).long() + 2 * (centre[:, 1] >= 40).long()
    assert set(quarter.tolist()) == {0, 1, 2, 3}
    labelled = [[[True, True], [True, False], [False, True], [False, False]]]
    seen = outputs[0, :, 5:].argmax(1)
    known = tensor(labelled, torch.bool)[0][quarter, seen]
    assert 0 < known.sum() < 48
    slope = objectness_gradient(network, PLAIN, outputs, truth(labelled=labelled, split=split))
    assert ((slope[0] > 0) == known).all()


def test_boxes_that_overlap_an_object_well_are_no_negatives(network):
    grids = AnchorGrids(network, CPU)
    outputs, box = noisy(), tensor([[10.0, 10, 40, 40]])
    overlap = row_iou(decode(outputs[0], grids.facts), box.expand(48, 4))
    limit = float(overlap.sort().values[-4:-2].mean())
    config = replace(PUBLISHED, ignore_overlap=limit)
    slope = objectness_gradient(network, config, outputs, truth(box.tolist(), [0]))[0]
    positive = int(slope.argmin())
    assert slope[positive] < 0
    others = [n for n in range(48) if n != positive]
    assert ((slope[others] == 0) == (overlap[others] > limit)).all()
    assert (slope[others] == 0).sum() >= 1
    all_count = objectness_gradient(network, replace(config, ignore_overlap=1), outputs, truth(box.tolist(), [0]))[0]
    assert (all_count[others] > 0).all()


def test_unnoticed_anchors_stay_negatives(network):
    """Their slope is next to nothing; whether they overlap an object is not looked at."""
    outputs = noisy()
    outputs[..., 4] = -4
    slope = objectness_gradient(network, PLAIN, outputs, truth(ignored=[[0, 0, 64, 64]]))
    assert (slope > 0).all()
    assert slope.max() < 0.02


def test_smoothed_labels_have_their_minimum_at_the_smoothed_target(network):
    config = replace(PUBLISHED, label_smoothing=0.2)
    outputs = torch.zeros(1, 48, 7)
    outputs[0, FIRST, 5:] = torch.logit(torch.tensor([0.9, 0.1]))
    outputs.requires_grad_()
    Objective(network, config, CPU)([maps(outputs)], truth([BOXES[0]])).total.backward()
    assert outputs.grad[0, FIRST, 5:].abs().max() < 1e-6
    with torch.no_grad():
        outputs[0, FIRST, 5:] = torch.logit(torch.tensor([0.99, 0.01]))
    outputs.grad = None
    Objective(network, config, CPU)([maps(outputs)], truth([BOXES[0]])).total.backward()
    assert outputs.grad[0, FIRST, 5] > 0.05
    assert outputs.grad[0, FIRST, 6] < -0.05


@pytest.mark.parametrize("value", [-1e4, -50.0, 50.0, 1e4])
@pytest.mark.parametrize("box_loss", ["ciou", "giou"])
@pytest.mark.parametrize("positives", ["several", "best"])
def test_extreme_outputs_have_a_finite_loss_and_gradient(network, positives, box_loss, value):
    config = replace(DetectorConfig(), positives=positives, box_loss=box_loss)
    raw = torch.full((1, 21, 4, 4), value, requires_grad=True)
    losses = Objective(network, config, CPU)([raw], truth(BOXES, ignored=[[0, 0, 9, 9]]))
    losses.total.backward()
    assert torch.isfinite(losses.total.detach())
    assert torch.isfinite(raw.grad).all()


@pytest.mark.parametrize("config", [PLAIN, PUBLISHED], ids=["default", "published"])
def test_a_batch_is_the_sum_of_its_pictures(network, config):
    """But for the share: the sum over all pictures is divided by the number of anchors that answer for objects."""
    objective, outputs = Objective(network, config, CPU), noisy(4, pictures=3)
    boxes, image = [BOXES[0], BOXES[1], [20, 20, 50, 60], [3, 3, 12, 12]], [0, 0, 2, 2]
    labels, region = [0, 1, 1, 0], [[30.0, 0, 64, 30], [0, 30, 30, 64]]
    whole = objective([maps(outputs)], truth(boxes, labels, image, ignored=region, ignored_image=[0, 1], pictures=3))
    parts, positives = [], []
    for number in range(3):
        own = [row for row, one in enumerate(image) if one == number]
        known = truth(
            [boxes[row] for row in own],
            [labels[row] for row in own],
            ignored=[r for r, one in zip(region, [0, 1], strict=True) if one == number],
        )
        losses = objective([maps(outputs[number : number + 1])], known)
        with torch.no_grad():
            grids = AnchorGrids(network, CPU)
            several = config.positives == "several"
            place, _ = assign(outputs[number], grids, known.xyxy, known.labels, known.image, several=several)
        parts.append(float(losses.total) * max(1, len(place)))
        positives.append(len(place))
    assert sum(positives) >= 4
    assert float(whole.total) == pytest.approx(sum(parts) / sum(positives), rel=1e-5)


def test_maps_in_bfloat16_are_computed_in_float32(network):
    outputs = noisy()
    known = truth(BOXES)
    losses = Objective(network, PLAIN, CPU)([maps(outputs).bfloat16()], known)
    assert losses.total.dtype == torch.float32
    exact = Objective(network, PLAIN, CPU)([maps(outputs).bfloat16().float()], known)
    assert float(losses.total) == float(exact.total)
