"""The same bytes whatever the hash seed and the number of threads."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]


def _digest(hash_seed: str, threads: str) -> str:
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    path = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, **dict.fromkeys(names, threads), "PYTHONHASHSEED": hash_seed, "PYTHONPATH": path}
    command = [sys.executable, "-W", "error", str(TESTS / "tracking" / "crowd_digest.py")]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


def test_hash_seed_and_threads_change_nothing():
    first = _digest("1", "1")
    assert int(first.split()[1]) > 150  # there was something to tell apart
    assert _digest("2", "4") == first
