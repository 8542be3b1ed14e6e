"""Runs each tracker in a process of its own, with a time limit for each task."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from lookonce.compare.associated import Associated
from lookonce.compare.contenders.registry import Contender
from lookonce.compare.jobs import Answer, Job
from lookonce.video.opening import one_line

__all__ = ["TrackerProcess"]

_LAST_BYTES = 2000
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class TrackerProcess:
    """One tracker; its process starts with the first task, and again after one that took too long.

    Args:
        contender: the tracker.
        limit_s: seconds that a task may take.
    """

    def __init__(self, contender: Contender, limit_s: float) -> None:
        self.contender = contender
        self._limit_s = limit_s
        self._process: subprocess.Popen[str] | None = None
        self._lines: queue.Queue[str] = queue.Queue()
        self._folder = tempfile.TemporaryDirectory(prefix="lookonce-compare-")
        self._errors = tempfile.TemporaryFile()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()
        self._errors.close()
        self._folder.cleanup()

    def run(
        self, detections: Path, every: int, min_score: float, labels: tuple[int, ...]
    ) -> tuple[Answer, Associated | None]:
        """How the task went, and the answer for the rows that ``select`` gives; None where it failed."""
        path = Path(self._folder.name) / "answer.npz"
        job = Job(str(detections.absolute()), every, min_score, labels, str(path))
        answer = self._ask(job)
        return answer, None if answer.error else Associated.load(path)

    def _ask(self, job: Job) -> Answer:
        process = self._process or self._start()
        assert process.stdin is not None
        try:
            process.stdin.write(job.line() + "\n")
            process.stdin.flush()
            line = self._lines.get(timeout=self._limit_s)
        except queue.Empty:
            self._stop()
            return Answer(error=f"over {self._limit_s:g} s")
        except OSError:
            line = ""
        if not line:
            self._stop()
            return Answer(error=f"its process ended{self._last_words()}")
        return Answer(**json.loads(line))

    def _last_words(self) -> str:
        """The last line that the process has left on stderr."""
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - _LAST_BYTES))
        lines = self._errors.read().decode("utf-8", errors="replace").strip().splitlines()
        return f": {one_line(lines[-1][:200])}" if lines else ""

    def _start(self) -> subprocess.Popen[str]:
        environment = {**os.environ, **dict.fromkeys(_ONE_THREAD, "1")}
        process = subprocess.Popen(
            [sys.executable, "-m", "lookonce.compare.worker", self.contender.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            env=environment,
        )
        self._process, self._lines = process, queue.Queue()
        threading.Thread(target=_read, args=(process, self._lines), daemon=True).start()
        return process

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
        self._process = None


def _read(process: subprocess.Popen[str], lines: queue.Queue[str]) -> None:
    """Passes the answers on; an empty line says that there are no more."""
    assert process.stdout is not None
    try:
        for line in process.stdout:
            lines.put(line)
    except (OSError, ValueError):  # closed while reading
        pass
    lines.put("")
