"""MOTChallenge and CVAT sequences."""

from __future__ import annotations

from functools import partial

import pytest

from datasets.making import refusal, write, write_mot, write_picture, write_pictures
from lookonce import open_video
from lookonce.datasets import open_sequences
from lookonce.errors import FormatError, LookonceError, VideoError

ROW = "1,7,10,5,20,10"


def read_one(folder, **options):
    (sequence,) = open_sequences(folder, **options)
    return sequence


def boxes(sequence):
    return [frame.objects.xyxy.tolist() for frame in sequence.frames]


@pytest.mark.parametrize(
    ("truth", "classes", "visibility"),
    [
        pytest.param("1,7,10,5,20,10\n", ("object",), 1, id="6-columns"),
        pytest.param("1,7,10,5,20,10,1\n", ("object",), 1, id="7-columns"),
        pytest.param("1,7,10,5,20,10,1,3\n", ("class 3",), 1, id="8-columns"),
        pytest.param("1,7,10,5,20,10,1,3,0.25\n", ("class 3",), 0.25, id="9-columns"),
        pytest.param("1,7,10,5,20,10,1,3,0.25,-1\n", ("class 3",), 0.25, id="10-columns"),
        pytest.param("1,7,10,5,20,10,1,3,0.25,-1,0,0\n", ("class 3",), 0.25, id="12-columns"),
        pytest.param("1,7,10,5,20,10,1,-1,-1,-1\n", ("object",), 1, id="no-class"),
        pytest.param("1,7,10,5,20,10,1,-1,0.5\n", ("object",), 0.5, id="no-class-but-visibility"),
        pytest.param("1,7,10,5,20,10,1,-5.19,0.43,0\n", ("object",), 1, id="world-coordinates"),
        pytest.param("1.0,7.0,10,5,20,10,1,3.0,2\n", ("class 3",), 1, id="visibility-out-of-range"),
        pytest.param("1 7 10 5 20 10\n", ("object",), 1, id="blanks"),
        pytest.param("1\t7\t10\t5\t20\t10\n", ("object",), 1, id="tabs"),
        pytest.param("1;7;10;5;20;10\n", ("object",), 1, id="semicolons"),
    ],
)
def test_columns_are_understood(tmp_path, truth, classes, visibility):
    sequence = read_one(write_mot(tmp_path / "a", truth))
    (frame,) = sequence.frames
    assert (sequence.name, sequence.layout, sequence.fps) == ("a", "motchallenge", None)
    assert sequence.classes == classes
    assert frame.index == 0
    assert frame.objects.xyxy.tolist() == [[10, 5, 30, 15]]
    assert frame.objects.identities.tolist() == [7]
    assert frame.objects.labels.tolist() == [0]
    assert frame.objects.visibility.tolist() == [visibility]
    assert sequence.left_out == {}


def test_frames_are_those_with_truth_by_index_and_rows_keep_their_order(tmp_path):
    sequence = read_one(write_mot(tmp_path / "a", "3,2,1,1,9,9\n1,5,1,1,9,9\n3,1,2,2,9,9\n"))
    assert [frame.index for frame in sequence.frames] == [0, 2]
    assert sequence.frames[1].objects.identities.tolist() == [2, 1]


def test_boxes_are_cut_at_the_border_and_those_outside_left_out(tmp_path):
    sequence = read_one(write_mot(tmp_path / "a", "1,1,-5,-5,20,10\n1,2,60,40,20,20\n1,3,64,0,5,5\n2,4,-9,0,5,5\n"))
    assert boxes(sequence) == [[[0, 0, 15, 5], [60, 40, 64, 48]], []]
    assert sequence.left_out == {"outside the picture": 2}


def test_rows_marked_as_ignored_and_without_identity_are_left_out_and_counted(tmp_path):
    sequence = read_one(write_mot(tmp_path / "a", "1,1,1,1,9,9,1\n2,1,1,1,9,9,0\n2,1,1,1,9,9,0\n3,-1,1,1,9,9,1\n"))
    assert sequence.left_out == {"marked as ignored": 2, "no identity": 1}
    assert [len(frame.objects) for frame in sequence.frames] == [1, 0, 0]


def test_benchmark_classes_are_recognised_by_what_is_considered(tmp_path):
    truth = "1,1,1,1,9,9,1,1,1\n1,2,1,1,9,9,0,8,1\n1,3,1,1,9,9,0,12,1\n1,4,1,1,9,9,0,7,1\n2,2,1,1,9,9,0,8,1\n"
    sequence = read_one(write_mot(tmp_path / "a", truth))
    assert sequence.classes[0] == "pedestrian"
    assert sequence.classes[6] == "static person"
    assert len(sequence.classes) == 7
    assert sequence.left_out == {
        "no pedestrian (class 8: distractor)": 2,
        "no pedestrian (class 12: reflection)": 1,
        "marked as ignored": 1,
    }


