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
