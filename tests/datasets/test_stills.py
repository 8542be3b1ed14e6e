"""Sets of stills with YOLO text files."""

from __future__ import annotations

from functools import partial

import pytest
from PIL import Image

from datasets.making import refusal, write, write_picture, write_pictures, write_stills
from lookonce.datasets import open_stills
from lookonce.errors import ConfigError, FormatError

BOX = "0 0.5 0.5 0.25 0.5\n"  # in 64 x 48 px: 24, 12 to 40, 36


def names(stills):
    return [path.name for path in stills.pictures]


@pytest.mark.parametrize(
    ("line", "box"),
    [
        pytest.param(BOX, [24, 12, 40, 36], id="box"),
        pytest.param("0.0 0.5 0.5 0.25 0.5 0.93\n", [24, 12, 40, 36], id="score-is-ignored"),
        pytest.param("0 0.25 0.5 0.5 0.25 0.75 1\n", [16, 12, 48, 48], id="triangle"),
        pytest.param("0 0.25 0.5 0.5 0.25 0.75 1 0.5 0.5\n", [16, 12, 48, 48], id="four-points"),
        pytest.param("0 1 1 0.5 0.5\n", [48, 36, 64, 48], id="cut-at-the-border"),
    ],
)
def test_line_becomes_a_box(tmp_path, line, box):
    stills = open_stills(write_stills(tmp_path / "a", {"x": line}))
    assert (stills.name, stills.classes, stills.left_out) == ("a", ("class 0",), {})
    assert stills.objects[0].xyxy.tolist() == [box]
    assert stills.objects[0].visibility.tolist() == [1]


def test_identities_run_over_the_whole_set(tmp_path):
    stills = open_stills(write_stills(tmp_path, {"img10": BOX, "img2": BOX * 2, "img3": "", "img4": None}))
    assert names(stills) == ["img2.png", "img3.png", "img4.png", "img10.png"]
    assert [objects.identities.tolist() for objects in stills.objects] == [[0, 1], [], [], [2]]
    assert stills.left_out == {"pictures without labels": 1}


def test_box_outside_the_picture_is_counted(tmp_path):
    stills = open_stills(write_stills(tmp_path, {"a": "0 1.5 0.5 0.5 0.5\n" + BOX, "b": "0 0.5 -0.5 0.5 0.5\n"}))
    assert stills.left_out == {"outside the picture": 2}
    assert [len(objects) for objects in stills.objects] == [1, 0]


