"""Model files that ship inside the package, found by name; and detectors that can be had from elsewhere."""

from __future__ import annotations

import os
from pathlib import Path

from lookonce.errors import ModelError
from lookonce.models.registry import known_models

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
    shipped = shipped_models()
    is_shipped = str(model) in shipped
    if path.exists() and not (is_shipped and path.is_dir()):  # somebody's folder may be called "street", too
        return path
    if is_shipped:
        return shipped[str(model)]
    if str(model) in known_models():
        raise ModelError(f"{path}: no such model file; get it with 'lookonce models get {path}', then name {path}.onnx")
    choice = f" (or one of {', '.join(shipped)})" if shipped else ""
    raise ModelError(f"{path}: no such model file; give a path{choice}, or make one with 'lookonce import'")
