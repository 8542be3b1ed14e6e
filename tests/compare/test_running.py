"""Each tracker in a process of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compare.moving import lane, make_sequence
from lookonce.compare.contenders.registry import contenders
from lookonce.compare.detection_store import StoredDetections, write_detections
from lookonce.compare.results import write_results
from lookonce.compare.running import TrackerProcess
from lookonce.datasets import read_mot_results


@pytest.fixture
def detections(tmp_path):
    sequence, _ = make_sequence([lane(0), lane(200)], frames=12, scores=(0.9, 0.2))
    path = tmp_path / "a.npz"
    write_detections(path, StoredDetections(sequence))
    return path, sequence


def test_answers_fit_the_rows_that_were_asked_for(detections):
    path, sequence = detections
    contender = contenders()["iou"]
    with TrackerProcess(contender, 60) as process:
        for every, score in ((1, 0.0), (2, 0.0), (1, 0.5)):
            answer, ids = process.run(path, every, score, ())
            assert answer.error == ""
            assert answer.frames == 12 / every
            chosen = sequence.every(every)
            chosen = chosen.rows(chosen.scores >= score)
            assert np.array_equal(ids, contender.associate(chosen))
            assert answer.seconds > 0
            assert answer.peak_mb == 0 or answer.peak_mb > 10


def test_tracker_that_takes_too_long_is_stopped_and_can_start_again(detections):
    path, _ = detections
    with TrackerProcess(contenders()["iou"], 0.001) as process:
        assert process.run(path, 1, 0.0, ())[0].error == "over 0.001 s"
        assert process.run(path, 1, 0.0, ())[0].error == "over 0.001 s"


def test_tracker_that_fails_says_how(tmp_path):
    """The paper's rule without descriptors raises; the process goes on."""
    sequence, _ = make_sequence([lane(0)])
    bare = tmp_path / "bare.npz"
    write_detections(bare, StoredDetections(replace(sequence, descriptors=None)))
    with TrackerProcess(contenders()["lookonce-paper"], 60) as process:
        answer, ids = process.run(bare, 1, 0.0, ())
        assert answer.error.startswith("ValueError: ")
        assert len(ids) == 0


def test_process_that_ends_says_its_last_words(tmp_path):
    with TrackerProcess(contenders()["iou"], 60) as process:
        answer, _ = process.run(tmp_path / "absent.npz", 1, 0.0, ())
    assert answer.error.startswith("its process ended: ")
    assert "absent.npz" in answer.error


def test_results_are_mot_text_with_ids_from_1(tmp_path):
    sequence, _ = make_sequence([lane(0), lane(100)], frames=4, every=2)
    path = tmp_path / "new" / "a.txt"
    write_results(path, sequence, np.array([0, -1, 0, 3]))
    rows = read_mot_results(path)
    assert rows.frames.tolist() == [0, 2, 2]
    assert rows.ids.tolist() == [1, 1, 4]
    assert np.array_equal(rows.xyxy, sequence.xyxy[[0, 2, 3]])
