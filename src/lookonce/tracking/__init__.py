"""Detections in, identities out."""
