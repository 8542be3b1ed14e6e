"""Fixtures that all tests may use."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

_DATA = Path(__file__).parents[2] / "shared" / "data"


class TinyModel(NamedTuple):
    """An exported network and what it was made of."""

    cfg: Path
    weights: Path
    path: Path
    size: tuple[int, int] | None


@pytest.fixture
def usual_interrupts() -> Iterator[None]:
    """SIGINT raises KeyboardInterrupt, also where the tests were started in the background and ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


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


@pytest.fixture(scope="session")
def tiny_model(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., TinyModel]:
    """``tiny_model(name)`` exports one of the tiny networks with random weights; each is made once."""
    from darknet_files import TINY, write_network
    from lookonce.make.darknet.importer import import_darknet

    @cache
    def make(name: str, *, descriptors: bool = True, size: tuple[int, int] | None = None) -> TinyModel:
        folder = tmp_path_factory.mktemp("tiny")
        cfg, weights = write_network(folder, TINY[name])
        import_darknet(cfg, weights, folder / "tiny.onnx", size=size, descriptors=descriptors)
        return TinyModel(cfg, weights, folder / "tiny.onnx", size)

    return make
