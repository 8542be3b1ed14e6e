"""Detections in, identities out."""

from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.motion_config import MotionConfig
from lookonce.tracking.objects import EvidenceConfig
from lookonce.tracking.paper import PaperConfig
from lookonce.tracking.tracker import PRESETS, Tracker, TrackerConfig

__all__ = ["PRESETS", "DefaultConfig", "EvidenceConfig", "MotionConfig", "PaperConfig", "Tracker", "TrackerConfig"]
