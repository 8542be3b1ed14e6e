"""Which anchors answer for which objects: hand-made scenes, and SimOTA written plainly on random ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from lookonce.make.detector.assignment import assign
from lookonce.make.detector.grids import AnchorGrids, encode
from make.detector.rectangles import network_of, one_grid, tensor, two_grids

CPU = torch.device("cpu")
CLASSES = 2


@pytest.fixture(scope="module")
def one(tmp_path_factory) -> AnchorGrids:
    """4 x 4 cells of 16 px with anchors of 16 x 16, 30 x 20 and 20 x 40 px."""
    return AnchorGrids(network_of(tmp_path_factory.mktemp("one"), one_grid()), CPU)


@pytest.fixture(scope="module")
def two(tmp_path_factory) -> AnchorGrids:
    """Strides 16 and 8 on 64 x 96."""
    return AnchorGrids(network_of(tmp_path_factory.mktemp("two"), two_grids()), CPU)


@pytest.fixture(scope="module")
def loose(tmp_path_factory) -> AnchorGrids:
    """As ``two``, where centres may leave their cell by half a cell."""
    return AnchorGrids(network_of(tmp_path_factory.mktemp("loose"), two_grids(scale_x_y=2.0)), CPU)


def run(grids, xyxy, labels=None, image=None, *, outputs=None, pictures=1, several=True) -> list[tuple[int, int]]:
    """(anchor in the batch, object) of what is assigned, by anchor."""
    count = len(xyxy)
    outputs = torch.zeros(pictures * len(grids), 5 + CLASSES) if outputs is None else outputs
    place, row = assign(
        outputs,
        grids,
        tensor(xyxy).reshape(-1, 4),
        tensor([0] * count if labels is None else labels, torch.int64),
        tensor([0] * count if image is None else image, torch.int64),
        several=several,
    )
    assert place.dtype == row.dtype == torch.int64
    return sorted(zip(place.tolist(), row.tolist(), strict=True))


def anchor(grids, grid: int, number: int, row: int, column: int) -> int:
    """Its number in a picture."""
    one = grids.grids[grid]
    return one.first + (number * one.rows + row) * one.columns + column


def around(x: float, y: float, width: float, height: float) -> list[float]:
    return [x - width / 2, y - height / 2, x + width / 2, y + height / 2]


@pytest.mark.parametrize(
    ("box", "number", "row", "column"),
    [
        pytest.param(around(24, 40, 15, 17), 0, 2, 1, id="square"),
        pytest.param(around(40, 24, 33, 18), 1, 1, 2, id="wide"),
        pytest.param(around(40, 24, 15, 44), 2, 1, 2, id="high"),
        pytest.param(around(32, 48, 16, 16), 0, 3, 2, id="on the corner of a cell"),
        pytest.param([0, 0, 16, 16], 0, 0, 0, id="in the corner"),
        pytest.param([62, 60, 64, 64], 0, 3, 3, id="small, at the border"),
        pytest.param([0, 0, 64, 64], 2, 2, 2, id="the whole picture"),
    ],
)
def test_best_is_the_anchor_of_the_shape_in_the_cell_of_the_centre(one, box, number, row, column):
    assert run(one, [box], several=False) == [(anchor(one, 0, number, row, column), 0)]


def test_best_looks_at_the_anchors_of_all_grids(two):
    small, large = around(44, 20, 8, 10), around(44, 20, 40, 44)
    found = run(two, [small, large], several=False)
    assert found == [(anchor(two, 0, 1, 1, 2), 1), (anchor(two, 1, 0, 2, 5), 0)]


def test_best_gives_an_anchor_of_two_objects_to_the_first(one):
    twins = [around(24, 24, 16, 16), around(25, 25, 16, 16)]
    assert run(one, twins, several=False) == [(anchor(one, 0, 0, 1, 1), 0)]


@pytest.mark.parametrize("several", [True, False])
def test_no_objects_have_no_anchors(one, several):
    assert run(one, [], several=several) == []


@pytest.mark.parametrize("several", [True, False])
def test_objects_of_a_batch_are_offset_by_their_picture(one, several):
    box = around(24, 24, 16, 16)
    alone = run(one, [box], several=several)
    found = run(one, [box, box, box], image=[2, 0, 2], pictures=4, several=several)
    place = {row: [p for p, r in found if r == row] for row in range(3)}
    assert place[1] == [p for p, _ in alone]
    assert place[0] == [2 * len(one) + p for p, _ in alone]
    assert place[2] == []  # the same as the first: the first has them


def perfect(grids: AnchorGrids, box: list[float], numbers: list[int]) -> Tensor:
    """Outputs that are zero but at some anchors, which have found the box."""
    outputs = torch.zeros(len(grids), 5 + CLASSES)
    position, size = encode(tensor([box]).expand(len(numbers), 4), grids.facts[numbers])
    outputs[numbers, :2] = torch.logit(position, eps=1e-6)
    outputs[numbers, 2:4] = size
    outputs[numbers, 4] = 3
    return outputs


def test_several_are_as_many_as_the_overlaps_say(one):
    """Three anchors of the cell fit by shape; those that have found the object count."""
    box = around(24, 24, 22, 26)
    numbers = [anchor(one, 0, n, 1, 1) for n in range(3)]
    assert run(one, [box], outputs=perfect(one, box, numbers)) == [(n, 0) for n in numbers[:2]] + [(numbers[2], 0)]
    two_good = perfect(one, box, numbers[:2])
    two_good[numbers[2], 2:4] = -5  # 1 and 1 and next to nothing
    assert run(one, [box], outputs=two_good) == [(n, 0) for n in numbers[:2]]
    none_good = torch.zeros(len(one), 7)
    none_good[:, 2:4] = -5
    none_good[numbers[1], 2:4] = -2
    assert run(one, [box], outputs=none_good) == [(numbers[1], 0)]  # at least one, the best


def test_classes_count_in_the_cost(one):
    box = around(24, 24, 16, 16)
    outputs = torch.zeros(len(one), 7)
    first, second = anchor(one, 0, 0, 1, 1), anchor(one, 0, 1, 1, 1)
    for number in (first, second):
        outputs[number] = perfect(one, around(24, 24, 11, 11), [number])[number]  # overlap 0.47: only one is wanted
    outputs[second, 5:] = torch.tensor([-4.0, 4.0])
    outputs[first, 5:] = torch.tensor([4.0, -4.0])
    outputs[anchor(one, 0, 2, 1, 1), 2:4] = -5
    assert run(one, [box], labels=[0], outputs=outputs) == [(first, 0)]
    assert run(one, [box], labels=[1], outputs=outputs) == [(second, 0)]


def test_several_leave_out_shapes_that_do_not_fit(two):
    found = run(two, [around(44, 20, 7, 9)])
    assert {p for p, _ in found} <= {anchor(two, 1, n, 2, 5) for n in range(2)}
    flat = run(two, [around(48, 32, 94, 2)])  # no anchor is like it: the nearest one all the same
    assert len(flat) == 1


def test_an_anchor_of_two_objects_goes_to_the_cheaper_one(one):
    wide, high = around(24, 24, 30, 20), around(25, 25, 20, 40)
    numbers = [anchor(one, 0, n, 1, 1) for n in range(3)]
    outputs = perfect(one, wide, numbers)
    assert [row for _, row in run(one, [wide, high], outputs=outputs)] == [0, 0, 0]
    assert [row for _, row in run(one, [high, wide], outputs=outputs)] == [1, 1, 1]


def test_equal_objects_go_to_the_first(one):
    box = around(24, 24, 20, 24)
    found = run(one, [box, box, box], outputs=perfect(one, box, [anchor(one, 0, n, 1, 1) for n in range(3)]))
    assert found
    assert {row for _, row in found} == {0}


def test_only_cells_that_can_reach_a_centre_answer(loose):
    """With ``scale_x_y`` of 2 a centre may be half a cell outside; the last tenth of a cell is out of reach."""
    facts = loose.facts
    for x, columns in ((40, {4, 5}), (43.9, {5}), (44, {5}), (46, {5, 6}), (36, {4}), (95.9, {11}), (0.1, {0})):
        box = around(x, 20, 8, 10)
        outputs = torch.zeros(len(loose), 7)
        outputs[:, :4] = torch.cat(encode(tensor([box]).expand(len(loose), 4), facts), 1)
        outputs[:, :2] = torch.logit(outputs[:, :2], eps=1e-4)
        outputs[:, 4] = 5
        outputs[: loose.grids[1].first, 2:4] = -5  # the coarse grid has found nothing
        found = [p for p, _ in run(loose, [box], outputs=outputs)]
        fine = [p for p in found if p >= loose.grids[1].first]
        assert {int(facts[p, 0]) for p in fine} == columns, x
        assert {int(facts[p, 1]) for p in fine} == {2}


def plain_simota(outputs: np.ndarray, grids: AnchorGrids, xyxy, labels, image) -> list[tuple[int, int]]:
    """SimOTA (Ge et al. 2021) as this package has it, one object and one anchor at a time."""
    facts, count = grids.facts.numpy().astype(np.float64), len(grids)
    claims: dict[int, list[tuple[float, int]]] = {}
    for number, box in enumerate(xyxy):
        extent, centre = (box[2] - box[0], box[3] - box[1]), ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)

        def shape(fact, extent=extent):
            common = min(extent[0], fact[3]) * min(extent[1], fact[4])
            return common / (extent[0] * extent[1] + fact[3] * fact[4] - common)

        least = min(0.2, max(shape(fact) for fact in facts))
        candidates = []
        for index, fact in enumerate(facts):
            leeway = max((fact[5] - 1) / 2 - 0.1, 0)
            within = [c / fact[2] - cell for c, cell in zip(centre, fact[:2], strict=True)]
            inside = [
                -leeway <= w <= 1 + leeway and (leeway > 0 or math.floor(c / fact[2]) == cell)
                for w, c, cell in zip(within, centre, fact[:2], strict=True)
            ]
            if shape(fact) >= least - 1e-9 and all(inside):
                place = image[number] * count + index
                candidates.append((place, *plain_cost(outputs[place], fact, box, labels[number])))
        wanted = max(1, int(sum(sorted((overlap for _, _, overlap in candidates), reverse=True)[:10])))
        for place, cost, _ in sorted(candidates, key=lambda one: one[1])[:wanted]:
            claims.setdefault(place, []).append((cost, number))
    return sorted((place, min(found)[1]) for place, found in claims.items())


def plain_cost(raw, fact, box, label) -> tuple[float, float]:
    """Cost and overlap of one candidate."""
    raw = raw.astype(np.float64)
    sigmoid = 1 / (1 + np.exp(-raw))
    centre = [(sigmoid[n] * fact[5] - (fact[5] - 1) / 2 + fact[n]) * fact[2] for n in (0, 1)]
    half = [math.exp(raw[2 + n]) * fact[3 + n] / 2 for n in (0, 1)]
    own = (centre[0] - half[0], centre[1] - half[1], centre[0] + half[0], centre[1] + half[1])
    width = max(0, min(own[2], box[2]) - max(own[0], box[0]))
    height = max(0, min(own[3], box[3]) - max(own[1], box[1]))
    areas = 4 * half[0] * half[1] + (box[2] - box[0]) * (box[3] - box[1])
    overlap = width * height / (areas - width * height)
    cost = -3 * math.log(overlap + 1e-8)
    for number, probability in enumerate(np.sqrt(sigmoid[5:] * sigmoid[4])):
        cost -= math.log(probability if number == label else 1 - probability)
    return cost, overlap


@pytest.mark.parametrize("kind", ["one", "two", "loose"])
@pytest.mark.parametrize("seed", range(4))
def test_several_are_those_of_simota_written_plainly(request, kind, seed):
    grids: AnchorGrids = request.getfixturevalue(kind)
    rng = np.random.default_rng(seed)
    width, height = (64, 64) if kind == "one" else (96, 64)
    corner = rng.uniform(0, (width - 6, height - 6), (12, 2))
    xyxy = np.concatenate([corner, np.minimum(corner + rng.uniform(4, 45, (12, 2)), (width, height))], axis=1)
    labels, image = rng.integers(0, CLASSES, 12), rng.integers(0, 3, 12)
    outputs = rng.normal(0, 0.7, (3 * len(grids), 5 + CLASSES)).astype(np.float32)
    found = run(grids, xyxy.tolist(), labels.tolist(), image.tolist(), outputs=torch.from_numpy(outputs))
    assert found == plain_simota(outputs, grids, xyxy, labels, image)
    assert len({place for place, _ in found}) == len(found)
