"""Descriptor heads: what they read of the detector's features, and what they make of it."""
