"""The process that one tracker runs in: tasks come as lines on stdin, and how they went goes to stdout."""

from __future__ import annotations

import json
import sys
import time
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import TextIO

import numpy as np

from lookonce.compare.contenders.registry import Contender, contenders
from lookonce.compare.detection_store import read_detections
from lookonce.compare.detections import DetectedFrame, DetectedSequence
from lookonce.compare.jobs import Answer, Job
from lookonce.structures import Detections

__all__ = ["serve"]

_STATUS = Path("/proc/self/status")


def serve(contender: Contender, lines: TextIO, answers: TextIO) -> None:
    """Does one task after the other until there are no more lines; loading libraries is not part of any."""
    contender.answer(_warm_up())
    for line in lines:
        answers.write(json.dumps(asdict(_do(contender, Job.of_line(line)))) + "\n")
        answers.flush()


def _do(contender: Contender, job: Job) -> Answer:
    sequence = job.select(read_detections(Path(job.detections)).sequence)
    start, cpu = time.perf_counter(), time.process_time()
    try:
        answer = contender.answer(sequence)
    except Exception as exc:  # noqa: BLE001 - somebody else's tracker may fail in any way, and the others go on
        return Answer(frames=len(sequence.frames), error=f"{type(exc).__name__}: {exc}")
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    answer.save(Path(job.answer))
    return Answer(seconds, cpu, len(sequence.frames), peak_mb())


def _warm_up() -> DetectedSequence:
    """A few frames, so that what a library does at first is not counted."""
    box, look = np.array([[10, 10, 50, 90]], np.float32), np.eye(1, 8, dtype=np.float32)
    found = Detections(box, np.full(1, 0.9, np.float32), np.zeros(1, np.int64), look)
    return DetectedSequence.of_frames([DetectedFrame(index, 0.1 * index, found) for index in range(5)])


def peak_mb() -> float:
    """Largest resident memory of this process in MB; 0 where the system does not tell."""
    try:
        lines = _STATUS.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1000 * 1.024 for line in lines if line.startswith("VmHWM")), 0.0)


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # of the libraries; they have nothing to say to the user of a comparison
    serve(contenders()[sys.argv[1]], sys.stdin, sys.stdout)
