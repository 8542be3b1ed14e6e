"""How light falls on faces and limbs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.body import Surface
from lookonce.synthetic.light import Light

__all__ = ["Exposure", "shade_capsules", "shade_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_LAMP_LIGHT = np.array([0.62, 0.50, 0.34])  # of street lamps on a white face
_WARM_ROOM = np.array([250.0, 214.0, 150.0])
_TAIL_LIT, _TAIL_BRAKING = np.array([190.0, 26.0, 22.0]), np.array([255.0, 54.0, 40.0])
_HEADLIGHT_LIT = np.array([255.0, 250.0, 232.0])
_BLINKER_LIT = np.array([255.0, 170.0, 30.0])
_GLOW_DAY = 0.75


@dataclass(frozen=True, slots=True)
class Exposure:
    """What reaches each face besides the common light; F faces.

    Attributes:
        sun: (F,) share of the sun that is not held off by houses and trees.
        lamps: (F,) light of street lamps, 0 to 1.
        braking: (F,) whether its vehicle brakes.
    """

    sun: Floats
    lamps: Floats
    braking: NDArray[np.bool_]


def shade_faces(
    colours: Floats, surfaces: Ints, normals: Floats, views: Floats, exposure: Exposure, light: Light
) -> NDArray[np.uint8]:
    """The colours of faces, (F, 3) uint8.

    Args:
        colours: (F, 3), 0 to 255.
        surfaces: (F,) ``Surface``.
        normals: (F, 3) unit vectors in the world.
        views: (F, 3) unit vectors from the camera to the faces.
        exposure: what differs between them.
        light: of the moment.
    """
    facing = np.maximum(_along(normals, light.towards_sun), 0) * exposure.sun
    up = 0.5 + 0.5 * normals[:, 2:]
    received = light.sky_colour * up + light.ground_colour * (1 - up) + facing[:, None] * light.sun_colour
    received = received + (exposure.lamps * light.night)[:, None] * _LAMP_LIGHT * (0.45 + 0.55 * up)
    shaded = colours * received * 1.18
    head_on = -(normals * views).sum(axis=1)
    mirrored = views + 2 * head_on[:, None] * normals
    sky = 255 * light.sky_colour * (1.15 + 0.2 * light.sun)
    seen_sky = np.clip(mirrored[:, 2:] * 2.2 + 0.25, 0.06, 1)
    fresnel = (1 - np.clip(head_on, 0, 1)) ** 3
    glint = np.clip(_along(mirrored, light.towards_sun), 0, 1) ** 40 * light.sun * exposure.sun
    is_glass = (surfaces == Surface.GLASS) | (surfaces == Surface.LIT_AT_NIGHT)
    is_glossy = surfaces == Surface.PAINT
    share = np.where(is_glass, 0.16 + 0.75 * fresnel, np.where(is_glossy, 0.05 + 0.30 * fresnel, 0.0))[:, None]
    shaded = shaded * (1 - share * 0.8) + share * sky * seen_sky
    shaded = shaded + (glint * np.where(is_glass, 190, np.where(is_glossy, 90, 0)))[:, None]
    shaded = _lit(shaded, surfaces, exposure, light)
    return np.clip(shaded, 0, 255).astype(np.uint8)


def _along(vectors: Floats, way: Floats) -> Floats:
    """Products of vectors ``(F, 3)`` with one; summed in a fixed order, unlike a matrix product's."""
    products: Floats = vectors[:, 0] * way[0] + vectors[:, 1] * way[1] + vectors[:, 2] * way[2]
    return products


def _lit(shaded: Floats, surfaces: Ints, exposure: Exposure, light: Light) -> Floats:
    """With the faces that give light themselves."""
    lamps = light.lamps
    result = shaded.copy()
    rows = surfaces == Surface.HEADLIGHT
    result[rows] += lamps * (_HEADLIGHT_LIT - result[rows])
    rows = surfaces == Surface.TAILLIGHT
    result[rows] += 0.85 * lamps * (_TAIL_LIT - result[rows])
    rows &= exposure.braking
    result[rows] += 0.9 * (_TAIL_BRAKING - result[rows])
    rows = (surfaces == Surface.BLINKER_LEFT) | (surfaces == Surface.BLINKER_RIGHT)
    result[rows] = _BLINKER_LIT
    rows = surfaces == Surface.LIT_AT_NIGHT
    result[rows] += 0.75 * lamps * (_WARM_ROOM - result[rows])
    rows = surfaces == Surface.GLOWING
    result[rows] = np.maximum(result[rows], (_GLOW_DAY + (1 - _GLOW_DAY) * lamps) * np.minimum(result[rows] * 3, 250))
    return result


def shade_capsules(
    colours: Floats, sun: Floats, lamps: Floats, light: Light
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The colours of limbs, in their shade and where the light falls, both (C, 3) uint8.

    Args:
        colours: (C, 3), 0 to 255.
        sun: (C,) share of the sun that reaches them.
        lamps: (C,) light of street lamps, 0 to 1.
        light: of the moment.
    """
    around = light.sky_colour * 0.72 + light.ground_colour * 0.5 + (lamps * light.night)[:, None] * _LAMP_LIGHT * 0.5
    direct = sun[:, None] * light.sun_colour
    dark = colours * (around + 0.22 * direct) * 1.15
    bright = colours * (around * 1.12 + 0.82 * direct) * 1.15
    return np.clip(dark, 0, 255).astype(np.uint8), np.clip(bright, 0, 255).astype(np.uint8)
