"""Pictures seen otherwise: what a still would look like from nearer or farther, in other light, behind something.

Two ways to make views of one object. A *view* transforms the whole picture: scale, shift, flip, shear, light, colour,
blur, noise, JPEG, covered parts. A *collage* cuts objects out of many stills and puts them, each transformed by itself,
in front of another picture: the background changes, one detector pass serves twenty objects, and they cover each other.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from lookonce.letterbox import PADDING_GREY

__all__ = ["View", "collage", "jitter_boxes", "maybe_jpeg", "other_colours", "view"]

_Floats = NDArray[np.float64]
_ZOOM = (0.55, 1.7)  # of a view, against the letterboxed picture
_HEIGHTS_PX = (18, 130)  # of objects in a collage
_MARGIN = 0.12  # cut around an object, share of its size
_PLACE_TRIES = 12
_MOST_COVERED = 0.3  # an object is not placed where it would cover more of another


@dataclass(frozen=True, slots=True)
class View:
    """One transformed picture.

    Attributes:
        canvas: (H, W, 3) uint8 RGB of the network's size.
        boxes: xyxy (N, 4) float64 px of the canvas, cut at its border; NaN where an object found no place.
        visible: (N,) share of each box that can be seen, 0 to 1.
    """

    canvas: NDArray[np.uint8]
    boxes: _Floats
    visible: _Floats


def view(picture: Image.Image, boxes: _Floats, size: tuple[int, int], rng: Generator) -> View:
    """The whole picture in another scale, place and light.

    Args:
        picture: RGB.
        boxes: xyxy (N, 4) px of the picture.
        size: (height, width) of the canvas in px.
        rng: source of all choices.
    """
    height, width = size
    zoom = min(width / picture.width, height / picture.height) * np.exp(rng.uniform(*np.log(_ZOOM)))
    stretch, shear, turn = np.exp(rng.normal(0, 0.06)), rng.normal(0, 0.05), rng.normal(0, 0.03)
    flip = -1 if rng.random() < 0.5 else 1
    scale = np.array([zoom * stretch, zoom / stretch])
    matrix = scale[:, None] * np.array([[flip, shear - turn], [turn, 1]])
    focus = np.array([picture.width, picture.height]) / 2
    if len(boxes):
        box = boxes[rng.integers(len(boxes))]
        focus += ((box[:2] + box[2:]) / 2 - focus) * rng.uniform(0, 1)  # keeps some object in view
    shift = np.array([width, height]) * (0.5 + rng.uniform(-0.15, 0.15, 2)) - matrix @ focus
    image = _transform(picture, matrix, shift, size)
    if rng.random() < 0.3:
        image = image.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 1.2)))
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2 @ matrix.T + shift
    half = (boxes[:, 2:] - boxes[:, :2]) * scale / 2
    moved = np.concatenate([centres - half, centres + half], axis=1)
    canvas = _to_pixels(_add_noise(_recolour(np.asarray(image, np.float32), rng), rng))
    for box in moved[rng.random(len(moved)) < 0.25]:
        _cover_(canvas, box, rng)
    limits = np.array([width, height, width, height])
    cut = np.clip(moved, 0, limits)
    return View(maybe_jpeg(canvas, rng), cut, _area(cut) / np.maximum(_area(moved), 1e-9))


def collage(
    background: Image.Image, objects: Sequence[tuple[Image.Image, _Floats]], size: tuple[int, int], rng: Generator
) -> View:
    """Objects of many pictures in front of another one.

    Args:
        background: RGB; a part of it is stretched over the canvas.
        objects: picture and box xyxy (4,) in its px.
        size: (height, width) of the canvas in px.
        rng: source of all choices.
    """
    height, width = size
    part = rng.uniform(0.5, 1, 2) * background.size
    corner = rng.uniform(0, 1, 2) * (background.size - part)
    scene = background.resize((width, height), Image.Resampling.BILINEAR, box=(*corner, *(corner + part)))
    canvas = _recolour(np.asarray(scene, np.float32), rng)
    boxes = np.full((len(objects), 4), np.nan)
    owner = np.full(size, -1)
    for index, (picture, box) in enumerate(objects):
        cut = _cut_out(picture, box, size, rng)
        corner_px = _find_place(cut.box, boxes, size, rng) if cut else None
        if cut is None or corner_px is None:
            continue
        left, top = corner_px
        rows, columns = cut.pixels.shape[:2]
        region = canvas[top : top + rows, left : left + columns]
        region += (cut.pixels - region) * cut.mask
        boxes[index] = cut.box + np.tile(corner_px, 2)
        x1, y1, x2, y2 = boxes[index].astype(int)
        owner[y1:y2, x1:x2] = index
    image = Image.fromarray(_to_pixels(canvas))
    if rng.random() < 0.4:
        image = image.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 1.0)))
    noisy = _to_pixels(_add_noise(np.asarray(image, np.float32), rng))
    return View(maybe_jpeg(noisy, rng), boxes, np.array([_own_share(owner, b, i) for i, b in enumerate(boxes)]))


def jitter_boxes(boxes: _Floats, rng: Generator, share: float = 0.05) -> NDArray[np.float32]:
    """Boxes (N, 4) moved and resized a little, as a detector's are; ``share`` of their size, one standard deviation."""
    extent = boxes[:, 2:] - boxes[:, :2]
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2 + rng.normal(0, share, extent.shape) * extent
    half = extent * np.exp(rng.normal(0, 1.3 * share, extent.shape)) / 2
    return np.concatenate([centre - half, centre + half], axis=1).astype(np.float32)


