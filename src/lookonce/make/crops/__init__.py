"""The second network that the package does without: descriptors from cut-out boxes, trained to compare with."""
