"""Darknet cfg and weights files as PyTorch networks."""
