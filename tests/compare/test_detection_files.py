"""Published detections: MOTChallenge's and UA-DETRAC's text files."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.compare.detection_files import find_detection_file, read_detection_file
from lookonce.errors import ConfigError, FormatError

DETRAC = "1,1,10.5,20,30,40,0.9\n1,2,100,20,30,40,0.25\n3,1,12,20,30,40,0.8\n"
MOT = "3,-1,12,20,30,40,0.8,-1,-1,-1\n1,-1,10.5,20,30,40,0.9,-1,-1,-1\n1,-1,100,20,30,40,0.25,-1,-1,-1\n"


@pytest.mark.parametrize("text", [pytest.param(DETRAC, id="detrac"), pytest.param(MOT, id="mot-in-any-order")])
def test_boxes_are_read_by_frame(tmp_path, text):
    path = tmp_path / "det.txt"
    path.write_text(text)
    found = read_detection_file(path, 4, 7.0)
    assert found.frames.tolist() == [0, 1, 2, 3]
    assert found.starts.tolist() == [0, 2, 2, 3, 3]
    assert found.xyxy[0].tolist() == [10.5, 20, 40.5, 60]
    assert found.scores.tolist() == pytest.approx([0.9, 0.25, 0.8])
    assert found.descriptors is None
    assert found.fps == pytest.approx(7)


def test_scores_that_are_no_shares_keep_their_order(tmp_path):
    path = tmp_path / "det.txt"
    path.write_text("1,1,1,2,3,4,-1.5\n1,2,1,2,3,4,2.5\n2,1,1,2,3,4,0.5\n")
    assert read_detection_file(path, None, None).scores.tolist() == pytest.approx([0, 1, 0.5])


def test_boxes_without_area_are_left_out(tmp_path):
    path = tmp_path / "det.txt"
    path.write_text("1,1,1,2,0,4,0.5\n1,2,1,2,3,4,0.6\n")
    assert read_detection_file(path, None, None).scores.tolist() == pytest.approx([0.6])


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        pytest.param("0,1,1,2,3,4,0.5\n", 1, "from 1", id="frame-0"),
        pytest.param("1,1,1,2,3,4,0.5\n6,1,1,2,3,4,0.5\n", 2, "frames of the sequence", id="beyond-the-end"),
        pytest.param("1,1,1,2,3,4,nan\n", 1, "finite", id="nan"),
        pytest.param("1,1,1,2,-3,4,0.5\n", 1, "0 or more", id="negative"),
        pytest.param("1,1,1,2,3\n", 1, "7 columns", id="columns"),
        pytest.param("1,1,1e9,2,3,4,0.5\n", 1, "within", id="far"),
        pytest.param("", 0, "no detection", id="empty"),
    ],
)
def test_wrong_lines_are_named(tmp_path, text, line, expected):
    path = tmp_path / "det.txt"
    path.write_text(text)
    with pytest.raises(FormatError, match=expected) as caught:
        read_detection_file(path, 5 if text else None, None)
    assert caught.value.line == line


def test_file_of_a_sequence_is_found_in_every_layout(tmp_path):
    for name in ("MVI_1_Det_EB.txt", "b.txt", "c/det/det.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(DETRAC)
    assert find_detection_file(tmp_path, "MVI_1").name == "MVI_1_Det_EB.txt"
    assert find_detection_file(tmp_path, "b").name == "b.txt"
    assert find_detection_file(tmp_path, "c").name == "det.txt"
    assert find_detection_file(tmp_path / "c", "other").name == "det.txt"
    assert find_detection_file(tmp_path / "b.txt", "other").name == "b.txt"


def test_missing_and_double_files_are_named(tmp_path):
    with pytest.raises(ConfigError, match="no detections of sequence MVI_1"):
        find_detection_file(tmp_path, "MVI_1")
    for name in ("EB", "DPM"):
        (tmp_path / f"MVI_1_Det_{name}.txt").write_text(DETRAC)
    with pytest.raises(ConfigError, match="2 files"):
        find_detection_file(tmp_path, "MVI_1")


def test_name_is_no_pattern(tmp_path):
    (tmp_path / "MVI_1_Det_EB.txt").write_text(DETRAC)
    with pytest.raises(ConfigError):
        find_detection_file(tmp_path, "MVI_[1]")


def test_frames_count_up_to_the_last_detection_where_nobody_knows_better(tmp_path):
    path = tmp_path / "det.txt"
    path.write_text(DETRAC)
    assert np.array_equal(read_detection_file(path, None, None).frames, [0, 1, 2])