def other_colours(picture: Image.Image, rng: Generator) -> Image.Image:
    """The picture of another object of the same shape: other colours, mostly different ones above and below a line.

    Look-alikes that differ in colour only are the hardest negatives there are, and make more identities of few.
    """
    pixels = np.asarray(picture, np.float32)
    rows = len(pixels)
    upper, lower = _other_colour(pixels, rng), _other_colour(pixels, rng)
    choice = rng.random()
    if choice < 0.3:
        lower = upper
    elif choice < 0.5:
        upper = pixels
    elif choice < 0.65:
        lower = pixels
    line, softness = rng.uniform(0.3, 0.7) * rows, 0.03 * rows + 0.5
    is_lower = (1 / (1 + np.exp((line - np.arange(rows)) / softness)))[:, None, None].astype(np.float32)
    return Image.fromarray(_to_pixels(upper + (lower - upper) * is_lower))


def _other_colour(pixels: NDArray[np.float32], rng: Generator) -> NDArray[np.float32]:
    """Hue turned about the grey axis (Rodrigues' rotation), saturation, brightness and tint: far beyond other light."""
    angle = rng.uniform(-np.pi, np.pi) * (1 if rng.random() < 0.5 else 0.25)
    cos, sin = np.cos(angle), np.sin(angle) / np.sqrt(3)
    axis = np.full((3, 3), (1 - cos) / 3)
    turn = axis + cos * np.eye(3) + sin * np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    turned = pixels @ turn.T.astype(np.float32)
    grey = turned.mean(axis=2, keepdims=True)
    vivid = grey + (turned - grey) * np.float32(np.exp(rng.normal(0, 0.4)))
    changed: NDArray[np.float32] = vivid * np.float32(np.exp(rng.normal(0, 0.3))) + rng.normal(0, 20, 3).astype(
        np.float32
    )
    return changed


@dataclass(frozen=True, slots=True)
class _CutOut:
    """An object to paste: pixels (h, w, 3) and mask (h, w, 1) float32, and its box within them."""

    pixels: NDArray[np.float32]
    mask: NDArray[np.float32]
    box: _Floats


