"""KITTI tracking sequences."""

from __future__ import annotations

from functools import partial

import pytest

from datasets.making import SIZE, refusal, write, write_kitti, write_pictures
from lookonce.datasets import open_sequences
from lookonce.errors import FormatError, VideoError


def row(frame=0, identity=1, kind="Car", occluded=0, box="10 5 30 15", rest=" 1.5 1.6 3.7 -4.5 1.8 13.4 -2.1"):
    return f"{frame} {identity} {kind} 0 {occluded} -1.79 {box}{rest}\n"


def test_rows_become_objects_and_dontcare_is_counted(tmp_path):
    truth = row(kind="Van") + row(0, -1, "DontCare", -1) + row(2, 3, "Car", 2) + row(1, -1, "DontCare", -1)
    (sequence,) = open_sequences(write_kitti(tmp_path, truth))
    assert (sequence.name, sequence.layout, sequence.fps) == ("0000", "kitti", 10.0)
    assert sequence.pictures == tmp_path / "image_02" / "0000"
    assert sequence.classes == ("Car", "Van")
    assert [frame.index for frame in sequence.frames] == [0, 1, 2]
    assert [frame.objects.labels.tolist() for frame in sequence.frames] == [[1], [], [0]]
    assert [frame.objects.identities.tolist() for frame in sequence.frames] == [[1], [], [3]]
    assert sequence.frames[0].objects.xyxy.tolist() == [[10, 5, 30, 15]]
    assert sequence.left_out == {"DontCare": 2}


def test_words_for_occlusion_become_visibility(tmp_path):
    truth = "".join(row(identity=n, occluded=occluded) for n, occluded in enumerate([0, 1, 2, 3, -1]))
    (sequence,) = open_sequences(write_kitti(tmp_path, truth))
    assert sequence.frames[0].objects.visibility.tolist() == pytest.approx([1, 0.6, 0.2, 0, 1])


def test_root_and_its_training_folder_and_one_file_are_found(tmp_path):
    write_kitti(tmp_path / "training", row(kind="Van"), name="0010")
    write_kitti(tmp_path / "training", row(kind="Car"), name="0002")
    both = open_sequences(tmp_path)
    assert [sequence.name for sequence in both] == ["0002", "0010"]
    assert both[0].classes == both[1].classes == ("Car", "Van")
    assert both[1].frames[0].objects.labels.tolist() == [1]
    assert len(open_sequences(tmp_path / "training")) == 2
    (one,) = open_sequences(tmp_path / "training" / "label_02" / "0010.txt")
    assert one.name == "0010"


@pytest.mark.parametrize(
    ("truth", "line", "message"),
    [
        pytest.param("0 1 Car 0 0 0 1 1 9\n", 1, "expected at least 10 columns separated by blanks", id="few"),
        pytest.param("0,1,Car,0,0,0,1,1,9,9\n", 1, "expected at least 10 columns separated by blanks", id="commas"),
        pytest.param(row() + row("x"), 2, "frame: expected a number, got 'x'", id="word"),
        pytest.param(row("0.5"), 1, "frame: expected a whole number, got '0.5'", id="half"),
        pytest.param(row(-1), 1, "frames count from 0; expected 0 or more, got -1", id="negative-frame"),
        pytest.param(row(identity="nan"), 1, "id: expected a whole number, got 'nan'", id="nan-id"),
        pytest.param(row(box="10 5 nan 15"), 1, "expected finite numbers", id="nan-box"),
        pytest.param(row(box="10 5 x 15"), 1, "box: expected a number, got 'x'", id="word-in-box"),
        pytest.param(row(box="10 5 10 15"), 1, "expected width and height above 0, got 0 x 10", id="no-width"),
        pytest.param(row(occluded=7), 1, "occluded: expected 0, 1, 2 or 3, got 7", id="occluded"),
        pytest.param(row(kind="\x1b[1m"), 1, "expected a class name", id="control-characters"),
        pytest.param(row() + row(1) + row(), 3, "identity 1 a second time in frame 0 (first in line 1)", id="twice"),
        pytest.param("", 0, "no object in it", id="empty"),
        pytest.param(row(0, -1, "DontCare", -1), 0, "no object is left (left out: 1 DontCare)", id="dontcare-only"),
        pytest.param(row(identity=-1), 0, "no object is left (left out: 1 no identity)", id="no-identity"),
    ],
)
def test_bad_truth_is_one_line_that_names_file_and_line(tmp_path, truth, line, message):
    said = refusal(FormatError, partial(open_sequences, write_kitti(tmp_path, truth)))
    path = tmp_path / "label_02" / "0000.txt"
    assert said.startswith(f"{path}:{line}: " if line else f"{path}: ")
    assert message in said


def test_pictures_that_start_with_1_are_refused(tmp_path):
    """``open_video`` calls the first of them frame 0, so that boxes would lie on the wrong pictures."""
    root = write_kitti(tmp_path, row(), start=1)
    assert "000001.png: the pictures must start with number 0" in refusal(VideoError, partial(open_sequences, root))


def test_missing_pictures_are_named(tmp_path):
    root = write_kitti(tmp_path, row(3))
    assert "0000: no picture of frame 3, see" in refusal(VideoError, partial(open_sequences, root))
    root = write_kitti(tmp_path / "b", row(), pictures=0)
    assert "image_02/0000: no such pictures for" in refusal(VideoError, partial(open_sequences, root))


def test_pictures_elsewhere_are_taken(tmp_path):
    root = write_kitti(tmp_path / "a", row(), pictures=0)
    pictures = write_pictures(tmp_path / "b", ["000000.png"], SIZE)
    write(tmp_path / "b" / "notes.txt", "")
    (sequence,) = open_sequences(root, pictures=pictures)
    assert sequence.pictures == pictures
