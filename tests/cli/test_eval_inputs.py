"""What `lookonce eval` says of input that cannot be right: one line that names the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cli.evaluated import detrac_xml, done, refusal, result_lines, table_row, write_truth
from datasets.making import annotation, write, write_mot


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    return write_truth(tmp_path / "truth")


BAD_RESULTS = {
    "twice": ("1,1,5,5,9,9,1,-1,-1,-1\n1,1,6,5,9,9,1,-1,-1,-1\n", "id 1 a second time in frame 1"),
    "nan": ("1,1,nan,5,9,9,1,-1,-1,-1\n", "expected a finite number in column 3"),
    "negative": ("1,1,5,5,-9,9,1,-1,-1,-1\n", "width and height"),
    "from-0": ("0,1,5,5,9,9,1,-1,-1,-1\n", "frames count from 1; add 1"),
    "mixed": ("1,1,5,5,9,9,1,-1,-1,-1\n2 1 5 5 9 9 1 -1 -1 -1\n", "use one separator throughout"),
    "empty": ("", "the results hold no box"),
    "detections": ("1,-1,5,5,9,9,1,-1,-1,-1\n", "detections, which are no tracks"),
}


@pytest.mark.parametrize("kind", BAD_RESULTS)
def test_bad_results_are_one_line_that_names_the_file(kind, truth, tmp_path):
    text, said = BAD_RESULTS[kind]
    message = refusal("--truth", truth / "a", "--results", write(tmp_path / "bad.txt", text))
    assert said in message
    assert "bad.txt" in message


def test_the_order_of_rows_does_not_matter(truth, tmp_path):
    lines = result_lines(switch=4).splitlines(keepends=True)
    rows = []
    for name, text in (("sorted", lines), ("reversed", lines[::-1])):
        result = done("--truth", truth / "a", "--results", write(tmp_path / f"{name}.txt", "".join(text)))
        rows.append(table_row(result.stdout, "a"))
    assert rows[0] == rows[1]


def empty_mot(folder: Path) -> Path:
    return write_mot(folder, "")


def xml(text: str) -> Callable[[Path], Path]:
    return lambda folder: write(folder / "MVI_1.xml", text)


ENTITY = '<?xml version="1.0"?>\n<!DOCTYPE s [<!ENTITY a "b">]>\n<sequence name="&a;"></sequence>\n'
BAD_TRUTH = {
    "no-object": (empty_mot, "no object"),
    "no-target": (xml(annotation()), "no object"),
    "entity": (xml(ENTITY), "a DTD, an entity"),
    "huge": (xml(annotation(name="x" * 100_000)), "more than 200 characters"),
    "cut": (xml(detrac_xml()[:-30]), "no valid XML"),
    "missing": (lambda folder: folder, "no such folder or file"),
}


@pytest.mark.parametrize("protocol", ["trackeval", "detrac"])
@pytest.mark.parametrize("kind", BAD_TRUTH)
def test_bad_truth_is_one_line(kind, protocol, tmp_path):
    make, said = BAD_TRUTH[kind]
    results = write(tmp_path / "MVI_1.txt", result_lines())
    assert said in refusal("--truth", make(tmp_path / "t"), "--results", results, "--protocol", protocol)


def test_names_that_no_system_takes_are_one_line(truth, tmp_path):
    results, long = write(tmp_path / "r.txt", result_lines()), "x" * 300
    assert "no such results" in refusal("--truth", truth, "--results", long)
    assert "no such results" in refusal("--truth", truth, "--results", f"a={long}")
    assert "no such folder" in refusal("--truth", long, "--results", results)
    assert "no such folder or video" in refusal(
        "--truth", truth / "a", "--frames", long, "--results", results, "--benchmark", "MOT15"
    )
    assert "cannot be created" in refusal("--truth", truth / "a", "--results", results, "--json", tmp_path / long)


def test_class_numbers_that_nobody_explains_are_asked_for(tmp_path):
    lines = result_lines(classes=True)
    write(tmp_path / "xml" / "MVI_1.xml", detrac_xml())
    arguments = ("--truth", tmp_path / "xml", "--protocol", "detrac", "--results", write(tmp_path / "r.txt", lines))
    assert "give --class-names FILE" in refusal(*arguments, "--per-class")
    names = write(tmp_path / "names.txt", "bus\ncar\n")
    result = done(*arguments, "--per-class", "--class-names", names)
    assert table_row(result.stdout, "bus")
    assert table_row(result.stdout, "car")


def test_a_table_instead_of_its_folder_is_refused(truth, tmp_path):
    assert "name their folder" in refusal("--truth", truth / "a", "--results", write(tmp_path / "a_LX.txt", "1\n"))
