"""Detections in, identities out."""

from lookonce.tracking.paper import PaperConfig
from lookonce.tracking.tracker import PRESETS, Tracker

__all__ = ["PRESETS", "PaperConfig", "Tracker"]
