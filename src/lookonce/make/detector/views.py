"""Training pictures seen otherwise: nearer, farther, mirrored, in other light, four in one.

Positions are changed by one affine map and colours by one linear map of RGB, both done by Pillow, so that making a view
takes less time than learning from it.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from lookonce.letterbox import PADDING_GREY
from lookonce.make.detector.samples import Sample, View

__all__ = ["Opened", "mosaic", "single"]

_Floats = NDArray[np.float64]
_GREY = (PADDING_GREY,) * 3
_LUMA = np.array([0.299, 0.587, 0.114])
_LEAST_VISIBLE = 0.2  # of an object that the border cuts: below, it is ignored
_SINGLE_ZOOM = (0.5, 1.8)
_MOSAIC_ZOOM = (0.5, 1.5)  # of each of four, against the picture that fills the whole canvas; times a half


@dataclass(frozen=True, slots=True)
class Opened:
    """A decoded picture of a sample.

    Attributes:
        picture: RGB.
        factor: (4,) by what the sample's boxes are to be multiplied.
        sample: what is known about it.
    """

    picture: Image.Image
    factor: _Floats
    sample: Sample


@dataclass(frozen=True, slots=True)
class _Placed:
    """One picture on the canvas: pixels of a part of it, and what is known there."""

    xyxy: _Floats
    labels: NDArray[np.int64]
    ignored: _Floats


def single(opened: Opened, size: tuple[int, int], rng: Generator, *, least_side_px: float) -> View:
    """One picture at another scale and place, recoloured.

    Args:
        opened: the picture.
        size: (height, width) of the canvas in px.
        rng: source of all choices.
        least_side_px: smaller objects are ignored.
    """
    height, width = size
    canvas = Image.new("RGB", (width, height), _GREY)
    placed = _place_(canvas, opened, (0, 0, width, height), _SINGLE_ZOOM, 1.0, rng, least_side_px)
    labelled = np.repeat(opened.sample.labelled[None], 4, axis=0)
    return _finish(canvas, [placed], np.array([width, height], np.float32), labelled, rng)


def mosaic(four: list[Opened], size: tuple[int, int], rng: Generator, *, least_side_px: float) -> View:
    """Four pictures that meet in a point (Bochkovskiy et al. 2020, section 3.3); arguments as of ``single``."""
    height, width = size
    canvas = Image.new("RGB", (width, height), _GREY)
    column, row = (int(n * rng.uniform(0.3, 0.7)) for n in (width, height))
    quarters = [(0, 0, column, row), (column, 0, width, row), (0, row, column, height), (column, row, width, height)]
    placed = [
        _place_(canvas, opened, quarter, _MOSAIC_ZOOM, 0.5, rng, least_side_px)
        for opened, quarter in zip(four, quarters, strict=True)
    ]
    labelled = np.stack([opened.sample.labelled for opened in four])
    return _finish(canvas, placed, np.array([column, row], np.float32), labelled, rng)


def _place_(
    canvas: Image.Image,
    opened: Opened,
    part: tuple[int, int, int, int],
    zooms: tuple[float, float],
    share: float,
    rng: Generator,
    least_side_px: float,
) -> _Placed:
    """Draw a picture into a part of the canvas, in place; ``share``: how much smaller than to fill the canvas."""
    picture, sample = opened.picture, opened.sample
    left, top, right, bottom = part
    fit = min(canvas.width / picture.width, canvas.height / picture.height) * share
    zoom = fit * np.exp(rng.uniform(*np.log(zooms)))
    stretch = np.exp(rng.normal(0, 0.08))
    scale = np.array([zoom * stretch, zoom / stretch])
    is_flipped = rng.random() < 0.5
    objects = sample.xyxy * opened.factor
    target = np.array([right - left, bottom - top])
    extent = scale * picture.size
    # what of the picture is shown: anywhere that leaves no gap needlessly, drawn towards an object
    free = target - extent
    corner = np.where(free >= 0, free * rng.uniform(0, 1, 2), free * rng.uniform(0, 1, 2))
    if len(objects) and (free < 0).any() and rng.random() < 0.7:
        box = objects[rng.integers(len(objects))] * np.tile(scale, 2)
        middle = (box[:2] + box[2:]) / 2
        if is_flipped:
            middle[0] = extent[0] - middle[0]
        wanted = target * rng.uniform(0.25, 0.75, 2) - middle
        corner = np.where(free < 0, np.clip(wanted, free, 0), corner)
    flip = -1 if is_flipped else 1
    matrix = np.array([[scale[0] * flip, 0], [0, scale[1]]])
    shift = corner + np.array([extent[0] if is_flipped else 0, 0])
    canvas.paste(_drawn(picture, matrix, shift, (right - left, bottom - top), rng), (left, top))
    limits = np.array([left, top, right, bottom], np.float64)
    boxes, visible = _moved(objects, matrix, shift, limits)
    ignored, shown = _moved(sample.ignored * opened.factor, matrix, shift, limits)
    sides = (boxes[:, 2:] - boxes[:, :2]).min(axis=1, initial=np.inf)
    is_taught = (visible >= _LEAST_VISIBLE) & (sides >= least_side_px)
    is_doubtful = (visible > 0) & ~is_taught
    return _Placed(boxes[is_taught], sample.labels[is_taught], np.concatenate([ignored[shown > 0], boxes[is_doubtful]]))


def _drawn(picture: Image.Image, matrix: _Floats, shift: _Floats, size: tuple[int, int], rng: Generator) -> Image.Image:
    """A part of the picture under ``p -> matrix p + shift``, recoloured, on grey."""
    zoom = abs(matrix[1, 1])
    if zoom < 0.6:
        shrunk = picture.reduce(2)
        matrix = matrix * (np.array(picture.size) / shrunk.size)
        picture = shrunk
    inverse = np.linalg.inv(matrix)
    back = -inverse @ shift
    rows = (*inverse[0], back[0], *inverse[1], back[1])
    drawn = picture.transform(size, Image.Transform.AFFINE, rows, resample=Image.Resampling.BILINEAR, fillcolor=_GREY)
    return drawn.convert("RGB", tuple(_colour_matrix(rng).ravel()))


def _colour_matrix(rng: Generator) -> _Floats:
    """A linear map of RGB (3, 4): brightness, contrast, saturation, hue and white balance at once."""
    gain = np.exp(rng.normal(0, 0.25))
    balance = np.exp(rng.normal(0, 0.06, 3))
    saturation = np.exp(rng.normal(0, 0.35)) if rng.random() < 0.95 else 0.0
    angle = rng.normal(0, 0.12)
    cos, sin = np.cos(angle), np.sin(angle) / np.sqrt(3)
    turn = (1 - cos) / 3 + cos * np.eye(3) + sin * np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    vivid = saturation * np.eye(3) + (1 - saturation) * np.tile(_LUMA, (3, 1))
    matrix = gain * balance[:, None] * (turn @ vivid)
    offset = rng.normal(0, 12) + 127 * (1 - gain) * rng.uniform(0, 0.6)  # contrast about the middle grey
    return np.concatenate([matrix, np.full((3, 1), offset)], axis=1)


def _moved(boxes: _Floats, matrix: _Floats, shift: _Floats, limits: _Floats) -> tuple[_Floats, _Floats]:
    """Boxes (N, 4) after the map, cut at ``limits`` (left, top, right, bottom), and the share (N,) that is left."""
    corner = limits[:2]
    a, b = boxes[:, :2] @ matrix.T + shift + corner, boxes[:, 2:] @ matrix.T + shift + corner
    moved = np.concatenate([np.minimum(a, b), np.maximum(a, b)], axis=1)
    cut = np.clip(moved, np.tile(corner, 2), np.tile(limits[2:], 2))
    area = (moved[:, 2:] - moved[:, :2]).prod(axis=1)
    return cut, (cut[:, 2:] - cut[:, :2]).prod(axis=1) / np.maximum(area, 1e-9)


def _finish(
    canvas: Image.Image,
    placed: list[_Placed],
    split: NDArray[np.float32],
    labelled: NDArray[np.bool_],
    rng: Generator,
) -> View:
    """Blur, noise and JPEG's marks over the whole canvas."""
    if rng.random() < 0.15:
        canvas = canvas.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 1.2)))
    if rng.random() < 0.15:
        file = io.BytesIO()
        canvas.save(file, "JPEG", quality=int(rng.integers(20, 80)))
        canvas = Image.open(file).convert("RGB")
    pixels = np.array(canvas)
    if rng.random() < 0.15:
        noise = rng.integers(-12, 13, pixels.shape[:2], np.int16)[..., None]
        pixels = np.clip(pixels + noise, 0, 255).astype(np.uint8)
    return View(
        canvas=pixels,
        xyxy=np.concatenate([part.xyxy for part in placed]).astype(np.float32),
        labels=np.concatenate([part.labels for part in placed]),
        ignored=np.concatenate([part.ignored for part in placed]).astype(np.float32),
        split=split,
        labelled=labelled,
    )
