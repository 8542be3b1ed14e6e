"""Prints the SHA-256 of everything that the tracker says of a crowded scene; run by `test_determinism.py`."""

from __future__ import annotations

import hashlib

import numpy as np

from lookonce.tracking import Tracker
from tracking.moving import crowd

OBJECTS, FRAMES, SIZE = 180, 60, 64


def digest() -> str:
    """Of ids, boxes, and rows that are given back or filled in, of each frame."""
    tracker, sha = Tracker("default"), hashlib.sha256()
    for frame in crowd(OBJECTS, FRAMES, seed=11, area_px=1500.0, size=SIZE):
        answer = tracker.update(frame.rows, frame.time_s, descriptors=frame.looks)
        back, filled = tracker.given_back, tracker.filled
        later = back.frames, back.rows, back.ids, back.xyxy, back.scores, back.labels
        for part in (answer, *later, filled.frames, filled.ids, filled.xyxy, filled.labels):
            sha.update(np.ascontiguousarray(part).tobytes())
    return f"{sha.hexdigest()} {int(answer[:, 6].max())}"


if __name__ == "__main__":
    print(digest())  # noqa: T201
