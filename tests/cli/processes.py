"""`lookonce` in processes of its own, as a person runs it: real streams, exit codes and signals."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

__all__ = ["INTERRUPTIBLE", "PLAIN", "Result", "assert_one_line", "lookonce"]

# Where the tests themselves run in the background, SIGINT is ignored, and children inherit that.
INTERRUPTIBLE = [
    sys.executable,
    "-c",
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from lookonce.cli.app import main; main()",
]
PLAIN = {**os.environ, "NO_COLOR": "1", "COLUMNS": "200", "TERM": "dumb"}


class Result(NamedTuple):
    """What a command left."""

    returncode: int
    stdout: str
    stderr: str


def lookonce(*arguments: object, cwd: Path | None = None, columns: int = 200) -> subprocess.CompletedProcess[str]:
    """The command with these arguments, run to its end."""
    command = [sys.executable, "-m", "lookonce", *map(str, arguments)]
    environment = {**PLAIN, "COLUMNS": str(columns)}
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=environment, timeout=120)


def assert_one_line(result: Result | subprocess.CompletedProcess[str], code: int, *parts: str) -> None:
    lines = result.stderr.strip().splitlines()
    assert result.returncode == code, result.stderr
    assert "Traceback" not in result.stderr
    assert len(lines) == 1, result.stderr
    for part in parts:
        assert part in lines[0]
