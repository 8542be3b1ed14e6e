"""Training descriptor heads on the frozen detector."""
