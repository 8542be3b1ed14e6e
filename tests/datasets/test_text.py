"""Tables of numbers: what is read, and which line is to blame."""

from __future__ import annotations

import os

import numpy as np
import pytest

from datasets.making import refusal, write
from lookonce.datasets import text
from lookonce.datasets.class_names import read_class_names, unite
from lookonce.datasets.folders import folders_below
from lookonce.datasets.text import read_table, read_text
from lookonce.errors import ConfigError, FormatError


@pytest.mark.parametrize(
    "content",
    [
        pytest.param("1,2,3\n4,5,6\n", id="commas"),
        pytest.param("1, 2, 3\n4 ,5, 6", id="commas-and-blanks"),
        pytest.param("1;2;3\r\n4;5;6\r\n", id="semicolons-windows"),
        pytest.param("1 2\t3\n 4  5 6 \n", id="blanks-and-tabs"),
        pytest.param("1.0,2e0,3\r4,5,6\r", id="old-mac"),
        pytest.param("\ufeff1,2,3\n4,5,6\n", id="byte-order-mark"),
    ],
)
def test_numbers_are_read_whatever_separates_them(tmp_path, content):
    table = read_table(write(tmp_path / "a.txt", content), "a, b, c")
    assert table.values.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert table.lines.tolist() == [1, 2]


def test_blank_lines_are_skipped_and_counted(tmp_path):
    table = read_table(write(tmp_path / "a.txt", "\n1,2\n   \n\n3,4\n\n"), "a, b")
    assert table.values.tolist() == [[1, 2], [3, 4]]
    assert table.lines.tolist() == [2, 5]


@pytest.mark.parametrize("content", ["", "\n\n", "  \n"])
def test_empty_file_has_no_rows(tmp_path, content):
    assert read_table(write(tmp_path / "a.txt", content), "a, b").values.shape == (0, 2)


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [
        pytest.param("1,2\n3 4\n", 2, "separated by blanks where the lines before have commas", id="mixed-blanks"),
        pytest.param("1,2\n3;4\n", 2, "separated by semicolons where the lines before have commas", id="mixed-marks"),
        pytest.param("1 2\n\n3,4\n", 3, "separated by commas where the lines before have blanks", id="mixed-commas"),
        pytest.param("1,2\n3,4,5\n", 2, "3 columns where the lines before have 2", id="columns"),
        pytest.param("1,2\n3,x y\n", 2, "expected a number in column 2, got 'x y'", id="word"),
        pytest.param("1,2\n3,1_0\n", 2, "expected a number in column 2, got '1_0'", id="digit-groups"),
        pytest.param("1,2,\n", 1, "expected a number in column 3, got ''", id="trailing-comma"),
        pytest.param("frame,id\n1,2\n", 1, "expected a number in column 1, got 'frame'; remove the heading", id="head"),
        pytest.param("1\n2\n", 1, "expected at least 2 columns (a, b), got 1", id="too-few"),
        pytest.param("1,2\n3," + "9" * 100 + "x\n", 2, "'" + "9" * 40 + "...'", id="long-word"),
        pytest.param(b"1,2\n3,\xff\n", 2, "not UTF-8 text; save the file as UTF-8", id="latin-1"),
        pytest.param("1,2\n" + "3" * 10_001, 2, "a line of more than 10,000 bytes", id="long-line"),
    ],
)
def test_faulty_line_is_named(tmp_path, content, line, message):
    path = write(tmp_path / "a.txt", content)
    said = refusal(FormatError, lambda: read_table(path, "a, b"))
    assert said.startswith(f"{path}:{line}: ")
    assert message in said


def test_binary_file_is_refused(tmp_path):
    path = write(tmp_path / "a.txt", b"1,2\n\0\1")
    assert "a.txt: binary or UTF-16" in refusal(FormatError, lambda: read_text(path))


def test_huge_file_is_refused_unread(tmp_path):
    path = write(tmp_path / "a.txt", b"")
    os.truncate(path, text.MAX_FILE_BYTES + 1)
    assert "a.txt: larger than 200 MB" in refusal(FormatError, lambda: read_text(path))


def test_too_many_rows_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "MAX_ROWS", 10_000)
    path = write(tmp_path / "a.txt", "1\n" * 10_001)
    assert "a.txt: more than 10,000 lines" in refusal(FormatError, lambda: read_table(path, "a"))


def test_file_that_may_not_be_read_is_one_line(tmp_path):
    assert "no such file" in refusal(FormatError, lambda: read_text(tmp_path))
    if os.geteuid():
        path = write(tmp_path / "a.txt", "1")
        path.chmod(0)
        assert "check its permissions" in refusal(FormatError, lambda: read_text(path))


def test_name_with_a_line_end_stays_one_line(tmp_path):
    path = write(tmp_path / "a\nb.txt", "x")
    assert r"a\nb.txt:1: " in refusal(FormatError, lambda: read_table(path, "a"))


def test_class_names_are_the_lines(tmp_path):
    assert read_class_names(write(tmp_path / "a.txt", "car\r\nlight truck \n\n")) == ("car", "light truck")


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [
        pytest.param("", 1, "expected a class name", id="empty"),
        pytest.param("car\n\nbus\n", 2, "expected a class name", id="gap"),
        pytest.param("car\nbus\ncar\n", 3, "class 'car' a second time (first in line 1)", id="twice"),
        pytest.param("car\n\x1b[31m\n", 2, r"got '\x1b[31m'", id="control-characters"),
        pytest.param("x" * 201, 1, "expected a class name", id="long"),
    ],
)
def test_bad_class_names_are_refused(tmp_path, content, line, message):
    path = write(tmp_path / "a.txt", content)
    said = refusal(FormatError, lambda: read_class_names(path))
    assert said.startswith(f"{path}:{line}: ")
    assert message in said


def test_equal_class_names_keep_their_order():
    names, numbers = unite([("car", "bus"), ("car", "bus")])
    assert names == ("car", "bus")
    assert [new.tolist() for new in numbers] == [[0, 1], [0, 1]]


def test_different_class_names_come_in_natural_order():
    names, numbers = unite([("class 10", "class 2"), (), ("class 3",)])
    assert names == ("class 2", "class 3", "class 10")
    assert [new.tolist() for new in numbers] == [[2, 0], [], [1]]
    assert np.array(numbers[1]).dtype == np.int64


def test_folders_are_found_once_even_where_links_lead_in_circles(tmp_path):
    for name in ("a2/b/c", "a10", ".hidden"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "a2" / "up").symlink_to(tmp_path)
    assert [str(path.relative_to(tmp_path)) for path in folders_below(tmp_path, 2)] == ["a2", "a2/b", "a10"]
    assert [path.name for path in folders_below(tmp_path, 9, closed=("a2",))] == ["a2", "a10"]


def test_search_in_a_whole_disk_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("lookonce.datasets.folders._MAX_FOLDERS", 3)
    for name in "abcd":
        (tmp_path / name).mkdir()
    assert "more than 3 folders" in refusal(ConfigError, lambda: folders_below(tmp_path, 1))