def test_benchmark_classes_are_recognised_by_the_folder_name(tmp_path):
    sequence = read_one(write_mot(tmp_path / "MOT17-02-DPM", "1,1,1,1,9,9,1,3,1\n1,2,1,1,9,9,1,8,1\n"))
    assert sequence.classes[sequence.frames[0].objects.labels[0]] == "car"
    assert sequence.left_out == {"no pedestrian (class 8: distractor)": 1}


def test_other_class_numbers_are_named_by_number(tmp_path):
    sequence = read_one(write_mot(tmp_path / "a", "1,1,1,1,9,9,1,12,1\n1,2,1,1,9,9,1,0,1\n1,3,1,1,9,9,0,5,1\n"))
    assert sequence.classes == ("class 0", "class 12")
    assert sequence.frames[0].objects.labels.tolist() == [1, 0]


def test_cvat_export_has_its_class_names(tmp_path):
    folder = write_mot(tmp_path / "a", "1,1,1,1,9,9,1,2,0.5\n1,2,1,1,9,9,0,1,1\n")
    write(folder / "gt" / "labels.txt", "person\ncar\n")
    sequence = read_one(folder)
    assert (sequence.layout, sequence.classes) == ("cvat", ("person", "car"))
    assert sequence.frames[0].objects.labels.tolist() == [1]
    assert sequence.left_out == {"marked as ignored": 1}


def test_seqinfo_says_rate_size_and_folder(tmp_path):
    folder = write_mot(tmp_path / "a", ROW, pictures=0)
    write_pictures(folder / "shots", ["000001.png"])
    write(folder / "seqinfo.ini", "[Sequence]\nname=x\nimDir=shots\nframeRate=12.5\nimWidth=64\nimHeight=48\n")
    sequence = read_one(folder)
    assert (sequence.pictures, sequence.fps) == (folder / "shots", 12.5)


def test_ignored_regions_are_read_and_cut(tmp_path):
    folder = write_mot(tmp_path / "a", ROW)
    write(folder / "ignore.txt", "0,0,320,10\n5,20,7,8\n500,0,5,5\n")
    assert read_one(folder).ignored.tolist() == [[0, 0, 64, 10], [5, 20, 12, 28]]


def test_pictures_may_lie_in_the_folder_itself(tmp_path):
    folder = write_mot(tmp_path / "a", ROW, pictures=0)
    write_pictures(folder, ["000001.png", "000002.png"])
    assert read_one(folder).pictures == folder


def test_frames_meet_their_pictures_where_pictures_are_missing(tmp_path):
    folder = write_mot(tmp_path / "a", "3,1,1,1,9,9\n", pictures=0)
    write_pictures(folder / "img1", ["000002.png", "000003.png"])
    sequence = read_one(folder)
    assert [frame.index for frame in open_video(sequence.pictures)] == [1, 2]
    assert sequence.frames[0].index == 2


