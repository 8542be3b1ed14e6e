"""The stage of a scene: its site, what stands there, the light, and the picture of it without traffic."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.backdrop import Backdrop, Standing
from lookonce.synthetic.camera import Camera
from lookonce.synthetic.config import PLACES, SceneConfig
from lookonce.synthetic.footprints import corners_of
from lookonce.synthetic.ground import GroundMap, draw_ground
from lookonce.synthetic.highway import make_highway
from lookonce.synthetic.junction import make_junction
from lookonce.synthetic.light import Weather
from lookonce.synthetic.projecting import Placed
from lookonce.synthetic.scenery import build_thing, shadow_of, thing_footprint
from lookonce.synthetic.site import Site, Thing
from lookonce.synthetic.truth import ignored_boxes

__all__ = ["Stage", "Streams", "set_stage"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Streams:
    """Independent random numbers for each part of a scene, so that one part's draws do not move another's."""

    site: np.random.Generator
    scenery: np.random.Generator
    weather: np.random.Generator
    fleet: np.random.Generator
    traffic: np.random.Generator
    camera: np.random.Generator

    @classmethod
    def of(cls, seed: int) -> Streams:
        """From a scene's seed."""
        return cls(*(np.random.default_rng(part) for part in np.random.SeedSequence(seed).spawn(6)))


@dataclass(frozen=True, slots=True)
class Stage:
    """What stays the same through a scene.

    Attributes:
        site: roads and all that belongs to them.
        camera: without shake.
        weather: the light by time.
        ground: the map of the ground.
        backdrop: the picture without traffic.
        standing: things that may hide traffic.
        signals: (number in ``standing``, signal group) of the signals.
        ignored: (M, 4) float32, xyxy in px.
    """

    site: Site
    camera: Camera
    weather: Weather
    ground: GroundMap
    backdrop: Backdrop
    standing: tuple[Standing, ...]
    signals: tuple[tuple[int, int], ...]
    ignored: NDArray[np.float32]


def set_stage(config: SceneConfig, streams: Streams) -> Stage:
    """Builds the stage of a scene."""
    place = config.place or PLACES[int(streams.site.choice(len(PLACES), p=[0.45, 0.2, 0.35]))]
    if place == "highway":
        site = make_highway(streams.site)
    else:
        site = make_junction(streams.site, arms=4 if place == "junction" else 3)
    camera = site.view.camera((config.height, config.width))
    weather = Weather(config, streams.weather, site.view.yaw_rad)
    bodies = [build_thing(thing, streams.scenery) for thing in site.things]
    shadows = [
        outline
        for thing, body in zip(site.things, bodies, strict=True)
        for outline in shadow_of(thing, body, weather.towards_sun)
    ]
    lamps = [_under_lamp(thing) for thing in site.things if thing.kind == "lamp"]
    ground = draw_ground(site, streams.scenery, shadows, lamps, config.width)
    standing: list[Standing] = []
    signals: list[tuple[int, int]] = []
    for thing, body in zip(site.things, bodies, strict=True):
        x, y = np.array([thing.x]), np.array([thing.y])
        light = float(ground.light_at(x, y)[1][0])
        placed = Placed(body, thing.x, thing.y, thing.yaw, 1.0, light * (0.3 if thing.kind == "house" else 0.7))
        length, width = thing_footprint(thing, body)
        corners = corners_of(np.c_[x, y], np.array([thing.yaw]), np.array([length]), np.array([width]))[0]
        if _may_be_seen(camera, placed):
            if thing.kind == "signal":
                signals.append((len(standing), thing.group))
            standing.append(Standing(placed, corners))
    margin = math.ceil(4 * config.shake_px * config.width / 960)
    backdrop = Backdrop(camera, ground, standing, weather, streams.scenery, margin)
    ignored = _project_regions(site, camera) if config.ignored_regions else np.zeros((0, 4), np.float32)
    return Stage(site, camera, weather, ground, backdrop, tuple(standing), tuple(signals), ignored)


def _under_lamp(thing: Thing) -> tuple[float, float]:
    return thing.x + 2.0 * math.cos(thing.yaw), thing.y + 2.0 * math.sin(thing.yaw)


def _may_be_seen(camera: Camera, placed: Placed) -> bool:
    """Whether a body is ahead of the camera, roughly."""
    reach = max(placed.body.size) + 1
    seen = camera.to_camera(np.array([(placed.x, placed.y, 1.0)]))[0]
    half_width = camera.size[1] / 2 / camera.focal_px
    return bool(seen[2] > -0.3 * reach + 1 and abs(seen[0]) < half_width * max(float(seen[2]), 0) + 1.6 * reach)


def _project_regions(site: Site, camera: Camera) -> NDArray[np.float32]:
    boxes = []
    for corners in site.ignored:
        seen = camera.to_camera(corners)
        if (seen[:, 2] > 5).all():
            px = camera.to_picture(seen)
            boxes.append(np.concatenate([px.min(axis=0), px.max(axis=0)]))
    return ignored_boxes(boxes, camera.size)
