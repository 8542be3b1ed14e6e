"""A frame: shadows, then everything from the far to the near, with a record of who is seen where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.synthetic.footprints import corners_of, paint_order
from lookonce.synthetic.light import Light
from lookonce.synthetic.painting import Tile, blur_along, paint_tile
from lookonce.synthetic.people import draw_person
from lookonce.synthetic.projecting import Placed, project
from lookonce.synthetic.scenery import signal_body
from lookonce.synthetic.shadows import beam_mask, contact_mask, shadow_mask
from lookonce.synthetic.stage import Stage
from lookonce.synthetic.traffic import Agent
from lookonce.synthetic.truth import Seen, visibility_of

__all__ = ["FrameRenderer", "Painted"]

Floats = NDArray[np.float64]

_CONTACT_DARK = (10, 10, 12)
_NIGHT_EXPOSURE = 3.0
_GLOW_SIDE = 48
_LEAST_GLOW_PX = 3
_CACHED_TILES = 600


@dataclass(frozen=True, slots=True)
class Painted:
    """A frame as the optics give it.

    Attributes:
        image: RGB.
        seen: the objects that reach into the picture.
    """

    image: Image.Image
    seen: list[Seen]


@dataclass(frozen=True, slots=True)
class _Item:
    """Something to paint: an agent (number from 1) or a standing thing (number 0)."""

    tile: Tile
    corners: Floats
    number: int
    motion: tuple[float, float] = (0.0, 0.0)
    is_in_backdrop: bool = False


class FrameRenderer:
    """Paints frames of a stage.

    Args:
        stage: all that does not move.
        exposure_s: by day.
    """

    def __init__(self, stage: Stage, exposure_s: float) -> None:
        self._stage, self._exposure_s = stage, exposure_s
        self._tiles: dict[tuple[int, int, int], tuple[tuple[int, int, str], Tile | None]] = {}
        self._signal_bodies = {name: signal_body(name) for name in ("red", "amber", "green")}
        self._groups = dict(stage.signals)
        self._boxes = self._standing_boxes()
        self._glow = _glow_mask()

    def paint(self, agents: Sequence[Agent], light: Light, shift: tuple[int, int], signals: dict[int, str]) -> Painted:
        """A frame.

        Args:
            agents: who is on the way, in the order of their identities.
            light: of the moment.
            shift: half px right and down by which the picture is off.
            signals: state of each signal group.
        """
        camera = self._stage.camera
        near = [agent for agent in agents if self._may_be_seen(agent)]
        placed = self._place(near)
        shift_px = (shift[0] / 2, shift[1] / 2)
        image = self._ground(placed, light, shift)
        outlines = project(placed, camera, light, shift_px)
        tiles = [paint_tile(outline, camera.size) for outline in outlines]
        motions = self._motions(near, light)
        corners = _footprints(near)
        items = [_Item(tile, corners[k], k + 1, motions[k]) for k, tile in enumerate(tiles) if tile is not None]
        items += self._standing_items(items, light, shift, signals)
        owners = np.zeros(camera.size, np.int32)
        self._paint_items_(image, owners, items)
        if light.lamps > 0:
            self._paint_glows_(image, owners, placed, light, shift_px)
        return Painted(image, _look(near, items, owners, camera.yaw_rad))

    def _may_be_seen(self, agent: Agent) -> bool:
        camera = self._stage.camera
        reach = agent.member.length / 2 + 4
        seen = camera.to_camera(np.array([(agent.x, agent.y, 1.0)]))[0].tolist()
        half = camera.size[1] / 2 / camera.focal_px, camera.size[0] / 2 / camera.focal_px
        depth = max(seen[2], 0)
        return bool(
            seen[2] > -reach and abs(seen[0]) < half[0] * depth + reach and abs(seen[1]) < half[1] * depth + 2 * reach
        )

    def _place(self, agents: Sequence[Agent]) -> list[Placed]:
        if not agents:
            return []
        sun, lamps = self._stage.ground.light_at(*np.array([(agent.x, agent.y) for agent in agents]).T)
        placed = []
        for agent, bright, lit in zip(agents, sun.tolist(), lamps.tolist(), strict=True):
            body = agent.member.body
            if agent.member.person is not None:
                limbs = draw_person(agent.member.person, agent.stride, is_walking=agent.speed > 0.2)
                body = replace(body, capsules=limbs)
            placed.append(Placed(body, agent.x, agent.y, agent.yaw, bright, lit, agent.is_braking))
        return placed

    def _ground(self, placed: Sequence[Placed], light: Light, shift: tuple[int, int]) -> Image.Image:
        """The backdrop with shadows and beams on it."""
        image, shade, headlit = self._stage.backdrop.mix(light, shift)
        camera, shift_px = self._stage.camera, (shift[0] / 2, shift[1] / 2)
        if not placed:
            return image
        if light.sun > 0.02:
            image.paste(shade, (0, 0), shadow_mask(placed, camera, light, shift_px))
        if light.lamps > 0:
            image.paste(headlit, (0, 0), beam_mask(placed, camera, light, shift_px))
        image.paste(_CONTACT_DARK, (0, 0, *image.size), contact_mask(placed, camera, shift_px))
        return image

    def _motions(self, agents: Sequence[Agent], light: Light) -> list[tuple[float, float]]:
        """How far each moves in the picture while the shutter is open, px."""
        if not agents:
            return []
        exposure_s = self._exposure_s * (1 + (_NIGHT_EXPOSURE - 1) * light.night)
        camera = self._stage.camera
        rows = np.array([(agent.x, agent.y, agent.yaw, agent.speed * exposure_s) for agent in agents])
        way = rows[:, 3:] * np.stack([np.cos(rows[:, 2]), np.sin(rows[:, 2])], axis=1)
        here = np.c_[rows[:, :2], np.full(len(rows), 0.7)]
        there = here.copy()
        there[:, :2] += way
        motion = camera.to_picture(camera.to_camera(there)) - camera.to_picture(camera.to_camera(here))
        return [(x, y) for x, y in motion.tolist()]

    def _standing_boxes(self) -> Floats:
        light = self._stage.weather.at(0.0)
        placed = [one.placed for one in self._stage.standing]
        outlines = project(placed, self._stage.camera, light, (0.0, 0.0))
        return np.array([outline.xyxy for outline in outlines]).reshape(-1, 4)

    def _standing_items(
        self, items: Sequence[_Item], light: Light, shift: tuple[int, int], signals: dict[int, str]
    ) -> list[_Item]:
        """The standing things that share pixels with traffic, and the signals."""
        boxes = np.array([item.tile.box for item in items]).reshape(-1, 4)
        grown = self._boxes + np.array([-12, -12, 12, 12])
        meets = (grown[:, None, :2] < boxes[None, :, 2:]).all(axis=2) & (boxes[None, :, :2] < grown[:, None, 2:]).all(
            axis=2
        )
        chosen = meets.any(axis=1)
        chosen[list(self._groups)] = True
        numbers = np.flatnonzero(chosen).tolist()
        self._make_tiles(numbers, light, shift, signals)
        found = []
        for number in numbers:
            tile = self._tiles[number, shift[0], shift[1]][1]
            if tile is not None:
                corners = self._stage.standing[number].corners
                found.append(_Item(tile, corners, 0, is_in_backdrop=number not in self._groups))
        return found

    def _make_tiles(self, numbers: list[int], light: Light, shift: tuple[int, int], signals: dict[int, str]) -> None:
        """Tiles of things; they are kept for each place that shake brings them to until the light changes."""
        if len(self._tiles) >= _CACHED_TILES:
            self._tiles.clear()
        stale, placed = [], []
        for number in numbers:
            state = signals.get(self._groups.get(number, -1), "")
            look = (*light.key, state)
            known = self._tiles.get((number, *shift))
            if known is None or known[0] != look:
                thing = self._stage.standing[number].placed
                placed.append(replace(thing, body=self._signal_bodies[state]) if state else thing)
                stale.append((number, look))
        camera = self._stage.camera
        outlines = project(placed, camera, light, (shift[0] / 2, shift[1] / 2))
        for (number, look), outline in zip(stale, outlines, strict=True):
            self._tiles[number, shift[0], shift[1]] = (look, paint_tile(outline, camera.size))

    def _paint_items_(self, image: Image.Image, owners: NDArray[np.int32], items: Sequence[_Item]) -> None:
        """Draw into ``image``, and their numbers into ``owners``."""
        if not items:
            return
        eye = self._stage.camera.position[:2]
        corners = np.array([item.corners for item in items])
        boxes = np.array([item.tile.box for item in items], np.float64)
        distances = np.hypot(*(corners.mean(axis=1) - np.array(eye)).T)
        touched: list[tuple[int, int, int, int]] = []
        for k in paint_order(corners, (eye[0], eye[1]), boxes, distances):
            item = items[k]
            left, top, right, bottom = item.tile.box
            if item.is_in_backdrop and not any(_meet(item.tile.box, box) for box in touched):
                continue
            blurred, x, y = blur_along(item.tile.image, item.motion)
            image.paste(blurred, (left + x, top + y), blurred)
            owners[top:bottom, left:right][item.tile.mask] = item.number
            if item.number:
                touched.append(item.tile.box)

    def _paint_glows_(
        self,
        image: Image.Image,
        owners: NDArray[np.int32],
        placed: Sequence[Placed],
        light: Light,
        shift: tuple[float, float],
    ) -> None:
        """Draw into ``image`` the glow of headlights that look at the camera."""
        camera = self._stage.camera
        eye = np.array(camera.position)
        for number, one in enumerate(placed, 1):
            length, width, _ = one.body.size
            if length < 1.9:
                continue
            cos, sin = math.cos(one.yaw), math.sin(one.yaw)
            sides = (-0.36, 0.36) if width > 1 else (0.0,)
            spots = np.array(
                [
                    (one.x + length / 2 * cos - s * width * sin, one.y + length / 2 * sin + s * width * cos, 0.68)
                    for s in sides
                ]
            )
            ways = eye - spots
            facing = (ways[:, 0] * cos + ways[:, 1] * sin) / np.sqrt((ways**2).sum(axis=1))
            seen = camera.to_camera(spots)
            px = camera.to_picture(seen) + np.array(shift)
            for (x, y), depth, front in zip(px.tolist(), seen[:, 2].tolist(), facing.tolist(), strict=True):
                if depth < 2 or front < 0.15 or not _owns(owners, x, y, number):
                    continue
                side = (
                    round(camera.focal_px / depth * 1.9 * (0.4 + 0.6 * front) * (0.5 + 0.5 * light.lamps))
                    + _LEAST_GLOW_PX
                )
                mask = self._glow.resize((side, side), Image.Resampling.BILINEAR)
                image.paste((255, 246, 224), (round(x - side / 2), round(y - side / 2)), mask)


def _meet(one: tuple[int, int, int, int], other: tuple[int, int, int, int]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _owns(owners: NDArray[np.int32], x: float, y: float, number: int) -> bool:
    """Whether an object is what is seen at a place."""
    height, width = owners.shape
    return 0 <= x < width and 0 <= y < height and int(owners[int(y), int(x)]) == number


def _footprints(agents: Sequence[Agent]) -> Floats:
    rows = np.array([(agent.x, agent.y, agent.yaw, agent.member.length, agent.member.width) for agent in agents])
    rows = rows.reshape(-1, 5)
    return corners_of(rows[:, :2], rows[:, 2], rows[:, 3], rows[:, 4])


def _glow_mask() -> Image.Image:
    """A round glow that fades outwards, "L"."""
    grid = (np.arange(_GLOW_SIDE) + 0.5) / _GLOW_SIDE * 2 - 1
    radius = np.hypot(grid[:, None], grid[None])
    glow = np.clip(1 - radius, 0, 1) ** 2.6 * 235 + 255 * np.clip(1 - radius / 0.22, 0, 1)
    return Image.fromarray(np.clip(glow, 0, 255).astype(np.uint8))


def _look(agents: Sequence[Agent], items: Sequence[_Item], owners: NDArray[np.int32], ahead_rad: float) -> list[Seen]:
    """The objects among the items, with what can be seen of them; the camera looks to ``ahead_rad``."""
    seen = []
    for item in items:
        if not item.number:
            continue
        agent, tile = agents[item.number - 1], item.tile
        left, top, right, bottom = tile.box
        share, hidden, by = visibility_of(tile.mask, owners[top:bottom, left:right], item.number, (left, top))
        culprit = agents[by - 1].identity if by else -1
        member = agent.member
        heading = math.degrees(agent.yaw - ahead_rad) % 360
        seen.append(
            Seen(
                agent.identity,
                member.label,
                member.kind,
                tile.xyxy,
                share,
                hidden,
                culprit,
                tile.truncation,
                agent.speed,
                heading,
            )
        )
    return seen