@pytest.mark.parametrize(
    ("truth", "line", "message"),
    [
        pytest.param("1,1,1,1,nan,9\n", 1, "expected a finite number in column 5, got nan", id="nan"),
        pytest.param(f"{ROW}\n1,2,inf,1,9,9\n", 2, "expected a finite number in column 3, got inf", id="infinity"),
        pytest.param(f"{ROW}\n1,2,1,1,0,9\n", 2, "expected width and height above 0, got 0 x 9", id="no-width"),
        pytest.param("1,1,1,1,9,-4\n", 1, "expected width and height above 0, got 9 x -4", id="negative-height"),
        pytest.param("1,1,1e300,1,9,9\n", 1, "expected finite numbers up to 10,000,000 px", id="far-away"),
        pytest.param(
            f"{ROW}\n\n2,1,1,1,9,9\n{ROW}\n", 4, "identity 7 a second time in frame 1 (first in line 1)", id="2"
        ),
        pytest.param("0,1,1,1,9,9\n", 1, "frames count from 1; expected 1 or more, got 0", id="frame-0"),
        pytest.param("-3,1,1,1,9,9\n", 1, "frames count from 1; expected 1 or more, got -3", id="negative-frame"),
        pytest.param("1.5,1,1,1,9,9\n", 1, "frame: expected a whole number, got 1.5", id="half-a-frame"),
        pytest.param("1,1.5,1,1,9,9\n", 1, "id: expected a whole number, got 1.5", id="half-an-id"),
        pytest.param("1,1e30,1,1,9,9\n", 1, "id: expected a whole number, got 1e+30", id="endless-id"),
        pytest.param("1,1,1,1,9\n", 1, "expected at least 6 columns (frame, id, left, top, width, height)", id="few"),
        pytest.param("1,1,1,1,9,9,1,2.5\n", 1, "class: expected a whole number from 0", id="half-a-class"),
        pytest.param("1,1,1,1,9,9\n2 1 1 1 9 9\n", 2, "use one separator throughout", id="mixed-separators"),
        pytest.param("1,-1,1,1,9,9\n2,-1,1,1,9,9\n", 0, "every id is -1: these are detections, not truth", id="det"),
        pytest.param("", 0, "no object in it", id="empty"),
        pytest.param("1,1,1,1,9,9,0\n", 0, "no object is left (left out: 1 marked as ignored)", id="all-ignored"),
        pytest.param("1,1,99,1,9,9,1\n", 0, "no object is left (left out: 1 outside the picture)", id="all-outside"),
        pytest.param(b"\x00\x01", 0, "binary or UTF-16", id="binary"),
        pytest.param(b"1,1,\xe9", 1, "not UTF-8 text", id="latin-1"),
    ],
)
def test_bad_truth_is_one_line_that_names_file_and_line(tmp_path, truth, line, message):
    folder = write_mot(tmp_path / "a", truth)
    said = refusal(FormatError, partial(open_sequences, folder))
    assert said.startswith(f"{folder}/gt/gt.txt:{line}: " if line else f"{folder}/gt/gt.txt: ")
    assert message in said


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        pytest.param("seqinfo.ini", "frameRate=3", "seqinfo.ini:1: expected [Sequence]", id="no-section"),
        pytest.param("seqinfo.ini", "[Sequence]\nframeRate=fast", "framerate: expected a number above 0", id="rate"),
        pytest.param("seqinfo.ini", "[Sequence]\nimWidth=0\n", "imwidth: expected a number above 0", id="width"),
        pytest.param("seqinfo.ini", "[Sequence]\nimDir=../b", "imDir ../b lies outside the folder", id="outside"),
        pytest.param("seqinfo.ini", "[Sequence]\nimDir=/etc", "imDir /etc lies outside the folder", id="absolute"),
        pytest.param("seqinfo.ini", "[Sequence]\nimDir=link", "imDir link lies outside the folder", id="link"),
        pytest.param(
            "seqinfo.ini",
            "[Sequence]\nimWidth=640\nimHeight=480",
            "seqinfo.ini: says that the pictures have 640 x 480 px",
            id="size",
        ),
        pytest.param("ignore.txt", "1,2,3,4\n1,2,0,4", "ignore.txt:2: expected width and height above 0", id="region"),
        pytest.param("ignore.txt", "1,2,3", "ignore.txt:1: expected at least 4 columns", id="short-region"),
        pytest.param("gt/labels.txt", "car\n", "labels.txt names classes, but there is no column 8", id="no-classes"),
    ],
)
def test_bad_file_beside_the_truth_is_named(tmp_path, name, content, message):
    write_pictures(tmp_path / "b", ["000001.png"])
    folder = write_mot(tmp_path / "a", ROW)
    (folder / "link").symlink_to(tmp_path / "b")
    write(folder / name, content)
    assert message in refusal(LookonceError, partial(open_sequences, folder))


@pytest.mark.parametrize("number", ["0", "3", "-1", "1.5"])
def test_class_that_labels_do_not_name_is_refused(tmp_path, number):
    folder = write_mot(tmp_path / "a", f"{ROW},1,1\n2,1,1,1,9,9,1,{number}\n")
    write(folder / "gt" / "labels.txt", "person\ncar\n")
    assert "gt.txt:2: class: expected a whole number from 1 to 2" in refusal(
        FormatError, partial(open_sequences, folder)
    )


def test_missing_pictures_are_named(tmp_path):
    folder = write_mot(tmp_path / "a", ROW, pictures=0)
    said = refusal(VideoError, partial(open_sequences, folder))
    assert said.startswith(f"{folder}/img1: no such pictures for {folder}/gt/gt.txt; put them there")
    (folder / "img1").mkdir()
    assert f"{folder}/img1: no pictures in it" in refusal(VideoError, partial(open_sequences, folder))


def test_frames_without_pictures_are_counted(tmp_path):
    folder = write_mot(tmp_path / "a", "3,1,1,1,9,9\n4,1,1,1,9,9\n5,1,1,1,9,9\n")
    assert "img1: no picture of frame 4 and 1 more that have truth" in refusal(
        VideoError, partial(open_sequences, folder)
    )
    folder = write_mot(tmp_path / "b", "4,1,1,1,9,9\n")
    assert "img1: no picture of frame 4, see" in refusal(VideoError, partial(open_sequences, folder))


def test_pictures_of_two_sizes_are_refused(tmp_path):
    folder = write_mot(tmp_path / "a", ROW)
    write_picture(folder / "img1" / "000003.png", (20, 30))
    said = refusal(FormatError, partial(open_sequences, folder))
    assert "000003.png: 30 x 20 px, the first picture has 64 x 48" in said


def test_damaged_first_picture_is_named(tmp_path):
    folder = write_mot(tmp_path / "a", ROW)
    write(folder / "img1" / "000001.png", b"nothing")
    assert "000001.png: not a picture, or damaged" in refusal(FormatError, partial(open_sequences, folder))


def test_every_one_of_many_rows_is_read(tmp_path, square_clip):
    rows = "".join(f"{n // 20 + 1},{n % 20 + 1},{n % 50}.25,5,20.5,10,1,3,0.5\n" for n in range(60_000))
    sequence = read_one(write_mot(tmp_path / "a", rows, pictures=0), pictures=square_clip)
    assert sum(len(frame.objects) for frame in sequence.frames) == 60_000
    assert sequence.frames[-1].index == 2_999
