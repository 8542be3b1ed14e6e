"""The file of trials: whole lines whatever happens, and nothing of it believed unseen."""

from __future__ import annotations

import json

import pytest

from datasets.making import refusal
from lookonce.errors import FormatError, OutputError
from lookonce.tuning.ranges import SearchRange
from lookonce.tuning.trials import Trial, TrialFile

RANGES = (SearchRange("memory_s", 0.5, 60.0, is_log=True), SearchRange("views", 0, 12, is_whole=True))
ABOUT = {"objective": "hota", "frame_rates": [1, 2], "data": {"a": "0" * 64}}
TRIALS = [Trial({"memory_s": 8.0, "views": 4}, 0.5), Trial({"memory_s": 0.75, "views": 0}, 1 / 3)]


@pytest.fixture
def path(tmp_path):
    file = TrialFile(tmp_path / "trials.jsonl", ABOUT, RANGES, resumes=False)
    for trial in TRIALS:
        file.append(trial)
    return file.path


def resumed(path, about=ABOUT, ranges=RANGES):
    return TrialFile(path, about, ranges, resumes=True)


def test_trials_come_back_exactly(path):
    found = resumed(path).trials
    assert found == TRIALS
    assert isinstance(found[0].values["views"], int)


def test_without_resume_a_file_is_replaced(path):
    assert TrialFile(path, ABOUT, RANGES, resumes=False).trials == []
    assert len(path.read_bytes().splitlines()) == 1


def test_a_line_that_was_cut_off_is_forgotten_and_the_next_one_is_whole(path):
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"score": 0.7, "val')
    file = resumed(path)
    assert file.trials == TRIALS
    file.append(TRIALS[0])
    assert resumed(path).trials == [*TRIALS, TRIALS[0]]
    assert path.read_bytes().startswith(whole)


@pytest.mark.parametrize(
    ("about", "told"),
    [
        pytest.param({"objective": "idf1"}, "objective (hota there, idf1 here)", id="objective"),
        pytest.param({"frame_rates": [1]}, "frame rates", id="rates"),
        pytest.param({"data": {"b": "0" * 64}}, "data", id="data"),
        pytest.param(
            {"data": {"b": "0" * 64}, "objective": "mota"}, "objective (hota there, mota here), data", id="both"
        ),
    ],
)
def test_another_search_is_refused(path, about, told):
    before = path.read_bytes()
    message = refusal(OutputError, lambda: resumed(path, ABOUT | about))
    assert f"trials.jsonl: a search of other {told}; " in message
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "line",
    [
        pytest.param(b"{", id="cut"),
        pytest.param(b"[]", id="list"),
        pytest.param(b"\xff\xfe", id="binary"),
        pytest.param(b"[" * 100_000, id="deep"),
        pytest.param(b'{"score": 1' + b"0" * 5000 + b"}", id="digits"),
        pytest.param(b'{"score": 0.5}', id="no values"),
        pytest.param(b'{"score": "x", "values": {"memory_s": 8.0, "views": 4}}', id="score"),
        pytest.param(b'{"score": NaN, "values": {"memory_s": 8.0, "views": 4}}', id="nan"),
        pytest.param(b'{"score": 1' + b"0" * 400 + b', "values": {"memory_s": 8.0, "views": 4}}', id="too large"),
        pytest.param(b'{"score": true, "values": {"memory_s": 8.0, "views": 4}}', id="bool"),
        pytest.param(b'{"score": 0.5, "values": {"memory_s": 8.0}}', id="missing"),
        pytest.param(b'{"score": 0.5, "values": {"memory_s": 8.0, "views": 4, "x": 1}}', id="unknown"),
        pytest.param(b'{"score": 0.5, "values": {"memory_s": 99.0, "views": 4}}', id="outside"),
        pytest.param(b'{"score": 0.5, "values": {"memory_s": NaN, "views": 4}}', id="nan value"),
        pytest.param(b'{"score": 0.5, "values": {"memory_s": 8.0, "views": 4.5}}', id="fraction"),
        pytest.param(b'{"score": 0.5, "values": {"memory_s": 8.12345, "views": 4}}', id="never tried"),
    ],
)
def test_lines_that_cannot_be_are_one_line_with_their_number(path, line):
    path.write_bytes(path.read_bytes() + line + b"\n")
    assert "trials.jsonl:4: " in refusal(FormatError, lambda: resumed(path))


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(b"", id="empty"),
        pytest.param(b"{}\n", id="no format"),
        pytest.param(b"hello\n", id="text"),
        pytest.param(json.dumps({"format": "lookonce-tuning", "format_version": 2}).encode() + b"\n", id="version"),
        pytest.param(b"#" * (65 << 20), id="huge"),
    ],
)
def test_other_files_are_refused(path, content):
    path.write_bytes(content)
    assert "not a search of `lookonce tune`" in refusal(FormatError, lambda: resumed(path))
    assert path.read_bytes() == content


def test_a_folder_in_the_way_is_one_line(tmp_path):
    (tmp_path / "trials.jsonl").mkdir()
    for resumes in (False, True):
        refusal(
            OutputError, lambda resumes=resumes: TrialFile(tmp_path / "trials.jsonl", ABOUT, RANGES, resumes=resumes)
        )
