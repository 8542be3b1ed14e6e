"""Fixtures that all tests may use."""

from __future__ import annotations

from pathlib import Path

import pytest

_DATA = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The development data; a test that asks for it is marked ``data``."""
    if not _DATA.is_dir():
        pytest.skip(f"the development data folder {_DATA} is absent")
    return _DATA


@pytest.fixture(scope="session")
def square_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model file that finds coloured squares (see squares.py)."""
    from squares import write_detector

    return write_detector(tmp_path_factory.mktemp("squares"))


@pytest.fixture(scope="session")
def square_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip of three moving squares, 12 frames at 10 fps."""
    from squares import write_clip

    return write_clip(tmp_path_factory.mktemp("clips") / "squares.mp4")