def test_turned_picture_gives_boxes_of_the_picture_as_it_is_seen(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    write_picture(tmp_path / "a.jpg", exif=exif)
    write(tmp_path / "a.txt", BOX)
    assert open_stills(tmp_path).objects[0].xyxy.tolist() == [[18, 16, 30, 48]]


def test_folder_without_any_label_is_read_as_pictures(tmp_path):
    write_pictures(tmp_path, ["a.png", "b.jpg"])
    stills = open_stills(tmp_path)
    assert [len(objects) for objects in stills.objects] == [0, 0]
    assert (stills.classes, stills.left_out) == ((), {"pictures without labels": 2})


@pytest.mark.parametrize("given", ["", "train", "train/images"])
def test_labels_are_found_from_wherever_the_set_is_named(tmp_path, given):
    write_stills(tmp_path / "set" / "train", {"a": "1 0.5 0.5 0.5 0.5\n"})
    write(tmp_path / "set" / "classes.txt", "person\ncar\n")
    stills = open_stills(tmp_path / "set" / given)
    assert [len(objects) for objects in stills.objects] == [1]
    assert stills.classes == ("person", "car")


def test_parts_inside_images_have_parts_inside_labels(tmp_path):
    for part in ("train", "val"):
        write_picture(tmp_path / "images" / part / "a.png")
        write(tmp_path / "labels" / part / "a.txt", BOX)
    assert [len(objects) for objects in open_stills(tmp_path).objects] == [1, 1]
    assert len(open_stills(tmp_path / "images" / "val").objects[0]) == 1


@pytest.mark.parametrize("place", ["a/labels/classes.txt", "a/obj.names", "a/my.names", "classes.txt", "../obj.names"])
def test_class_names_are_found_near_the_set(tmp_path, place):
    root = tmp_path / "root"
    write_stills(root / "a", {"x": "1 0.5 0.5 0.5 0.5\n"})
    write(root / place, "person\ncar\n")
    assert open_stills(root / "a").classes == ("person", "car")


def test_labels_beside_pictures_with_classes_beside_them(tmp_path):
    write_picture(tmp_path / "a.png")
    write(tmp_path / "a.txt", BOX)
    write(tmp_path / "classes.txt", "car\n")
    stills = open_stills(tmp_path)
    assert (len(stills.objects[0]), stills.classes) == (1, ("car",))


def test_sets_below_a_root_are_joined_under_one_numbering(tmp_path):
    for name, classes in (("set10", "car\nbus\n"), ("set2", "bus\nvan\n")):
        write_stills(tmp_path / name, {"a": BOX})
        write(tmp_path / name / "classes.txt", classes)
    stills = open_stills(tmp_path)
    assert [path.parts[-3] for path in stills.pictures] == ["set2", "set10"]
    assert stills.classes == ("bus", "car", "van")
    assert [objects.labels.tolist() for objects in stills.objects] == [[0], [1]]
    assert [objects.identities.tolist() for objects in stills.objects] == [[0], [1]]


def test_classes_without_names_count_to_the_highest(tmp_path):
    stills = open_stills(write_stills(tmp_path, {"a": "2 0.5 0.5 0.5 0.5\n"}))
    assert stills.classes == ("class 0", "class 1", "class 2")


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        pytest.param(
            BOX + "0 0.5 0.5 0.25\n", 2, "expected class cx cy w h, or a class and at least 3", id="4-columns"
        ),
        pytest.param("0 0 0 1 1 0 1 1\n", 1, "got 8 columns", id="8-columns"),
        pytest.param("0,0.5,0.5,0.25,0.5\n", 1, "got 1 columns", id="commas"),
        pytest.param("car 0.5 0.5 0.25 0.5\n", 1, "expected numbers separated by blanks, got 'car 0.5", id="word"),
        pytest.param("\n0 0.5 nan 0.25 0.5\n", 2, "expected shares of the picture's width and height", id="nan"),
        pytest.param("0 0.5 0.5 inf 0.5\n", 1, "expected shares", id="infinity"),
        pytest.param("0 24 12 16 24\n", 1, "got '24 12 16 24'; are these px?", id="px"),
        pytest.param("0 0.5 0.5 0 0.5\n", 1, "expected width and height above 0", id="no-width"),
        pytest.param("0 0.5 0.5 0.5 -0.5\n", 1, "expected width and height above 0", id="negative-height"),
        pytest.param("0 0.1 0.1 0.1 0.5 0.1 0.9\n", 1, "expected width and height above 0", id="flat-polygon"),
        pytest.param("-1 0.5 0.5 0.5 0.5\n", 1, "class: expected a whole number from 0, got -1", id="negative-class"),
        pytest.param("1.5 0.5 0.5 0.5 0.5\n", 1, "class: expected a whole number from 0, got 1.5", id="half-a-class"),
        pytest.param("nan 0.5 0.5 0.5 0.5\n", 1, "class: expected a whole number from 0, got nan", id="nan-class"),
        pytest.param("12345 0.5 0.5 0.5 0.5\n", 1, "class 12345 without a name; add the file classes.txt", id="many"),
        pytest.param(b"0 0.5 \xff\n", 1, "not UTF-8 text", id="latin-1"),
        pytest.param(b"\0", 0, "binary or UTF-16", id="binary"),
        pytest.param("0 " * 6_000, 1, "a line of more than 10,000 bytes", id="long-line"),
    ],
)
def test_bad_label_file_is_one_line_that_names_file_and_line(tmp_path, text, line, message):
    folder = write_stills(tmp_path, {"a": ""})
    path = write(tmp_path / "labels" / "a.txt", text)
    said = refusal(FormatError, partial(open_stills, folder))
    assert said.startswith(f"{path}:{line}: " if line else f"{path}: ")
    assert message in said


def test_class_that_has_no_name_in_the_file_of_names_is_refused(tmp_path):
    folder = write_stills(tmp_path / "a", {"x": "1 0.5 0.5 0.5 0.5\n"})
    path = write(tmp_path / "classes.txt", "car\n")
    said = refusal(FormatError, partial(open_stills, folder))
    assert f"labels/x.txt:1: class 1, but {path} names 0 to 0; mend one" in said


def test_damaged_picture_is_named(tmp_path):
    folder = write_stills(tmp_path, {"a": BOX})
    path = write(folder / "images" / "b.jpg", b"nothing")
    said = refusal(FormatError, partial(open_stills, folder))
    assert said == f"{path}: not a picture, or damaged; copy it again or remove it"


def test_folder_that_cannot_be_is_refused(tmp_path):
    assert "none: no such folder" in refusal(ConfigError, partial(open_stills, tmp_path / "none"))
    assert "no pictures in it or below" in refusal(ConfigError, partial(open_stills, tmp_path))


def test_two_files_of_class_names_are_refused(tmp_path):
    folder = write_stills(tmp_path, {"a": BOX})
    write(tmp_path / "a.names", "car\n")
    write(tmp_path / "b.names", "bus\n")
    assert "class names in a.names and b.names; keep one" in refusal(ConfigError, partial(open_stills, folder))


@pytest.mark.data
def test_real_sets_are_read_whole(data_folder):
    stills = open_stills(data_folder / "stills")
    assert (stills.name, len(stills.pictures)) == ("stills", 2761)
    assert stills.classes == ("person", "bicycle", "motorcycle", "car", "bus", "truck")
    assert sum(map(len, stills.objects)) == 18_331
    assert stills.left_out == {}
    assert stills.pictures[0].parts[-3] == "atl"


@pytest.mark.data
@pytest.mark.parametrize(("name", "pictures"), [("manaus4", 532), ("openimages", 627)])
def test_one_real_set_has_the_class_names_of_the_folder_above(data_folder, name, pictures):
    stills = open_stills(data_folder / "stills" / name)
    assert (stills.name, len(stills.pictures), len(stills.classes)) == (name, pictures, 6)
