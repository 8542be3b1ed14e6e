from pathlib import Path

import numpy as np
import pytest

from lookonce.errors import OutputError
from lookonce.output import MotSink
from output.scenes import make_frame, make_tracks


def _written(path: Path, *frames_and_tracks) -> str:
    with MotSink(path) as sink:
        for frame, tracks in frames_and_tracks:
            sink.write(frame, tracks)
    return path.read_bytes().decode()


@pytest.mark.parametrize(
    ("tracks", "expected"),
    [
        pytest.param(
            make_tracks([7], [[10, 20, 40, 60.5]], [0.87654]),
            "1,7,10.00,20.00,30.00,40.50,0.8765,-1,-1,-1\n",
            id="one box as left, top, width, height",
        ),
        pytest.param(
            make_tracks([2, 1], [[0, 0, 1, 1], [2, 2, 3, 4]]),
            "1,2,0.00,0.00,1.00,1.00,0.5000,-1,-1,-1\n1,1,2.00,2.00,1.00,2.00,0.5000,-1,-1,-1\n",
            id="two boxes in row order",
        ),
        pytest.param(make_tracks([-1, 3], [[0, 0, 1, 1]] * 2), "1,3,0.00,0.00,1.00,1.00,0.5000,-1,-1,-1\n", id="no id"),
        pytest.param(make_tracks([0], [[0, 0, 1, 1]]), "", id="ids count from 1"),
        pytest.param(make_tracks(), "", id="no rows"),
        pytest.param(make_tracks([1, 2], [[0, 0, np.nan, 1], [0, 0, 1, 1]], [0.5, np.nan]), "", id="not finite"),
        pytest.param(make_tracks(unseen=[(5, [0, 0, 1, 1])]), "", id="unseen are no results"),
    ],
)
def test_rows_with_identity_become_lines(tmp_path, tracks, expected):
    assert _written(tmp_path / "r.txt", (make_frame(), tracks)) == expected


def test_frames_count_from_one_and_keep_their_gaps(tmp_path):
    tracks = make_tracks([1], [[0, 0, 1, 1]])
    text = _written(tmp_path / "r.txt", (make_frame(0), tracks), (make_frame(4), tracks))
    assert [line.split(",")[0] for line in text.splitlines()] == ["1", "5"]


def test_file_is_whole_after_each_frame_without_closing(tmp_path):
    path = tmp_path / "r.txt"
    sink = MotSink(path)
    for index in range(3):
        sink.write(make_frame(index), make_tracks([1, 2], [[0, 0, 1, 1]] * 2))
        lines = path.read_text().split("\n")
        assert len(lines) == 2 * (index + 1) + 1
        assert lines[-1] == ""
    sink.close()


def test_closing_twice_is_fine(tmp_path):
    sink = MotSink(tmp_path / "r.txt")
    sink.close()
    sink.close()


def test_arguments_are_not_modified(tmp_path):
    tracks = make_tracks([1], [[10, 20, 30, 40]])
    _written(tmp_path / "r.txt", (make_frame(), tracks))
    assert tracks.xyxy.tolist() == [[10, 20, 30, 40]]


def test_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(OutputError, match=r"nowhere/r\.txt: cannot be created"):
        MotSink(tmp_path / "nowhere" / "r.txt")
