"""Files of tracks: MOTChallenge text and UA-DETRAC's tables; each fault is named by file and line."""

from __future__ import annotations

import numpy as np
import pytest

from lookonce.datasets import detrac_tracks, read_detrac_results, read_mot_results
from lookonce.datasets.mot_tracks import read_mot_truth
from lookonce.errors import FormatError

GOOD = "1,3,10,20,30.5,40,0.9,-1,-1,-1\n"


def write(folder, text, name="result.txt"):
    path = folder / name
    path.write_text(text)
    return path


def test_rows_come_in_the_order_of_the_file(tmp_path):
    rows = read_mot_results(write(tmp_path, "3,2,0,0,5,5,0.5,-1,-1,-1\n\n" + GOOD))
    assert (rows.frames.tolist(), rows.ids.tolist()) == ([2, 0], [2, 3])
    assert rows.xyxy.tolist() == [[0, 0, 5, 5], [10, 20, 40.5, 60]]
    assert rows.labels.tolist() == [-1, -1]
    assert rows.flags.tolist() == [0.5, 0.9]


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("1 3 10 20 30 40\n", id="blanks"),
        pytest.param("1;3;10;20;30;40\n", id="semicolons"),
        pytest.param("1.0, 3.0, 10, 20, 30, 40\r\n", id="windows-and-spaces"),
        pytest.param("1,3,10,20,30,40,1,2.5,3.5,4.5\n", id="world-coordinates"),
    ],
)
def test_other_ways_to_write_it_are_read(tmp_path, text):
    rows = read_mot_results(write(tmp_path, text))
    assert rows.xyxy.tolist() == [[10, 20, 40, 60]]
    assert (rows.labels.tolist(), rows.flags.tolist()) == ([-1], [1])


def test_empty_file_is_a_result_without_boxes(tmp_path):
    assert len(read_mot_results(write(tmp_path, ""))) == 0
    assert len(read_mot_results(write(tmp_path, "\n\n"))) == 0


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        pytest.param("0,3,1,1,5,5\n", 1, "frames count from 1; add 1 to all of them, got 0", id="from-0"),
        pytest.param(GOOD + "1.5,3,1,1,5,5,1,-1,-1,-1\n", 2, "frame: expected a whole number", id="half-a-frame"),
        pytest.param("1e12,3,1,1,5,5\n", 1, "frame: expected up to 20,000,000", id="far-frame"),
        pytest.param("1,-1,1,1,5,5\n", 1, "id: expected 0 or more; -1 stands for detections", id="detections"),
        pytest.param("1,3.5,1,1,5,5\n", 1, "id: expected a whole number", id="half-an-id"),
        pytest.param("1,3,nan,1,5,5\n", 1, "expected a finite number in column 3", id="nan"),
        pytest.param("1,3,1,1,5,inf\n", 1, "expected a finite number in column 6", id="infinite"),
        pytest.param(GOOD + "1,4,1,1,-5,5,1,-1,-1,-1\n", 2, "width and height: expected 0 or more", id="width"),
        pytest.param("1,4,1,1,5,-5\n", 1, "width and height: expected 0 or more", id="height"),
        pytest.param("1,4,1e9,1,5,5\n", 1, "expected a box within 10,000,000 px", id="far"),
        pytest.param(GOOD + "2" + GOOD[1:] + GOOD, 3, "id 3 a second time in frame 1 .first in line 1.", id="twin"),
        pytest.param(GOOD + "1 4 1 1 5 5\n", 2, "separated by blanks where the lines before have commas", id="mixed"),
        pytest.param(GOOD + "1,4,1,1,5,5\n", 2, "6 columns where the lines before have 10", id="columns"),
        pytest.param("1,3,1,1,5\n", 1, "expected at least 6 columns", id="few-columns"),
        pytest.param("frame,id,x,y,w,h\n" + GOOD, 1, "remove the heading", id="heading"),
    ],
)
def test_faulty_result_is_named_by_line(tmp_path, text, line, message):
    path = write(tmp_path, text)
    with pytest.raises(FormatError, match=message) as caught:
        read_mot_results(path)
    assert (caught.value.path, caught.value.line) == (str(path), line)


def test_missing_file_is_one_clear_error(tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        read_mot_results(tmp_path / "absent.txt")


def test_truth_needs_eight_columns_and_boxes_of_some_size(tmp_path):
    rows = read_mot_truth(write(tmp_path, "1,3,1,1,5,5,0,7,0.5\n"))
    assert (rows.flags.tolist(), rows.labels.tolist()) == ([0], [7])
    with pytest.raises(FormatError, match="at least 8 columns"):
        read_mot_truth(write(tmp_path, "1,3,1,1,5,5\n"))
    with pytest.raises(FormatError, match="width and height: expected above 0"):
        read_mot_truth(write(tmp_path, "1,3,1,1,0,5,1,1,1\n"))


def write_tables(folder, **tables):
    for table in ("LX", "LY", "W", "H"):
        np.savetxt(folder / f"MVI_1_{table}.txt", tables[table], fmt="%.10g", delimiter=",")


def test_tables_of_ua_detrac_become_rows(tmp_path):
    write_tables(
        tmp_path,
        LX=np.array([[10, 0, 5], [11.5, 0, 0]]),
        LY=np.array([[20, 0, 6], [21, 0, 0]]),
        W=np.array([[30, 0, 7], [31, 0, 0]]),
        H=np.array([[40, 0, 8], [41, 0, 0]]),
    )
    rows = read_detrac_results(tmp_path, "MVI_1")
    assert (rows.frames.tolist(), rows.ids.tolist()) == ([0, 0, 1], [1, 3, 1])
    assert rows.xyxy.tolist() == [[10, 20, 40, 60], [5, 6, 12, 14], [11.5, 21, 42.5, 62]]


def test_one_track_or_none_is_read(tmp_path):
    one = np.array([[1.0], [0.0], [3.0]])
    write_tables(tmp_path, LX=one, LY=one, W=one, H=one)
    assert read_detrac_results(tmp_path, "MVI_1").frames.tolist() == [0, 2]
    for table in ("LX", "LY", "W", "H"):
        (tmp_path / f"MVI_1_{table}.txt").write_text("")
    assert len(read_detrac_results(tmp_path, "MVI_1")) == 0


def test_faulty_tables_are_named(tmp_path, monkeypatch):
    good, bad = np.ones((2, 3)), np.array([[1, 2, 3], [1, np.nan, 3]])
    with pytest.raises(FormatError, match=r"MVI_1_LX.txt: no such file"):
        read_detrac_results(tmp_path, "MVI_1")
    write_tables(tmp_path, LX=good, LY=good, W=good[:, :2], H=good)
    with pytest.raises(FormatError, match="2 frames x 3 tracks and 2 frames x 2 tracks"):
        read_detrac_results(tmp_path, "MVI_1")
    write_tables(tmp_path, LX=good, LY=good, W=bad, H=good)
    with pytest.raises(FormatError, match=r"MVI_1_W.txt:2: column 2: expected a number up to 5,000,000, got nan"):
        read_detrac_results(tmp_path, "MVI_1")
    monkeypatch.setattr(detrac_tracks, "_MAX_BYTES", 4)
    with pytest.raises(FormatError, match="larger than"):
        read_detrac_results(tmp_path, "MVI_1")


def test_frame_of_very_many_tracks_is_read(tmp_path):
    wide = np.zeros((2, 9000))
    wide[1, 8999] = 4
    write_tables(tmp_path, LX=wide, LY=wide, W=wide, H=wide)
    assert read_detrac_results(tmp_path, "MVI_1").ids.tolist() == [9000]
