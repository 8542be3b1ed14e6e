"""The model file: open, check, run."""
