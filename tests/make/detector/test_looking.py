"""A look measures the very model file, and counts nothing against it of which truth does not tell."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from PIL import Image

from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.darknet.weights import read_weights
from lookonce.make.detector.looking import look, measure
from make.detector.rectangles import make_sample
from squares import CELL, ROWS, picture, write_darknet

CLASSES = ("red", "other")


def boxes_at(index: int) -> tuple[list[list[int]], list[int]]:
    """The squares of a frame, and their classes as the hand-made detector has them."""
    found = []
    for name, row in ROWS.items():
        column = (index if name != "green" else -index) % 8
        found.append([column * CELL, row * CELL, (column + 1) * CELL, (row + 1) * CELL])
    return found, [0, 1, 1]


@pytest.fixture
def samples(tmp_path):
    made = []
    for index in range(4):
        Image.fromarray(picture(index)).save(tmp_path / f"{index}.png")
        made.append(make_sample(tmp_path / f"{index}.png", *boxes_at(index)))
    return made


def test_a_perfect_detector_has_a_perfect_score(square_model, samples):
    scores = measure(square_model, samples, CLASSES, threads=1)
    assert (scores.mean.ap50, scores.mean.boxes) == (pytest.approx(1), 12)


def test_a_network_is_measured_as_the_model_file_that_it_would_be(square_model, samples, tmp_path):
    cfg, weights, _ = write_darknet(tmp_path)
    network = DarknetNetwork(read_cfg(cfg)).eval()
    network.load_weights_(read_weights(weights, network.config)[0])
    before = {name: value.clone() for name, value in network.state_dict().items()}
    scores = look(network, samples, CLASSES, threads=1)
    assert scores.mean == measure(square_model, samples, CLASSES, threads=1).mean
    assert all(torch.equal(value, before[name]) for name, value in network.state_dict().items())


def without_first(sample, **changes):
    """The red square is there, but not labelled."""
    return make_sample(sample.picture, sample.xyxy[1:], sample.labels[1:], **changes)


def test_detections_of_what_is_not_labelled_are_wrong_unless_truth_is_silent(square_model, samples):
    class_known = [*(without_first(s) for s in samples[1:]), samples[0]]  # of equal scores the last one is right
    known = measure(square_model, class_known, CLASSES, threads=1).classes[0]
    assert (known.ap50, known.boxes) == (pytest.approx(1 / 4), 1)
    silent = [samples[0], *(without_first(s, labelled=[False, True]) for s in samples[1:])]
    scores = measure(square_model, silent, CLASSES, threads=1)
    assert [one.ap50 for one in scores.classes] == pytest.approx([1, 1])
    assert [one.boxes for one in scores.classes] == [1, 8]


def test_detections_in_ignored_regions_do_not_count(square_model, samples):
    ignored = [samples[0], *(without_first(s, ignored=[s.xyxy[0]]) for s in samples[1:])]
    scores = measure(square_model, ignored, CLASSES, threads=1)
    assert [one.ap50 for one in scores.classes] == pytest.approx([1, 1])
    assert [one.boxes for one in scores.classes] == [1, 8]


def test_objects_of_unlabelled_classes_and_regions_outside_are_left_out(square_model, samples):
    odd = [
        make_sample(s.picture, s.xyxy, s.labels, labelled=[True, False], ignored=[[70, 70, 90, 90], [3, 3, 3, 9]])
        for s in samples
    ]
    scores = measure(square_model, odd, CLASSES, threads=1)
    assert scores.classes[0].ap50 == pytest.approx(1)
    assert math.isnan(scores.classes[1].ap50)
    assert scores.mean.boxes == 4


def test_large_pictures_are_measured_at_the_networks_size(square_model, tmp_path):
    made = []
    for index in range(2):
        large = np.kron(picture(index), np.ones((5, 5, 1), np.uint8))
        Image.fromarray(large).save(tmp_path / f"{index}.png")
        boxes, labels = boxes_at(index)
        made.append(make_sample(tmp_path / f"{index}.png", np.array(boxes) * 5, labels))
    assert measure(square_model, made, CLASSES, threads=1).mean.ap50 == pytest.approx(1)
