from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lookonce.datasets.detections import read_detections
from lookonce.errors import ConfigError, FormatError
from lookonce.video import Frame


def write(folder: Path, text: str, name: str = "det.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def write_jsonl(folder: Path, *frames: dict) -> Path:
    header = {"format": "lookonce-tracks", "format_version": 1}
    return write(folder, "".join(json.dumps(line) + "\n" for line in (header, *frames)), "tracks.jsonl")


def test_mot_detections_are_read_frame_by_frame(tmp_path: Path) -> None:
    path = write(
        tmp_path, "1,-1,10,20,30,40,0.9,-1,-1,-1\n1,-1,50,60,10,10,0.5,-1,-1,-1\n4,-1,11.5,20,30,40,0.8,-1,-1,-1\n"
    )
    found = read_detections(path)
    assert found.frame(0).xyxy.tolist() == [[10, 20, 40, 60], [50, 60, 60, 70]]
    assert found.frame(0).scores.tolist() == pytest.approx([0.9, 0.5])
    assert [len(found.frame(index)) for index in range(-1, 7)] == [0, 2, 0, 0, 1, 0, 0, 0]
    assert found.frame(3).descriptors is None
    assert (found.first_frame, found.last_frame, len(found), found.names) == (0, 3, 3, ("object",))
    assert found.left_out == {}
    assert found.score_range is None


def test_ua_detracs_detections_count_their_rows_in_the_second_column(tmp_path: Path) -> None:
    found = read_detections(
        write(tmp_path, "1,1,592.75,378.8,160.05,162.2,0.99918\n1,2,557,120,48,56,0.99\n2,1,5,5,9,9,0.2\n")
    )
    assert [len(found.frame(index)) for index in (0, 1)] == [2, 1]


def test_a_frame_of_a_video_gets_the_rows_of_its_number(tmp_path: Path) -> None:
    found = read_detections(write(tmp_path, "3,-1,0,0,5,5,0.5\n"))
    picture = np.zeros((9, 9, 3), np.uint8)
    assert len(found.detect(Frame(2, 0.1, picture))) == 1
    assert len(found.detect(Frame(1, 0.1, picture))) == 0


def test_frames_in_any_order_keep_the_files_order_within_a_frame(tmp_path: Path) -> None:
    found = read_detections(write(tmp_path, "2,-1,1,0,5,5\n1,-1,2,0,5,5\n2,-1,3,0,5,5\n1,-1,4,0,5,5\n2,-1,1,0,5,5\n"))
    assert found.frame(0).xyxy[:, 0].tolist() == [2, 4]
    assert found.frame(1).xyxy[:, 0].tolist() == [1, 3, 1]  # a double is a detection too
    assert found.frame(1).scores.tolist() == [1, 1, 1]


def test_rows_that_cannot_be_are_left_out_and_counted(tmp_path: Path) -> None:
    text = (
        "1,-1,1,1,5,5,0.5\n1,-1,nan,1,5,5,0.5\n1,-1,1,1,5,5,nan\n1,-1,1,1,-5,5,0.5\n1,-1,1,1,5,0,0.5\n"
        "2,-1,1,1,inf,5,0.5\n2,-1,1e9,1,5,5,0.5\n2,-1,9999999,1,1e-4,5,0.5\n3,-1,1e308,1,1e308,5,0.5\n"
    )
    found = read_detections(write(tmp_path, text))
    assert len(found) == 1
    assert found.left_out == {
        "with a number that is not finite": 4,
        "of zero or negative size": 3,
        "farther out than 10,000,000 px": 1,
    }


@pytest.mark.parametrize(
    ("text", "expected", "score_range"),
    [
        pytest.param("0.0 0.5 1.0", [0, 0.5, 1], None, id="within"),
        pytest.param("34.2 -5.8 14.2", [1, 0, 0.5], (-5.8, 34.2), id="MOT15"),
        pytest.param("99 99 99", [1, 1, 1], (99, 99), id="equal"),
        pytest.param("-1 -1 -1", [1, 1, 1], (-1, -1), id="all minus one"),
        pytest.param("-1e308 1e308 0", [0, 1, 0.5], (-1e308, 1e308), id="huge"),
    ],
)
def test_scores_outside_0_to_1_are_mapped(tmp_path, text, expected, score_range) -> None:
    rows = "".join(f"{frame},-1,0,0,5,5,{score}\n" for frame, score in enumerate(text.split(), 1))
    found = read_detections(write(tmp_path, rows))
    assert found.rows.scores.tolist() == pytest.approx(expected)
    assert found.score_range == score_range


def test_weak_detections_can_be_left_out(tmp_path: Path) -> None:
    found = read_detections(write(tmp_path, "1,-1,0,0,5,5,0.25\n1,-1,0,0,6,6,0.3\n2,-1,0,0,5,5,0.1\n")).above(0.25)
    assert [len(found.frame(index)) for index in (0, 1)] == [1, 0]
    assert found.last_frame == 0


def test_an_eighth_column_of_whole_numbers_is_the_class(tmp_path: Path) -> None:
    found = read_detections(write(tmp_path, "1,-1,0,0,5,5,0.5,3\n1,-1,0,0,6,6,0.5,0\n"))
    assert found.rows.labels.tolist() == [3, 0]
    assert found.names == ()
    assert found.labels_of(["3"]).tolist() == [3]
    with pytest.raises(ConfigError, match=r"'car'.*numbers"):
        found.labels_of(["car"])
    world = read_detections(write(tmp_path, "1,-1,0,0,5,5,0.5,3.5,1,0\n1,-1,0,0,6,6,0.5,-1,-1,-1\n"))
    assert world.rows.labels.tolist() == [0, 0]
    assert world.labels_of(["object"]).tolist() == [0]


def test_a_few_rows_without_a_class_are_said(tmp_path: Path, caplog) -> None:
    rows = "1,-1,0,0,5,5,0.5,3\n1,-1,0,0,6,6,0.5,0\n1,-1,0,0,6,7,0.5,-1\n"
    assert read_detections(write(tmp_path, rows)).rows.labels.tolist() == [0, 0, 0]
    (said,) = [record.getMessage() for record in caplog.records]
    assert "the eighth column is no class in 1 of 3 rows" in said


def test_our_own_results_are_detections_with_class_names(tmp_path: Path) -> None:
    box = {"label": 7, "score": 0.5}
    path = write_jsonl(
        tmp_path,
        {"frame": 5, "tracks": [{"id": 1, "name": "car", "xyxy": [0, 0, 5, 5], **box}]},
        {"frame": 2, "tracks": [{"id": 1, "name": "bus", "xyxy": [1, 0, 5, 5], **box}]},
        {"frame": 3, "tracks": [{"id": 1, "name": "bus", "xyxy": [5, 0, 5, 5], **box}]},
        {"frame": 9, "tracks": []},
    )
    found = read_detections(path)
    assert found.names == ("car", "bus")
    assert found.frame(5).labels.tolist() == [0]
    assert found.frame(2).labels.tolist() == [1]
    assert (found.first_frame, found.last_frame) == (2, 5)
    assert found.left_out == {"of zero or negative size": 1}
    assert found.labels_of(["bus", "0"]).tolist() == [0, 1]
    with pytest.raises(ConfigError, match="it has car, bus"):
        found.labels_of(["tram"])


def test_boxes_that_had_no_identity_are_detections_all_the_same(tmp_path: Path) -> None:
    box = {"id": None, "name": "car", "label": 0, "xyxy": [0, 0, 5, 5], "score": 0.5}
    given_back = [{**box, "id": 3, "frame": 0}]
    path = write_jsonl(
        tmp_path, {"frame": 0, "tracks": [box, box]}, {"frame": 1, "tracks": [], "given_back": given_back}
    )
    found = read_detections(path)
    assert len(found.frame(0)) == 2
    assert len(found.frame(1)) == 0
    assert found.left_out == {}


def test_an_empty_file_holds_no_detections(tmp_path: Path) -> None:
    found = read_detections(write(tmp_path, ""))
    assert (len(found), found.first_frame, found.last_frame) == (0, None, None)
    assert len(found.frame(0)) == 0
    assert len(found.sha256) == 64


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("0,-1,1,1,5,5\n", r"det\.txt:1: frame: frames count from 1; add 1", id="from zero"),
        pytest.param("1,-1,1,1,5,5\n1.5,-1,1,1,5,5\n", r"det\.txt:2: frame: expected a whole", id="fraction"),
        pytest.param("nan,-1,1,1,5,5\n", r"det\.txt:1: frame: expected a finite", id="nan"),
        pytest.param("1e17,-1,1,1,5,5\n", r"det\.txt:1: frame", id="huge"),
        pytest.param("1,-1,1,1,5\n", r"det\.txt:1: expected at least 6 columns", id="few columns"),
        pytest.param("1,-1,1,1,5,5\n1,-1,1,1,5,x\n", r"det\.txt:2: expected a number in column 6", id="word"),
        pytest.param("1,-1,1,1,5,5\n1,-1,1,1,5,5,0.5\n", r"det\.txt:2: 7 columns", id="ragged"),
        pytest.param("\0", "binary", id="binary"),
    ],
)
def test_files_that_break_the_format_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        read_detections(write(tmp_path, text))


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    for path in (tmp_path / "none.txt", tmp_path):
        with pytest.raises(FormatError, match="no such file"):
            read_detections(path)


@pytest.mark.data
def test_the_public_detections_of_pets_are_all_read(data_folder: Path) -> None:
    path = data_folder / "sequences" / "PETS09-S2L1" / "det" / "det.txt"
    found = read_detections(path)
    assert len(found) == len(path.read_text().splitlines())
    assert found.left_out == {}
    assert (found.first_frame, found.last_frame) == (0, 794)
