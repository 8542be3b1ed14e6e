"""Who hides whom: constructed views."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lookonce.synthetic.fleet import Fleet
from lookonce.synthetic.footprints import corners_of, overlapping, paint_order
from lookonce.synthetic.painting import paint_tile
from lookonce.synthetic.projecting import project
from lookonce.synthetic.rendering import FrameRenderer
from lookonce.synthetic.stage import Stage, Streams, set_stage
from lookonce.synthetic.traffic import Agent
from synthetic.scenes import small_config


@pytest.fixture(scope="module")
def stage() -> Stage:
    """A road on which nothing stands that could hide somebody."""
    whole = set_stage(small_config(place="highway", seed=1, height=180, width=320), Streams.of(1))
    return replace(whole, standing=(), signals=())


def agent_at(number: int, stage: Stage, distance: float, seed: int, kind: str = "sedan", across: float = 0.0) -> Agent:
    """Somebody straight ahead of the camera."""
    camera = stage.camera
    fleet = Fleet(np.random.default_rng(seed), 0.0)
    member = next(one for one in (fleet.draw("car") for _ in range(400)) if one.kind == kind)
    cos, sin = math.cos(camera.yaw_rad), math.sin(camera.yaw_rad)
    agent = Agent(number, member, 0, 0.0, 0.0, 10.0, 1.0)
    agent.x = camera.position[0] + distance * cos - across * sin
    agent.y = camera.position[1] + distance * sin + across * cos
    agent.yaw = camera.yaw_rad
    return agent


def mask_of(renderer: FrameRenderer, stage: Stage, agent: Agent) -> np.ndarray:
    full = np.zeros(stage.camera.size, bool)
    outline = project(renderer._place([agent]), stage.camera, stage.weather.at(0), (0.0, 0.0))[0]
    tile = paint_tile(outline, stage.camera.size)
    assert tile is not None
    left, top, right, bottom = tile.box
    full[top:bottom, left:right] = tile.mask
    return full


@pytest.mark.parametrize("across", [0.0, 0.6, 1.2, 5.0])
def test_visibility_is_the_share_of_pixels_that_the_nearer_one_leaves(stage, across):
    renderer = FrameRenderer(stage, 0.0)
    near, far = agent_at(1, stage, 20.0, 3, "van"), agent_at(2, stage, 26.0, 5, "sedan", across)
    seen = {one.identity: one for one in renderer.paint([near, far], stage.weather.at(0), (0, 0), {}).seen}
    mine, other = mask_of(renderer, stage, far), mask_of(renderer, stage, near)
    expected = 1 - (mine & other).sum() / mine.sum()
    assert seen[1].visibility == 1.0
    assert seen[2].visibility == pytest.approx(expected, abs=1e-9)
    if across < 5:
        assert 0.05 < expected < 0.9
        assert seen[2].hidden_by == 1
        left, top, right, bottom = seen[2].hidden
        rows, columns = np.nonzero(mine & other)
        assert (left, top, right, bottom) == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    else:
        assert seen[2].hidden_by == -1
        assert seen[2].hidden == (0.0, 0.0, 0.0, 0.0)


def test_one_behind_a_bus_stays_in_the_truth_with_visibility_near_zero(stage):
    renderer = FrameRenderer(stage, 0.0)
    near, far = agent_at(1, stage, 22.0, 3, "coach"), agent_at(2, stage, 31.0, 5, "small car")
    seen = {one.identity: one for one in renderer.paint([near, far], stage.weather.at(0), (0, 0), {}).seen}
    assert seen[2].visibility < 0.1
    np.testing.assert_array_equal(seen[2].xyxy, renderer.paint([far], stage.weather.at(0), (0, 0), {}).seen[0].xyxy)


def test_the_order_of_the_agents_does_not_matter(stage):
    renderer = FrameRenderer(stage, 0.0)
    near, far = agent_at(1, stage, 20.0, 3), agent_at(2, stage, 27.5, 5)
    one = renderer.paint([near, far], stage.weather.at(0), (0, 0), {})
    other = renderer.paint([far, near], stage.weather.at(0), (0, 0), {})
    assert one.image.tobytes() == other.image.tobytes()


def test_a_long_vehicle_beside_a_short_one_is_ordered_by_the_line_between_them():
    """Sorted by the distance of their middles, the bus would wrongly hide the car."""
    middles = np.array([(0.0, 12.0), (2.6, 19.0)])
    lengths, widths = np.array([20.0, 4.0]), np.array([2.5, 1.8])
    corners = corners_of(middles, np.full(2, np.pi / 2), lengths, widths)
    boxes = np.array([(0.0, 0, 10, 10), (5, 0, 15, 10)])
    distances = np.hypot(*(middles - (10.0, 0.0)).T)
    assert distances[0] < distances[1]
    assert paint_order(corners, (10.0, 0.0), boxes, distances) == [0, 1]
    assert paint_order(corners, (-10.0, 0.0), boxes, distances) == [1, 0]


def test_overlap_of_rectangles():
    corners = corners_of(
        np.array([(0.0, 0.0), (3.9, 0.0), (0.0, 1.9), (10.0, 10.0)]),
        np.array([0.0, 0.0, 0.3, 0.0]),
        np.full(4, 4.0),
        np.full(4, 1.8),
    )
    first, second = overlapping(corners[[0, 1, 3]])
    assert (first.tolist(), second.tolist()) == ([0], [1])
    first, second = overlapping(corners[[0, 2, 3]])
    assert (first.tolist(), second.tolist()) == ([0], [1])
    assert paint_order(np.zeros((0, 4, 2)), (0.0, 0.0), np.zeros((0, 4)), np.zeros(0)) == []