def _cut_out(picture: Image.Image, box: _Floats, size: tuple[int, int], rng: Generator) -> _CutOut | None:
    """One object, scaled, warped, flipped and recoloured, with a soft border; None where it is larger than ``size``."""
    extent = box[2:] - box[:2]
    margin = np.tile(_MARGIN * extent, 2) * [-1, -1, 1, 1]
    outer = np.clip(box + margin, 0, np.tile(picture.size, 2))
    height_px = np.exp(rng.uniform(*np.log(_HEIGHTS_PX)))
    height_px = min(height_px, extent[1] * 1.6 + 8, 150 * extent[1] / extent[0])  # neither magnified nor too wide
    scale = max(height_px, 10) / extent[1] * np.array([np.exp(rng.normal(0, 0.06)), 1])
    columns, rows = np.maximum(4, np.round((outer[2:] - outer[:2]) * scale)).astype(int)
    if columns > size[1] or rows > size[0]:
        return None  # a flat or narrow box: enlarged until it is high enough, it could take any amount of memory
    resampling = Image.Resampling.BOX if scale[1] < 0.7 else Image.Resampling.BILINEAR
    image = picture.resize((columns, rows), resampling, box=tuple(outer))
    inner = (box - np.tile(outer[:2], 2)) * np.tile(scale, 2)
    if min(columns, rows) >= 8 and rng.random() < 0.7:
        image = _warp(image, rng, rng.uniform(0.01, 0.06))
    if rng.random() < 0.5:
        image = image.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
        inner[[0, 2]] = columns - inner[[2, 0]]
    pixels = _recolour(np.asarray(image, np.float32), rng)
    return _CutOut(pixels, _soft_mask(inner, (rows, columns), rng), inner)


def _soft_mask(box: _Floats, size: tuple[int, int], rng: Generator) -> NDArray[np.float32]:
    """A superellipse over the box that fades outwards: most of the old background goes, (h, w, 1)."""
    if rng.random() < 0.25:
        return np.ones((*size, 1), np.float32)
    y, x = np.mgrid[: size[0], : size[1]] + 0.5
    centre, radius = (box[:2] + box[2:]) / 2, (box[2:] - box[:2]) / 2 * rng.uniform(0.92, 1.15, 2)
    power = rng.uniform(2, 5)
    distance = (np.abs((x - centre[0]) / radius[0]) ** power + np.abs((y - centre[1]) / radius[1]) ** power) ** (
        1 / power
    )
    mask: NDArray[np.float32] = np.clip((1.08 - distance) / rng.uniform(0.06, 0.25), 0, 1).astype(np.float32)
    return mask[..., None]


def _find_place(box: _Floats, taken: _Floats, size: tuple[int, int], rng: Generator) -> tuple[int, int] | None:
    """(left, top) for a cut-out whose box covers little of the others; None where there is none."""
    free = np.array([size[1], size[0]]) - np.ceil(box[2:] * 1.15 + 4).astype(int)
    if (free <= 0).any():
        return None
    others = taken[~np.isnan(taken[:, 0])]
    for _ in range(_PLACE_TRIES):
        left, top = (int(n) for n in rng.integers(0, free))
        placed = box + np.tile([left, top], 2)
        common = np.clip(np.minimum(placed[2:], others[:, 2:]) - np.maximum(placed[:2], others[:, :2]), 0, None)
        smaller = np.minimum(_area(placed[None]), _area(others))
        if (common.prod(axis=1) <= _MOST_COVERED * smaller).all():
            return left, top
    return None


def _own_share(owner: NDArray[np.int64], box: _Floats, index: int) -> float:
    """Share of a pasted box that no later one covers."""
    if np.isnan(box[0]):
        return 0.0
    x1, y1, x2, y2 = box.astype(int)
    return float((owner[y1:y2, x1:x2] == index).mean()) if x2 > x1 and y2 > y1 else 0.0


