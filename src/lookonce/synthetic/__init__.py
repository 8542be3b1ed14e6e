"""A rendered traffic scene with exact truth: vehicles and people as solid bodies, seen by a camera on a pole."""

from lookonce.synthetic.config import LIGHTS, PLACES, SceneConfig
from lookonce.synthetic.scene import SyntheticFrame, SyntheticScene
from lookonce.synthetic.truth import FrameTruth
from lookonce.synthetic.writing import WRITE_LAYOUTS, WriteOptions, WrittenScene, write_scene

__all__ = [
    "LIGHTS",
    "PLACES",
    "WRITE_LAYOUTS",
    "FrameTruth",
    "SceneConfig",
    "SyntheticFrame",
    "SyntheticScene",
    "WriteOptions",
    "WrittenScene",
    "write_scene",
]
