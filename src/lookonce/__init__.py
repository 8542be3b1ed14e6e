"""Multi-object tracking that looks once: boxes and identities from one pass of the detector.

    import lookonce

    for frame in lookonce.track("traffic.mp4", model="model.onnx"):
        for t in frame.tracks:
            print(frame.time_s, t.id, t.name, t.xyxy, t.score)

The parts, for those who bring their own: :func:`open_video` (any source -> frames), :class:`Model` (picture ->
detections with descriptors), :class:`BoxDescriber` (picture and boxes of another detector -> descriptors),
:class:`CameraMotion` (pictures -> how the camera moved), and :class:`Tracker` (detections -> identities), which
:func:`tracker_for` sets up for a model.

Importing the package loads none of its parts; each name is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lookonce.camera import CameraMotion
    from lookonce.errors import (
        ConfigError,
        FormatError,
        LookonceError,
        ModelError,
        OutputError,
        VideoError,
        WeightsError,
    )
    from lookonce.make.given_boxes import BoxDescriber
    from lookonce.model import Model
    from lookonce.pipeline import TrackedFrame, track, tracker_for
    from lookonce.structures import Detections, Track, Tracks
    from lookonce.tracking import DefaultConfig, PaperConfig, Tracker
    from lookonce.video import Frame, open_video

__version__ = "0.1.0"

__all__ = [
    "BoxDescriber",
    "CameraMotion",
    "ConfigError",
    "DefaultConfig",
    "Detections",
    "FormatError",
    "Frame",
    "LookonceError",
    "Model",
    "ModelError",
    "OutputError",
    "PaperConfig",
    "Track",
    "TrackedFrame",
    "Tracker",
    "Tracks",
    "VideoError",
    "WeightsError",
    "__version__",
    "open_video",
    "track",
    "tracker_for",
]

_HOMES = {
    "BoxDescriber": "make.given_boxes",
    "CameraMotion": "camera",
    "ConfigError": "errors",
    "DefaultConfig": "tracking",
    "Detections": "structures",
    "FormatError": "errors",
    "Frame": "video",
    "LookonceError": "errors",
    "Model": "model",
    "ModelError": "errors",
    "OutputError": "errors",
    "PaperConfig": "tracking",
    "Track": "structures",
    "TrackedFrame": "pipeline",
    "Tracker": "tracking",
    "Tracks": "structures",
    "VideoError": "errors",
    "WeightsError": "errors",
    "open_video": "video",
    "track": "pipeline",
    "tracker_for": "pipeline",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'lookonce' has no attribute '{name}'")
    value: object = getattr(import_module(f"lookonce.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