def _transform(picture: Image.Image, matrix: _Floats, shift: _Floats, size: tuple[int, int]) -> Image.Image:
    """The picture under ``p -> matrix p + shift`` on grey; shrunk first where pixels would be skipped."""
    zoom = np.sqrt(abs(np.linalg.det(matrix)))
    if zoom < 0.7:
        shrunk = (max(1, picture.width // 2), max(1, picture.height // 2))
        matrix = matrix * (np.array(picture.size) / shrunk)
        picture = picture.resize(shrunk, Image.Resampling.BOX)
    inverse = np.linalg.inv(matrix)
    back = -inverse @ shift
    rows = (*inverse[0], back[0], *inverse[1], back[1])
    grey = (PADDING_GREY,) * 3
    return picture.transform(
        size[::-1], Image.Transform.AFFINE, rows, resample=Image.Resampling.BILINEAR, fillcolor=grey
    )


def _warp(image: Image.Image, rng: Generator, share: float) -> Image.Image:
    """Bends the picture a little, as a walking person or another view does; ``share`` of its size."""
    width, height = image.size
    x, y = np.linspace(0, width, 3), np.linspace(0, height, 5)
    points = np.stack(np.meshgrid(x, y), axis=2)  # (5, 3, 2)
    points[1:-1, 1:-1] += rng.normal(0, share, (3, 1, 2)) * [width, height / 2]
    points[1:-1, :, 0] += rng.normal(0, share, (3, 1)) * width
    mesh = []
    for row in range(4):
        for column in range(2):
            target = (int(x[column]), int(y[row]), int(x[column + 1]), int(y[row + 1]))
            corners = ((row, column), (row + 1, column), (row + 1, column + 1), (row, column + 1))
            mesh.append((target, tuple(value for corner in corners for value in points[corner])))
    return image.transform(image.size, Image.Transform.MESH, mesh, resample=Image.Resampling.BILINEAR)


def _recolour(pixels: NDArray[np.float32], rng: Generator) -> NDArray[np.float32]:
    """Other light: brightness, white balance, contrast, saturation; identity is colour, so all of it mild."""
    pixels = pixels * np.exp(rng.normal(0, 0.10) + rng.normal(0, 0.03, 3)).astype(np.float32)
    mean = pixels.mean(axis=(0, 1))
    pixels = (pixels - mean) * np.float32(np.exp(rng.normal(0, 0.12))) + mean + np.float32(rng.normal(0, 6))
    grey = pixels.mean(axis=2, keepdims=True)
    recoloured: NDArray[np.float32] = grey + (pixels - grey) * np.float32(np.exp(rng.normal(0, 0.15)))
    return recoloured


def _add_noise(pixels: NDArray[np.float32], rng: Generator) -> NDArray[np.float32]:
    if rng.random() < 0.4:
        return pixels + rng.standard_normal(pixels.shape, np.float32) * np.float32(rng.uniform(1, 7))
    return pixels


def _cover_(canvas: NDArray[np.uint8], box: _Floats, rng: Generator) -> None:
    """Puts another part of the canvas over one side of a box, in place."""
    height, width = canvas.shape[:2]
    x1, y1, x2, y2 = box
    share = rng.uniform(0.1, 0.4)
    sides = (
        (x1, y1, x1 + share * (x2 - x1), y2),
        (x2 - share * (x2 - x1), y1, x2, y2),
        (x1, y2 - share * (y2 - y1), x2, y2),
        (x1, y1, x2, y1 + 0.6 * share * (y2 - y1)),
    )
    left, top, right, bottom = (int(n) for n in np.clip(sides[rng.integers(4)], 0, [width, height] * 2))
    if right <= left or bottom <= top:
        return
    from_x, from_y = rng.integers(0, width - (right - left) + 1), rng.integers(0, height - (bottom - top) + 1)
    patch = canvas[from_y : from_y + bottom - top, from_x : from_x + right - left].copy()
    canvas[top:bottom, left:right] = patch


def maybe_jpeg(canvas: NDArray[np.uint8], rng: Generator) -> NDArray[np.uint8]:
    """The picture (H, W, 3), half of the times as a JPEG of some quality shows it."""
    if rng.random() < 0.5:
        return canvas
    file = io.BytesIO()
    Image.fromarray(canvas).save(file, "JPEG", quality=int(rng.integers(25, 92)))
    return np.asarray(Image.open(file).convert("RGB"))


def _to_pixels(pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.clip(pixels, 0, 255).astype(np.uint8)


def _area(boxes: _Floats) -> _Floats:
    area: _Floats = np.clip(boxes[:, 2:] - boxes[:, :2], 0, None).prod(axis=1)
    return area
