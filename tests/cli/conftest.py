"""A command run as a person would, but within the tests."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator

import pytest

from cli.processes import PLAIN, Result
from lookonce.cli.app import main


@pytest.fixture
def lookonce(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Result]]:
    """``lookonce(...)`` runs the command in this process: PyTorch is imported once for all tests."""
    for name in ("NO_COLOR", "COLUMNS", "TERM"):
        monkeypatch.setenv(name, PLAIN[name])

    def run(*arguments: object) -> Result:
        capfd.readouterr()
        monkeypatch.setattr(sys, "argv", ["lookonce", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            main()
        return Result(exit_.value.code or 0, *capfd.readouterr())

    yield run
    logging.addLevelName(logging.WARNING, "WARNING")
