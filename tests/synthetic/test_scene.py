from __future__ import annotations

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from lookonce.errors import ConfigError
from lookonce.synthetic import PLACES, SceneConfig, SyntheticScene
from lookonce.synthetic.fleet import Fleet
from lookonce.synthetic.painting import paint_tile
from lookonce.synthetic.projecting import project
from lookonce.synthetic.rendering import FrameRenderer
from lookonce.synthetic.scene import Traffic
from lookonce.synthetic.stage import Streams, set_stage
from synthetic.scenes import digest, small_config

HASH = """
from synthetic.scenes import digest, small_config
from lookonce.synthetic import SyntheticScene
print(digest(SyntheticScene(small_config(seed=3, light="change"))))
"""


@pytest.fixture(scope="module")
def scene() -> SyntheticScene:
    return SyntheticScene(small_config(seconds=2.0, seed=2, place="junction", height=180, width=320))


@pytest.mark.parametrize("place", PLACES)
def test_two_iterations_and_two_scenes_give_the_same_bytes(place):
    one, other = SyntheticScene(small_config(place=place, seed=5)), SyntheticScene(small_config(place=place, seed=5))
    assert digest(one) == digest(one) == digest(other)


def test_hash_seed_and_process_do_not_matter():
    found = set()
    for seed in ("0", "1"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(__file__).parents[1])}
        result = subprocess.run(
            [sys.executable, "-c", HASH], capture_output=True, text=True, env=environment, check=True, timeout=120
        )
        found.add(result.stdout)
    assert found == {digest(SyntheticScene(small_config(seed=3, light="change"))) + "\n"}


def test_other_seeds_give_other_scenes():
    assert digest(SyntheticScene(small_config(seed=1))) != digest(SyntheticScene(small_config(seed=2)))


def test_frames_say_what_the_scene_says(scene):
    frames = list(scene)
    assert len(frames) == len(scene) == 20
    assert [frame.index for frame in frames] == list(range(20))
    assert frames[-1].time_s == pytest.approx(1.9)
    height, width = scene.size
    for frame in frames:
        assert frame.image.shape == (height, width, 3)
        assert frame.image.dtype == np.uint8
        xyxy = frame.objects.xyxy
        assert (xyxy[:, :2] >= 0).all()
        assert (xyxy[:, 2:] <= (width, height)).all()
        assert len(frame.truth.kinds) == len(frame.truth.hidden) == len(frame.objects)
    assert sum(len(frame.objects) for frame in frames) > 100


def test_identities_persist(scene):
    """An identity keeps its class and kind, and moves no farther than a fast car does."""
    last: dict[int, tuple[int, str, int]] = {}
    ids_seen: list[set[int]] = []
    for frame in scene:
        rows = zip(frame.objects.identities.tolist(), frame.objects.labels.tolist(), frame.truth.kinds, strict=True)
        for identity, label, kind in rows:
            assert last.get(identity, (label, kind))[:2] == (label, kind)
            last[identity] = (label, kind, frame.index)
        ids_seen.append(set(frame.objects.identities.tolist()))
    for before, after in pairwise(ids_seen):
        assert len(before & after) >= 0.8 * len(before)


def test_boxes_are_the_extents_of_the_painted_pixels(scene):
    """Each body alone, painted as in the picture: its box is the extent of its pixels to within a pixel."""
    stage = scene._stage
    streams = Streams.of(scene.config.seed)
    traffic = Traffic(stage.site, Fleet(streams.fleet, 0.3), streams.traffic, 1.0)
    renderer = FrameRenderer(stage, 0.0)
    light = stage.weather.at(0.0)
    checked = cut = 0
    for agent in traffic.agents:
        outline = project(renderer._place([agent]), stage.camera, light, (0.0, 0.0))[0]
        tile = paint_tile(outline, scene.size)
        if tile is None or not tile.mask.any():
            continue
        rows, columns = np.flatnonzero(tile.mask.any(axis=1)), np.flatnonzero(tile.mask.any(axis=0))
        left, top = tile.left + columns[0], tile.top + rows[0]
        right, bottom = tile.left + columns[-1] + 1, tile.top + rows[-1] + 1
        np.testing.assert_allclose(tile.xyxy, (left, top, right, bottom), atol=1.0)
        (seen,) = renderer.paint([agent], light, (0, 0), {}).seen
        np.testing.assert_array_equal(seen.xyxy, tile.xyxy)
        checked += 1
        cut += tile.truncation > 0
    assert checked > 15
    assert cut > 0


