"""Trackers held against each other: the same detections for all, each in a process of its own."""
