"""Model files that ship inside the package."""