def test_every_object_is_in_the_truth_or_counted(scene):
    stage = scene._stage
    streams = Streams.of(scene.config.seed)
    traffic = Traffic(stage.site, Fleet(streams.fleet, scene.config.look_alikes), streams.traffic, 1.0)
    renderer = FrameRenderer(stage, 0.0)
    seen = renderer.paint(traffic.agents, stage.weather.at(0.0), (0, 0), {}).seen
    first = next(iter(scene))
    assert len(seen) == len(first.objects) + sum(first.truth.left_out.values())


def test_night_is_darker_than_day_and_dusk_lies_between():
    day, night, change = (
        SyntheticScene(small_config(light=light, seconds=1.0, fps=2.0)) for light in ("day", "night", "change")
    )
    bright, dark = (float(next(iter(scene)).image.mean()) for scene in (day, night))
    start, end = (float(frame.image.mean()) for frame in change)
    assert dark < 0.55 * bright
    assert abs(start - bright) < 0.25 * bright
    assert end < start


def test_density_scales_counts():
    counts = []
    for density in (0.0, 0.5, 2.0):
        stage_seed = Streams.of(4)
        site = set_stage(small_config(seed=4, place="highway"), stage_seed).site
        traffic = Traffic(site, Fleet(stage_seed.fleet, 0.3), stage_seed.traffic, density)
        counts.append(len(traffic.agents))
    assert counts[0] == 0
    assert counts[1] > 5
    assert counts[2] > 1.5 * counts[1]


def test_an_empty_road_has_empty_truth():
    frame = next(iter(SyntheticScene(small_config(density=0.0))))
    assert len(frame.objects) == 0
    assert frame.truth.left_out == {}


def test_look_alikes_are_the_same_car():
    bodies = [Fleet(np.random.default_rng(1), 1.0).draw("car").body for _ in range(2)]
    fleet = Fleet(np.random.default_rng(1), 1.0)
    cars = [member for member in (fleet.draw("car") for _ in range(60)) if member.kind == fleet._usual[0]]
    assert len({id(member.body) for member in cars}) == 1
    assert len(bodies) == 2


def test_objects_in_ignored_regions_have_no_truth():
    config = small_config(seed=3, place="highway", height=180, width=320, density=2.0)
    scene = SyntheticScene(config)
    assert len(scene.ignored) == 1
    frame = next(iter(scene))
    assert frame.truth.left_out.get("in an ignored region", 0) > 0
    left, top, right, bottom = scene.ignored[0]
    middles = (frame.objects.xyxy[:, :2] + frame.objects.xyxy[:, 2:]) / 2
    width = np.minimum(frame.objects.xyxy[:, 2], right) - np.maximum(frame.objects.xyxy[:, 0], left)
    height = np.minimum(frame.objects.xyxy[:, 3], bottom) - np.maximum(frame.objects.xyxy[:, 1], top)
    areas = np.prod(frame.objects.xyxy[:, 2:] - frame.objects.xyxy[:, :2], axis=1)
    assert (np.clip(width, 0, None) * np.clip(height, 0, None) <= 0.5 * areas + 1e-3).all()
    assert len(middles) == len(frame.objects)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        pytest.param({"seconds": 0.0}, "seconds", id="no-time"),
        pytest.param({"seconds": float("nan")}, "seconds", id="nan"),
        pytest.param({"fps": 0.5}, "fps", id="slow"),
        pytest.param({"height": 91}, "height", id="odd"),
        pytest.param({"width": 10}, "width", id="tiny"),
        pytest.param({"width": 100_000}, "width", id="huge"),
        pytest.param({"seed": -1}, "seed", id="seed"),
        pytest.param({"place": "moon"}, "junction, tee, highway", id="place"),
        pytest.param({"light": "noon"}, "day, night, change", id="light"),
        pytest.param({"density": 9.0}, "density", id="density"),
        pytest.param({"look_alikes": 1.1}, "look_alikes", id="look-alikes"),
        pytest.param({"exposure_s": 1.0}, "exposure_s", id="exposure"),
        pytest.param({"jpeg_quality": 100}, "jpeg_quality", id="jpeg"),
    ],
)
def test_bad_settings_are_refused(settings, named):
    with pytest.raises(ConfigError, match=named) as caught:
        SceneConfig(**settings)
    assert "\n" not in str(caught.value)


def test_noise_and_compression_change_pixels_but_not_truth():
    plain, noisy, packed = (
        next(iter(SyntheticScene(small_config(seed=1, shake_px=0.0, **settings))))
        for settings in ({"noise": 0.0}, {"noise": 4.0}, {"noise": 0.0, "jpeg_quality": 20})
    )
    for other in (noisy, packed):
        difference = np.abs(plain.image.astype(int) - other.image.astype(int)).mean()
        assert 0.5 < difference < 12
        np.testing.assert_array_equal(plain.objects.xyxy, other.objects.xyxy)
