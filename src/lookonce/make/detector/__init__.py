"""Training of detectors: any network that the import reads, from random weights or from imported ones."""
