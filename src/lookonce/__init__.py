"""Multi-object tracking that looks once: boxes and identities from one pass of the detector."""
