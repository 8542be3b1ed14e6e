"""Exports of the real detectors, made once."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from lookonce.make.darknet.importer import import_darknet


class RealModel(NamedTuple):
    """An exported network at 512 px and what it was made of."""

    cfg: Path
    weights: Path
    path: Path
    size: tuple[int, int]


@pytest.fixture(scope="session")
def real_model(data_folder, tmp_path_factory):
    """``real_model(name)`` exports one of the data folder's detectors; for tests marked ``data``."""

    @cache
    def make(name: str, descriptors: bool = True) -> RealModel:
        cfg, weights = (data_folder / "weights" / f"{name}.{end}" for end in ("cfg", "weights"))
        path = tmp_path_factory.mktemp("real") / f"{name}.onnx"
        import_darknet(cfg, weights, path, size=(512, 512), descriptors=descriptors)
        return RealModel(cfg, weights, path, (512, 512))

    return make
