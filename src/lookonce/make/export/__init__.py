"""Networks as model files."""
