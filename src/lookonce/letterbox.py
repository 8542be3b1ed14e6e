"""From a picture of any size to the detector's input: scaled to fit, centred, the rest grey; and the way back.

Scaling is libswscale's, through PyAV. A frame that comes from a decoder is scaled straight from its YUV planes, which
is cheaper than converting the whole frame to RGB first (`docs/log.md`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

import av
import numpy as np
from av.video.reformatter import Interpolation, VideoReformatter
from numpy.typing import NDArray

__all__ = ["PADDING_GREY", "Fit", "Letterboxer", "Pictured", "fit", "to_rgb"]

PADDING_GREY = 128  # Darknet letterboxes with 0.5 of full scale
_RGB = "rgb24"


@dataclass(frozen=True, slots=True)
class Fit:
    """Where a picture lies inside the detector's input; all sizes are (height, width) in px.

    ``network = source * scale + offset`` on each axis, with the offset (top, left).
    """

    source: tuple[int, int]
    network: tuple[int, int]
    scaled: tuple[int, int]
    offset: tuple[int, int]

    def to_network(self, xyxy: NDArray[np.float32]) -> NDArray[np.float32]:
        """Boxes ``xyxy (N, 4)`` in px of the source picture as px of the network's input; the way back."""
        top, left = self.offset
        vertical, horizontal = (t / s for s, t in zip(self.source, self.scaled, strict=True))
        factor = np.array([horizontal, vertical, horizontal, vertical], np.float32)
        return xyxy * factor + np.array([left, top, left, top], np.float32)

    def to_source(self, xyxy: NDArray[np.float32]) -> NDArray[np.float32]:
        """Boxes ``xyxy (N, 4)`` in px of the network's input as px of the source picture; a copy, not clipped."""
        top, left = self.offset
        shift = np.array([left, top, left, top], np.float32)
        vertical, horizontal = (s / t for s, t in zip(self.source, self.scaled, strict=True))
        factor = np.array([horizontal, vertical, horizontal, vertical], np.float32)
        return (xyxy - shift) * factor


def fit(source: tuple[int, int], network: tuple[int, int]) -> Fit:
    """The largest centred placement of ``source`` inside ``network`` that keeps the picture's shape.

    >>> fit((540, 960), (512, 512)).scaled
    (288, 512)
    """
    scale = min(network[0] / source[0], network[1] / source[1])
    height, width = (max(1, min(n, round(s * scale))) for s, n in zip(source, network, strict=True))
    return Fit(source, network, (height, width), ((network[0] - height) // 2, (network[1] - width) // 2))


def to_rgb(frame: av.VideoFrame, rotation: int = 0) -> NDArray[np.uint8]:
    """A decoded frame as ``(H, W, 3) uint8`` RGB, turned ``rotation`` quarter turns counter-clockwise."""
    return _turn(_pixels(frame, _RGB), rotation)


def _pixels(frame: av.VideoFrame, pixel_format: str) -> NDArray[np.uint8]:
    return cast("NDArray[np.uint8]", frame.to_ndarray(format=pixel_format))


def _turn(rgb: NDArray[np.uint8], quarter_turns: int) -> NDArray[np.uint8]:
    return np.ascontiguousarray(np.rot90(rgb, quarter_turns)) if quarter_turns % 4 else rgb


@runtime_checkable
class Pictured(Protocol):
    """A frame of a source: its picture as the decoder gave it, and the quarter turns that bring it upright."""

    @property
    def picture(self) -> av.VideoFrame | NDArray[np.uint8]:
        """The decoder's frame, or (H, W, 3) uint8 RGB."""
        ...

    @property
    def rotation(self) -> int:
        """Quarter turns counter-clockwise."""
        ...


class Letterboxer:
    """Letterboxes pictures to one network size; keeps swscale's tables between calls, so use one for each thread."""

    def __init__(self, network: tuple[int, int]) -> None:
        self.network = network
        self._scaler = VideoReformatter()

    def __call__(self, picture: av.VideoFrame | NDArray[np.uint8], rotation: int = 0) -> tuple[NDArray[np.uint8], Fit]:
        """The picture as the network wants it.

        Args:
            picture: a decoder's frame, or (H, W, 3) uint8 RGB.
            rotation: quarter turns counter-clockwise that bring the picture upright.

        Returns:
            ``(h, w, 3) uint8`` RGB of the network's size, and where the upright picture lies in it.
        """
        if isinstance(picture, np.ndarray):
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format=_RGB)
        sideways = rotation % 2 == 1
        upright = (picture.width, picture.height) if sideways else (picture.height, picture.width)
        placed = fit(upright, self.network)
        height, width = placed.scaled[::-1] if sideways else placed.scaled
        scaled = self._scaler.reformat(
            picture, width=width, height=height, format=_RGB, interpolation=Interpolation.AREA, threads=1
        )
        return self._place(_turn(_pixels(scaled, _RGB), rotation), placed), placed

    def _place(self, scaled: NDArray[np.uint8], placed: Fit) -> NDArray[np.uint8]:
        """The scaled picture on grey; only the bars beside it are filled."""
        canvas = np.empty((*self.network, 3), np.uint8)
        (top, left), (height, width) = placed.offset, placed.scaled
        canvas[:top] = canvas[top + height :] = PADDING_GREY
        canvas[top : top + height, :left] = canvas[top : top + height, left + width :] = PADDING_GREY
        canvas[top : top + height, left : left + width] = scaled
        return canvas
