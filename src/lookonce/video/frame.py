"""One picture of a source, with its place in time."""

from __future__ import annotations

from dataclasses import dataclass

import av
import numpy as np
from numpy.typing import NDArray

from lookonce.letterbox import to_rgb

__all__ = ["Frame"]


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame as the decoder gave it; RGB is made only when somebody asks for it.

    Attributes:
        index: its number in the source, from 0; frames that were skipped are counted.
        time_s: seconds on the container's clock since the source's first frame.
        picture: the decoder's frame in its own pixel format, or (H, W, 3) uint8 RGB.
        rotation: quarter turns counter-clockwise that bring ``picture`` upright.
    """

    index: int
    time_s: float
    picture: av.VideoFrame | NDArray[np.uint8]
    rotation: int = 0

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) in px of the upright picture."""
        if isinstance(self.picture, np.ndarray):
            height, width = self.picture.shape[:2]
        else:
            height, width = self.picture.height, self.picture.width
        return (width, height) if self.rotation % 2 else (height, width)

    @property
    def image(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB, upright, in its true size; converted at each call."""
        if isinstance(self.picture, np.ndarray):
            return np.ascontiguousarray(np.rot90(self.picture, self.rotation))
        return to_rgb(self.picture, self.rotation)
