"""The scene as an iterator of pictures with their truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.datasets import LabelledObjects
from lookonce.synthetic.config import SceneConfig
from lookonce.synthetic.fleet import CLASSES, Fleet
from lookonce.synthetic.rendering import FrameRenderer
from lookonce.synthetic.sensor import Sensor
from lookonce.synthetic.stage import Streams, set_stage
from lookonce.synthetic.traffic import Traffic
from lookonce.synthetic.truth import FrameTruth, assemble_truth

__all__ = ["SyntheticFrame", "SyntheticScene"]


@dataclass(frozen=True, slots=True)
class SyntheticFrame:
    """A picture and what is true of it.

    Attributes:
        index: from 0.
        time_s: seconds since the first frame.
        image: (H, W, 3) uint8 RGB.
        truth: the objects, and what is known of them besides.
    """

    index: int
    time_s: float
    image: NDArray[np.uint8]
    truth: FrameTruth

    @property
    def objects(self) -> LabelledObjects:
        """Boxes, identities, classes and visibility, by rising identity."""
        return self.truth.objects


class SyntheticScene:
    """A traffic scene with exact truth; each iteration starts it anew and gives the same frames.

    Nothing grows with its length. The same settings give the same bytes on the same platform with the same versions of
    NumPy and Pillow.

    Args:
        config: the settings.

    >>> scene = SyntheticScene(SceneConfig(seconds=0.2, height=90, width=160, seed=1))
    >>> [frame.image.shape for frame in scene]
    [(90, 160, 3), (90, 160, 3), (90, 160, 3)]
    """

    def __init__(self, config: SceneConfig | None = None) -> None:
        self.config = config or SceneConfig()
        self._stage = set_stage(self.config, Streams.of(self.config.seed))

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names by label."""
        return CLASSES

    @property
    def ignored(self) -> NDArray[np.float32]:
        """(M, 4) float32, xyxy in px: regions without truth."""
        return self._stage.ignored

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) in px."""
        return self.config.height, self.config.width

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.config.fps

    def __len__(self) -> int:
        return self.config.frames

    def __iter__(self) -> Iterator[SyntheticFrame]:
        config, stage = self.config, self._stage
        streams = Streams.of(config.seed)
        traffic = Traffic(stage.site, Fleet(streams.fleet, config.look_alikes), streams.traffic, config.density)
        renderer, sensor = FrameRenderer(stage, config.exposure_s), Sensor(config, streams.camera)
        groups = sorted({group for _, group in stage.signals})
        for index in range(config.frames):
            time_s = index / config.fps
            if index:
                traffic.advance(time_s - traffic.time_s)
            light = stage.weather.at(time_s)
            states = {group: traffic.signals.state(group, time_s) for group in groups}
            agents = sorted(traffic.agents, key=lambda agent: agent.identity)
            painted = renderer.paint(agents, light, sensor.shift(time_s), states)
            image = sensor.expose(painted.image, light.night)
            yield SyntheticFrame(index, time_s, image, assemble_truth(painted.seen, stage.ignored, config.min_px))
