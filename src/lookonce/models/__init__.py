"""Model files that ship inside the package, found by name."""

from __future__ import annotations

import os
from pathlib import Path

from lookonce.errors import ModelError

__all__ = ["find_model", "shipped_models"]


def shipped_models() -> dict[str, Path]:
    """Name and path of each model file inside the package, by name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.onnx"))}


def find_model(model: str | os.PathLike[str]) -> Path:
    """The model file that is meant: a path, or the name of a shipped model.

    Raises:
        ModelError: there is no such file or name.
    """
    path = Path(model)
    if path.exists():
        return path
    shipped = shipped_models()
    if str(model) in shipped:
        return shipped[str(model)]
    known = f" (or one of {', '.join(shipped)})" if shipped else ""
    raise ModelError(f"{path}: no such model file; give a path{known}, or make one with 'lookonce import'")
