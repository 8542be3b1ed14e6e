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
            answer, associated = process.run(path, every, score, ())
            assert answer.error == ""
            assert answer.frames == 12 / every
            chosen = sequence.every(every)
            chosen = chosen.rows(chosen.scores >= score)
            assert associated is not None
            assert np.array_equal(associated.ids, contender.answer(chosen).ids)
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
        answer, associated = process.run(bare, 1, 0.0, ())
        assert answer.error.startswith("ValueError: ")
        assert associated is None


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


def test_boxes_that_a_tracker_makes_itself_are_in_the_results(tmp_path):
    """A gap of two frames, in every second frame of a video: our preset fills it, and its twin leaves it open."""
    sequence, _ = make_sequence([lane(0, hidden=(20, 22)), lane(200)], frames=40, every=2)
    path = tmp_path / "a.npz"
    write_detections(path, StoredDetections(sequence))
    written = {}
    for name in ("lookonce-default", "lookonce-detected"):
        with TrackerProcess(contenders()[name], 60) as process:
            answer, associated = process.run(path, 1, 0.0, ())
        assert answer.error == ""
        write_results(tmp_path / f"{name}.txt", sequence, associated)
        written[name] = read_mot_results(tmp_path / f"{name}.txt")
    ours, plain = written["lookonce-default"], written["lookonce-detected"]
    added = ours.flags == 0
    assert sorted(ours.frames[added].tolist()) == [20, 22]
    first = sequence.row_frames == 0
    assert set(ours.ids[added].tolist()) == set(ours.ids[(ours.frames == 18) & (ours.xyxy[:, 1] < 100)].tolist())
    assert (len(plain), len(ours)) == (len(sequence), len(sequence) + 2)
    assert np.allclose(np.sort(plain.xyxy[plain.frames == 0], axis=0), np.sort(sequence.xyxy[first], axis=0))
