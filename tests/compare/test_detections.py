"""All detections of a sequence as one value."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.moving import lane, make_sequence, nothing
from lookonce.compare.contenders.registry import contenders
from lookonce.compare.detections import DEFAULT_FPS
from lookonce.compare.jobs import Job, select


def test_every_keeps_frame_numbers_times_and_their_rows():
    sequence, owners = make_sequence([lane(0), lane(100, hidden=(4,))], frames=9)
    thinned = sequence.every(4)
    assert thinned.frames.tolist() == [0, 4, 8]
    assert thinned.times.tolist() == [0.0, 0.4, 0.8]
    assert thinned.starts.tolist() == [0, 2, 3, 5]
    chosen = np.isin(sequence.row_frames, [0, 4, 8])
    assert np.array_equal(thinned.xyxy, sequence.xyxy[chosen])
    assert thinned.descriptors is not None
    assert thinned.descriptors.argmax(axis=1).tolist() == owners[chosen].tolist()
    assert thinned.fps == pytest.approx(2.5)


def test_rows_of_low_score_and_other_classes_go_and_frames_stay():
    sequence, owners = make_sequence([lane(0), lane(100)], frames=3, scores=(0.9, 0.25))
    labelled = replace(sequence, labels=owners)
    assert len(select(labelled, 1, 0.25, ())) == 6  # a score at the threshold is kept
    assert len(select(labelled, 1, 0.26, ())) == 3
    kept = select(labelled, 1, 0.0, (1,))
    assert kept.labels.tolist() == [1, 1, 1]
    assert kept.starts.tolist() == [0, 1, 2, 3]
    assert select(labelled, 1, 1.0, ()).starts.tolist() == [0, 0, 0, 0]


def test_iteration_gives_every_frame_also_empty_ones():
    sequence, _ = make_sequence([lane(0, hidden=(1,))], frames=3)
    assert [(frame.index, len(frame.detections)) for frame in sequence] == [(0, 1), (1, 0), (2, 1)]
    assert [len(frame.detections) for frame in nothing()] == [0, 0, 0]
    assert nothing(1).fps == DEFAULT_FPS


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param({"frames": np.array([0, 0, 1])}, id="frame-twice"),
        pytest.param({"starts": np.array([0, 1, 2, 4])}, id="rows-that-are-not-there"),
        pytest.param({"starts": np.array([0, 2, 1, 3])}, id="falling"),
        pytest.param({"times": np.array([0, 1, np.nan])}, id="no-time"),
        pytest.param({"scores": np.zeros(2, np.float32)}, id="fewer-scores"),
    ],
)
def test_what_cannot_be_is_refused(wrong):
    sequence, _ = make_sequence([lane(0)], frames=3)
    with pytest.raises(ValueError, match="expected"):
        replace(sequence, **wrong)


def test_job_goes_through_a_line():
    job = Job("a b.npz", 2, 0.25, (1, 2), "out.npy")
    assert Job.of_line(job.line()) == job


def test_page_describes_every_tracker():
    page = (Path(__file__).parents[2] / "docs" / "compare.md").read_text(encoding="utf-8")
    names = [name for name in contenders() if not name.startswith("lookonce-")]
    assert [name for name in names if f"`{name}`" not in page] == []
